"""Maps that a law has learned, in the format of firmware's flash memory: read, checked, written, printed."""

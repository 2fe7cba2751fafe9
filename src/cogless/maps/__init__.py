"""Maps that a law has learned, as firmware keeps them in flash: read, checked, written, printed."""

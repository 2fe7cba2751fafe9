"""What a law has learned, as firmware keeps it in flash: read, checked, written, printed."""

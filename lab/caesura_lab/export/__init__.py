"""Export of a session for other software."""

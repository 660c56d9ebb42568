"""Task programs as files: our own JSON, a script for franky, a behaviour tree."""

"""Task programs as files: Caesura's JSON, a script for franky, a behaviour tree."""

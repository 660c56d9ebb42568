"""Runs task programs: checks before a run (`checks`), and a simulated robot (`executor`)."""

"""Recordings to judge on: suites of them, and what each suite changes in a recording."""

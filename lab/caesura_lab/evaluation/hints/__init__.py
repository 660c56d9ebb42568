"""Hints to the teacher, judged on demonstrations with injected faults."""

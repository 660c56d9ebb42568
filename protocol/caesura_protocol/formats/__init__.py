"""Readers and writers of file formats and foreign messages: one module a format, imported at its first use.

Each reader returns an `unvalidated_recording.UnvalidatedRecording`. `read.load_recording` validates it and
makes a Recording.
"""

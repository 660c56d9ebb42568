"""Readers and writers of file formats and foreign messages: one module a format, imported at its first use.

`content.RawRecording` is what each reader returns; `recording.load_recording` checks it and makes it a
Recording.
"""

"""Files and messages of others, read as recordings: one module a format, imported when it is asked for.

`content.Content` is what each reader returns; `recording.load_recording` checks it and makes it a Recording.
"""

"""Boundaries and classes of a recording, marked by hand and blind to every result of the service.

`edits` changes an annotation, `storage` reads and writes it, `signals` prepares what is drawn, and `page`
shows it.
"""

"""The segmenter: signals in, segments and task programs out."""

"""What connects to the segmenter: bridges, readers and the command line."""

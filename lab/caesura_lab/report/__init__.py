"""A report of a recording's segmentation: its content is gathered, then drawn, then written."""

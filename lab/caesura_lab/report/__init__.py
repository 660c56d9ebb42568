"""A report of a recording's segmentation: collects its data, draws it, and writes it."""

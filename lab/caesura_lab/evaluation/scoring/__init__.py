"""Scores of a segmentation against the truth, and their summary with intervals."""

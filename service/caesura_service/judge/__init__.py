"""The judge: what a segmentation is worth against the truth, ours and everybody else's by the same rules."""

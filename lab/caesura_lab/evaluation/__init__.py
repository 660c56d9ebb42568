"""The judge: what a segmentation is worth against the truth, Caesura's and others' by the same rules."""

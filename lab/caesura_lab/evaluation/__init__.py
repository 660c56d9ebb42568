"""The judge: scores segmentations against the truth, Caesura's and those of others by the same rules."""

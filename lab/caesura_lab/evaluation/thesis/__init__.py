"""Reproduces the thesis' results on the simulated teacher, with the share of seeds that agree, by row."""

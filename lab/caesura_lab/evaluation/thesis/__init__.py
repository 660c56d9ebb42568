"""Reproduces the thesis' results, row by row, on the simulated teacher, with the share of seeds that
agree.
"""

"""The thesis' results, row by row, on the simulated teacher: what comes out again, and how often."""

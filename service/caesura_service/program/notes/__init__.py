"""Notes on what was taught and is not in the program, or not reproduced by it."""

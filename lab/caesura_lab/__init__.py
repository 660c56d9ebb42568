"""The simulated teacher, simulated execution, evaluation, and the commands that work on recordings."""

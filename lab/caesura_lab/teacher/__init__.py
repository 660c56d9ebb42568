"""The simulated teacher: a person guides a Panda through a task, with the truth beside it.

Start at `teaching`: `teach("pick_and_place", seed=3)` for a whole demonstration, `Teaching` for a live one.
This file imports nothing, so that the command line starts where neither pinocchio nor scipy is installed.
"""

"""The simulated teacher: a person guides a robot through a task; the truth of the demonstration is known.

Start at `simulated_teaching`: `teach("pick_and_place", seed=3)` gives a whole demonstration,
`SimulatedTeaching` a live one. This file imports nothing, so that the command line starts without pinocchio
and scipy.
"""

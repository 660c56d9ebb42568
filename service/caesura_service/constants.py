"""Physical constants and rates that several rooms use; each is defined here and nowhere else."""

from __future__ import annotations

GRAVITY = 9.81  # [m/s²], as the thesis has it
JOINTS = 7  # of a Panda
JOINTS_MOST = 8  # of any arm
# [N] scale of what free space reads after a tare: in real recordings the bias wanders so far with the pose
TARED_BIAS_N = 2.3
GRID_HZ = 100  # [1/s] of the grid to which samples are brought before they are filtered

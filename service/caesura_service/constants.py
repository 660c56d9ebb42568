"""Physical constants and rates that several rooms use; each is defined here and nowhere else."""

from __future__ import annotations

GRAVITY = 9.81  # [m/s²], as the thesis has it
JOINTS = 7  # of a Panda
JOINTS_MOST = 8  # of any arm
GRID_HZ = 100  # [1/s] of the grid to which samples are brought before they are filtered

"""Re-times programs to the limits of the robot: `caesura program --speed optimal`."""

from caesura_lab.retiming.program import optimal

__all__ = ["optimal"]

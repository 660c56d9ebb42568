"""Programs as fast as the limits of the robot allow: `caesura program --speed optimal`."""

from caesura_lab.retiming.program import optimal

__all__ = ["optimal"]

"""The limits and surroundings of a robot that runs a program: one table for check, executor and exporters.

The same numbers are at the top of an exported script (`caesura_protocol.programs.safety`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from caesura_lab.teacher.level_surface_contact import Surface
from caesura_protocol.messages import Vector
from caesura_protocol.programs.safety import DEFAULT, Safety


@dataclass(frozen=True)
class Cell:
    """The place where a program is run: limits, obstacles, and the robot's start.

    start: flange [m], None if unknown; obstacles: from their surface down to the floor.
    """

    safety: Safety = DEFAULT
    obstacles: Sequence[Surface] = field(default=())
    start: Vector | None = None

    def surface_height(self, x: float, y: float) -> float | None:
        """Return the height [m] of the fingertips at which they touch an obstacle at a place.

        None without one.
        """
        return max((one.height_at(x, y) for one in self.obstacles if one.covers(x, y)), default=None)

    def compliance_depth(self, x: float, y: float) -> float:
        """Return the depth [m] by which the obstacle at a place can be pushed in."""
        return max((one.compliance_depth_m for one in self.obstacles if one.covers(x, y)), default=0.0)

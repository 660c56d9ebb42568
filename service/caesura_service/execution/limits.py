"""What a robot may do while it runs a program, and where: one table for check, executor and exporters.

The same numbers stand at the top of an exported script (`caesura_clients.programs.safety`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot

from caesura_clients.bridge.teacher.intentions import Array
from caesura_clients.programs.safety import DEFAULT, Safety
from caesura_protocol.messages import Vector


@dataclass(frozen=True)
class Obstacle:
    """Something that stands in the cell: a cylinder from its top to the floor, or all of it (radius inf).

    top_m: height of the flange, fingers down, at which they touch it; yields_m: by which it can be
    pushed in, like a button.
    """

    top_m: float
    center_m: tuple[float, float]
    radius_m: float
    yields_m: float = 0.0

    def covers(self, x: float, y: float) -> bool:
        """Whether a point of the base plane [m] lies over it."""
        return hypot(x - self.center_m[0], y - self.center_m[1]) <= self.radius_m


@dataclass(frozen=True)
class Cell:
    """Where a program is run: limits, what stands there, and where the robot begins.

    start: flange [m], None where nobody knows; obstacles: none where nobody knows.
    """

    safety: Safety = DEFAULT
    obstacles: Sequence[Obstacle] = field(default=())
    start: Vector | None = None

    def top_at(self, x: float, y: float) -> float | None:
        """Height [m] of the flange at which the fingers touch something at a place, if there is anything."""
        return max((one.top_m for one in self.obstacles if one.covers(x, y)), default=None)

    def yields_at(self, point: Array) -> float:
        """By how much [m] what stands at a place (3,) can be pushed in."""
        x, y = float(point[0]), float(point[1])
        return max((one.yields_m for one in self.obstacles if one.covers(x, y)), default=0.0)

"""The surfaces that a hand can touch: level ones, which push back and never pull.

A rigid one is a stiff spring with a damper; a dispenser or a button yields over its travel and then meets a
hard stop. Friction holds like a bristle until it slips (Coulomb's law with a finite stiffness, Dahl 1968),
which stays stable at 1 kHz where a discontinuous law would chatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf

from caesura_lab.teacher.motion_profiles import Vector

STIFF_N_PER_M = 2e4
BRISTLE_N_PER_M = 2e4
BRISTLE_NS_PER_M = 60.0
SOFT_DAMPING_NS_PER_M = 40.0
FULL_DAMPING_DEPTH_M = 5e-4  # the damper engages over this depth, so that the force starts at 0


@dataclass(frozen=True)
class Surface:
    """A level surface.

    touch_height_m: height of the fingertips in the base frame at which it is touched.
    """

    touch_height_m: float
    center_m: tuple[float, float] = (0.0, 0.0)
    radius_m: float = inf
    travel_m: float = 0.0
    preload_n: float = 0.0  # what a button asks for before it moves
    spring_n_per_m: float = 0.0
    stiffness_n_per_m: float = STIFF_N_PER_M
    damping_ns_per_m: float = 250.0
    friction: float = 0.3

    def static_force(self, depth_m: float) -> float:
        """Return the force at rest [N] at a depth below the touch height [m]."""
        if depth_m <= 0.0:
            return 0.0
        if depth_m < self.travel_m:
            return self.preload_n * min(1.0, depth_m / FULL_DAMPING_DEPTH_M) + self.spring_n_per_m * depth_m
        return self._force_at_stop + self.stiffness_n_per_m * (depth_m - self.travel_m)

    def depth_for(self, force_n: float) -> float:
        """Return the depth [m] at which the surface carries a force [N] at rest."""
        if force_n >= self._force_at_stop:
            return self.travel_m + (force_n - self._force_at_stop) / self.stiffness_n_per_m
        return max(0.0, force_n - self.preload_n) / self.spring_n_per_m

    def normal_force(self, depth_m: float, rate_m_per_s: float) -> float:
        """Return the upward force [N] at a depth [m] that grows at a rate [m/s]; never negative."""
        if depth_m <= 0.0:
            return 0.0
        at_stop = depth_m >= self.travel_m
        damping = self.damping_ns_per_m if at_stop else SOFT_DAMPING_NS_PER_M
        engaged = min(1.0, (depth_m - self.travel_m * at_stop) / FULL_DAMPING_DEPTH_M)
        return max(0.0, self.static_force(depth_m) + damping * engaged * rate_m_per_s)

    def covers(self, x: float, y: float) -> bool:
        """Return whether a point of the base plane [m] is over the surface."""
        return hypot(x - self.center_m[0], y - self.center_m[1]) <= self.radius_m

    def height_at(self, x: float, y: float) -> float:
        """Return the height [m] of the fingertips at the touch, over a point of the base plane [m]."""
        del x, y
        return self.touch_height_m

    @property
    def compliance_depth_m(self) -> float:
        """The depth [m] to which the surface can be pushed in."""
        return self.travel_m

    @property
    def _force_at_stop(self) -> float:
        return self.preload_n + self.spring_n_per_m * self.travel_m if self.travel_m else 0.0


class FingertipContact:
    """Contact of one point, the fingertips, with the surfaces around it. Keeps the bristle between steps."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._surfaces = tuple(surfaces)
        self._stretch = (0.0, 0.0)

    def force(
        self, position: Sequence[float], velocity: Sequence[float], dt: float, load_n: float = 0.0
    ) -> Vector:
        """Return the force on the fingertips [N] in a step of dt [s].

        position [m] and velocity [m/s] are those of the fingertips. A held load is as deep in the surface as
        its weight [N] presses it. So a grasp or release of an object on the surface does not change the
        hand's force.
        """
        x, y, z = position
        touched = max(
            (s for s in self._surfaces if s.covers(x, y)), key=lambda s: s.touch_height_m - z, default=None
        )
        depth = touched.touch_height_m - z + touched.depth_for(load_n) if touched else 0.0
        normal = touched.normal_force(depth, -velocity[2]) if touched else 0.0
        if touched is None or normal == 0.0:
            self._stretch = (0.0, 0.0)
            return (0.0, 0.0, 0.0)
        fx, fy = self._friction(velocity, touched.friction * normal, dt)
        return (fx, fy, normal)

    def _friction(self, velocity: Sequence[float], limit_n: float, dt: float) -> tuple[float, float]:
        sx, sy = (s + dt * v for s, v in zip(self._stretch, velocity, strict=False))
        held = BRISTLE_N_PER_M * hypot(sx, sy)
        slip = min(1.0, limit_n / held) if held > 0.0 else 1.0
        self._stretch = (slip * sx, slip * sy)
        damping = BRISTLE_NS_PER_M if slip == 1.0 else 0.0
        fx, fy = (-BRISTLE_N_PER_M * s - damping * v for s, v in zip(self._stretch, velocity, strict=False))
        over = max(1.0, hypot(fx, fy) / limit_n)
        return fx / over, fy / over

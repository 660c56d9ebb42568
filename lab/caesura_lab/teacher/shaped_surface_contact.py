"""Surfaces that are more than level: a screw's head, a hole for a peg, the crown of a barrel.

They push back like a level surface (`level_surface_contact`), along their own normal. A screw also resists
the turning tool and sinks by its pitch; a hole gives way under force and guides sideways what is in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from caesura_lab.teacher.level_surface_contact import (
    BRISTLE_N_PER_M,
    BRISTLE_NS_PER_M,
    FingertipContact,
    Surface,
)
from caesura_lab.teacher.motion_profiles import Array, Vector

ENGAGEMENT_NM_PER_RAD = 40.0  # stiffness of a tool in a screw's head
ENGAGEMENT_NMS_PER_RAD = 0.3
BACKLASH_NM = 0.03  # with which a head holds a tool that is turned back: a ratchet
WALL_N_PER_M, WALL_NS_PER_M = 4e3, 60.0
CHAMFER_M = 0.005  # depth from which the walls of a hole guide with their full stiffness
CYLINDER_SHARE = 0.9  # of the barrel's radius, by which it reaches to either side
ARC_POINTS = 6
UP: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Screw(Surface):
    """A screw's head. It resists being driven by a torque that grows with the angle, and sinks by its pitch.

    pitch_m: advance in one turn; torque_nm, torque_nm_per_rad: resistance at the start and its growth.
    """

    pitch_m: float = 0.0015
    torque_nm: float = 0.4
    torque_nm_per_rad: float = 0.25


@dataclass(frozen=True)
class Hole(Surface):
    """A tight hole in a level surface: what presses harder than its resistance sinks in, down to its floor.

    resistance_n, resistance_n_per_m: force at which it gives way, and its growth with depth.
    """

    floor_m: float = 0.025
    resistance_n: float = 10.0
    resistance_n_per_m: float = 150.0

    @property
    def compliance_depth_m(self) -> float:
        """Depth [m] to which a peg can be pushed in."""
        return self.floor_m


@dataclass(frozen=True)
class HorizontalCylinder(Surface):
    """A cylinder that lies level along the base's x axis; `touch_height_m` is the height of its crown.

    bend_m: radius of its curvature.
    """

    radius_m: float = 0.2

    def covers(self, x: float, y: float) -> bool:
        """Whether a point of the base plane [m] lies over its upper side."""
        del x
        return abs(y - self.center_m[1]) < CYLINDER_SHARE * self.radius_m

    def height_at(self, x: float, y: float) -> float:
        """Height [m] of the fingertips at which it is touched over a point of the base plane [m]."""
        del x
        aside = y - self.center_m[1]
        return self.touch_height_m - self.radius_m + sqrt(self.radius_m**2 - aside**2)

    def arc(self, start: Array, goal: Array, depth_m: float) -> tuple[Vector, ...]:
        """Points between two places (3,) [m] along the surface, at a depth below it [m]."""
        between = start[:2] + np.linspace(0.0, 1.0, ARC_POINTS + 2)[1:-1, None] * (goal - start)[:2]
        return tuple((float(x), float(y), self.height_at(x, y) - depth_m) for x, y in between)

    def depth_and_normal(self, x: float, y: float, z: float) -> tuple[float, Vector]:
        """Depth [m] of a point below the surface, and the normal there."""
        del x
        aside, above = y - self.center_m[1], z - self.touch_height_m + self.radius_m
        distance = hypot(aside, above)
        return self.radius_m - distance, (0.0, aside / distance, above / distance)


SHAPED = (Screw, Hole, HorizontalCylinder)


class ContactWrench(NamedTuple):
    """Wrench of a contact on a tool.

    Force [N] at its tip, torque [Nm] about its axis, normal force [N].
    """

    force: Vector
    torque_nm: float
    normal_n: float


NO_CONTACT = ContactWrench((0.0, 0.0, 0.0), 0.0, 0.0)
Contact = Callable[[Sequence[float], Sequence[float], float, float, float], ContactWrench]


def contact_with(surfaces: Sequence[Surface]) -> Contact:
    """Return what surfaces do to a tool's tip, as `ShapedContact.wrench_at`.

    Level surfaces use the faster `FingertipContact`.
    """
    if any(isinstance(surface, SHAPED) for surface in surfaces):
        return ShapedContact(surfaces).wrench_at
    level = FingertipContact(surfaces)

    def wrench_at(
        position: Sequence[float], velocity: Sequence[float], spin: float, dt: float, load_n: float
    ) -> ContactWrench:
        del spin
        force = level.force(position, velocity, dt, load_n)
        return ContactWrench(force, 0.0, force[2])

    return wrench_at


class ShapedContact:
    """Contact of the tool's tip with surfaces of any shape.

    Keeps bristles, depths and turns between steps. Fingers that have pushed a peg in stand below the rim of
    its hole, so they touch nothing but the hole from then on.
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        self._surfaces = tuple(surfaces)
        self._stretch = np.zeros(3)  # [m] of the friction's bristle
        self._lead_rad = 0.0  # [rad] by which a tool leads the screw's head
        self._driven_rad = 0.0  # [rad] by which the screw has been turned in
        self._insertion_m = 0.0  # [m] by which a peg is in its hole

    def wrench_at(
        self, position: Sequence[float], velocity: Sequence[float], spin: float, dt: float, load_n: float
    ) -> ContactWrench:
        """Return the contact wrench on a tip at a position [m] with a velocity [m/s], in a step of dt [s].

        spin: rate [rad/s] of the tool about its axis, which points to its tip.
        load_n: as of `FingertipContact`.
        """
        x, y, z = position
        within = [s for s in self._surfaces if isinstance(s, Hole)] if self._insertion_m else self._surfaces
        covering = [s for s in within if s.covers(x, y)]
        surface = max(covering, key=lambda s: s.height_at(x, y) - z, default=None)
        if surface is None:
            return self._end_contact()
        depth, normal = self._depth(surface, x, y, z)
        depth += surface.depth_for(load_n)
        rate = -(velocity[0] * normal[0] + velocity[1] * normal[1] + velocity[2] * normal[2])
        normal_n = surface.normal_force(depth, rate)
        if normal_n == 0.0:
            return self._end_contact()
        along = np.array(normal)
        force = normal_n * along + self._friction(np.array(velocity), along, surface.friction * normal_n, dt)
        if isinstance(surface, Hole):
            self._push_in(surface, depth)
            if load_n > 0.0:
                force += self._wall_force(surface, x, y, velocity)
        torque_nm = self._screw_torque(surface, spin, dt) if isinstance(surface, Screw) else 0.0
        fx, fy, fz = force.tolist()
        return ContactWrench((fx, fy, fz), torque_nm, normal_n)

    def _end_contact(self) -> ContactWrench:
        self._stretch, self._lead_rad = np.zeros(3), 0.0
        return NO_CONTACT

    def _depth(self, surface: Surface, x: float, y: float, z: float) -> tuple[float, Vector]:
        if isinstance(surface, HorizontalCylinder):
            return surface.depth_and_normal(x, y, z)
        depth = surface.touch_height_m - z
        if isinstance(surface, Screw):
            depth -= surface.pitch_m * self._driven_rad / (2.0 * pi)
        elif isinstance(surface, Hole):
            depth -= self._insertion_m
        return depth, UP

    def _friction(self, velocity: Array, normal: Array, limit_n: float, dt: float) -> Array:
        """Friction (3,) [N] of a bristle across the normal, as of `FingertipContact`."""
        across = velocity - velocity.dot(normal) * normal
        self._stretch = self._stretch + dt * across
        self._stretch -= self._stretch.dot(normal) * normal
        held = BRISTLE_N_PER_M * sqrt(self._stretch.dot(self._stretch))
        slip = min(1.0, limit_n / held) if held > 0.0 else 1.0
        self._stretch *= slip
        force = -BRISTLE_N_PER_M * self._stretch - (BRISTLE_NS_PER_M if slip == 1.0 else 0.0) * across
        over = max(1.0, sqrt(force.dot(force)) / limit_n)
        return np.asarray(force / over)

    def _push_in(self, hole: Hole, depth: float) -> None:
        """Advance the insertion by as much as the force at rest exceeds the resistance."""
        resistance = hole.resistance_n + hole.resistance_n_per_m * self._insertion_m
        over = hole.static_force(depth) - resistance
        if over > 0.0:
            self._insertion_m = min(hole.floor_m, self._insertion_m + over / hole.stiffness_n_per_m)

    def _wall_force(self, hole: Hole, x: float, y: float, velocity: Sequence[float]) -> Array:
        share = min(1.0, self._insertion_m / CHAMFER_M)
        aside = np.array([x - hole.center_m[0], y - hole.center_m[1], 0.0])
        moving = np.array([velocity[0], velocity[1], 0.0])
        return np.asarray(-share * (WALL_N_PER_M * aside + WALL_NS_PER_M * moving))

    def _screw_torque(self, screw: Screw, spin: float, dt: float) -> float:
        """Return the torque [Nm] on the tool about its axis.

        The screw turns where its resistance is exceeded.
        """
        self._lead_rad += dt * spin
        most = (screw.torque_nm + screw.torque_nm_per_rad * self._driven_rad) / ENGAGEMENT_NM_PER_RAD
        least = -BACKLASH_NM / ENGAGEMENT_NM_PER_RAD
        if self._lead_rad > most:
            self._driven_rad += self._lead_rad - most
            self._lead_rad = most
        elif self._lead_rad < least:
            self._lead_rad = least
        else:
            return -ENGAGEMENT_NM_PER_RAD * self._lead_rad - ENGAGEMENT_NMS_PER_RAD * spin
        return -ENGAGEMENT_NM_PER_RAD * self._lead_rad

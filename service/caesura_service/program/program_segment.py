"""One segment as the program sees it, and what it is compared with: moments of the robot, gripper actions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Joints, Quaternion, Segment, Vector
from caesura_protocol.rotations import upright_rotation
from caesura_protocol.upright import UP
from caesura_service.constants import TARED_BIAS_N

OBSERVED_S, TOUCHED_S = 0.1, 0.05  # from one observation to the next; from a boundary, which lies midway
ROUNDED_S = 1e-6
UNLIKE_N = 2.0 * TARED_BIAS_N  # by which two forces differ, whatever the bias did between them
PUSHES_BACK_N = 3.0  # what is touched; below it is what a sensor makes up
STOPS_SHARE = 0.2  # of the lesser of the peaks of speed on both sides, up to which a movement or a turn stops
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
ACROSS_M, ACROSS_SHARE = 0.015, 1.0  # a stroke along a surface is longer than this, and pushes nothing in
GRIP_SLACK_S = 0.3  # a grip this close to a contact belongs to it
KINDS = {
    ("motion", "free"): "motion",
    ("steady", "free"): "steady",
    ("motion", "contact"): "sliding",
    ("steady", "contact"): "contact",
    ("motion", "transport"): "transport",
    ("steady", "transport"): "hold",
}


@dataclass(frozen=True)
class Moment:
    """The robot at one time, base frame."""

    position: Vector  # [m]
    orientation: Quaternion | None  # x y z w
    joints: Joints | None  # [rad]
    gripper_width: float | None  # [m]
    force: Vector | None = None  # [N] on the robot


MomentAt = Callable[[float], Moment]


def medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(c,) medians of columns (n, c) of finite numbers, n > 0, as `np.median`, in a third of the time."""
    half, is_odd = divmod(len(values), 2)
    ordered = np.sort(values, axis=0)
    middle: NDArray[np.float64] = ordered[half] if is_odd else (ordered[half - 1] + ordered[half]) / 2.0
    return middle + 0.0  # no zero has a sign


@dataclass(frozen=True)
class GripperAction:
    """A gripper event."""

    t: float  # [s]
    kind: Literal["grasp", "release", "open", "close"]
    width: float | None  # [m] where the fingers settled

    def is_near(self, t0: float, tn: float) -> bool:
        """Does it belong to a contact between two times [s]?"""
        return t0 - GRIP_SLACK_S <= self.t <= tn + GRIP_SLACK_S


@dataclass(frozen=True, slots=True)
class Context:
    """What the segments of a demonstration are read beside.

    grips: all that are known; up: away from gravity, of length 1, base frame.
    """

    grips: Sequence[GripperAction]
    moment_at: MomentAt
    up: Vector = UP

    def fingers_move(self, t0: float, tn: float) -> bool:
        """Do they move between two times [s], or close to them?"""
        return any(grip.is_near(t0, tn) for grip in self.grips)

    def median(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3,) [N] median of each axis of forces (n, 3), of which one is vertical."""
        upright = upright_rotation(self.up)
        if upright is None:
            return medians(forces)
        return np.asarray(medians(forces @ upright.T) @ upright)

    def forces(self, times: Sequence[float]) -> NDArray[np.float64]:
        """(n, 3) [N] at some times [s], where they are known."""
        seen = (self.moment_at(t).force for t in times)
        return np.array([force for force in seen if force is not None]).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class ProgramSegment:
    """A segment as the program sees it.

    is_set_apart: an operator has stated that it begins there; base: of a contact, the force [N] before
    anything was touched; rests_before, rests_after: of a stroke, as parts of it; approach: what it is the end
    of, as a part of it: movements into a contact, a stroke.
    """

    index: int
    segment: Segment
    confidence: float
    is_set_apart: bool = False
    base: Vector = (0.0, 0.0, 0.0)
    rests_before: tuple[ProgramSegment, ...] = ()
    rests_after: tuple[ProgramSegment, ...] = ()
    approach: tuple[ProgramSegment, ...] = ()

    @property
    def parts(self) -> tuple[ProgramSegment, ...]:
        """It, what it is the end of, and the rests at its ends, in time order."""
        return (*self.rests_before, *self.approach, self, *self.rests_after)

    @property
    def t0(self) -> float:
        """When it begins with its rests [s]."""
        return self.parts[0].segment.t0

    @property
    def tn(self) -> float:
        """When it ends with its rests [s]."""
        return self.parts[-1].segment.tn

    def joined_to(self, before: ProgramSegment) -> ProgramSegment:
        """It with the segment that it goes on from: one segment, with the average load of both."""
        first, last = before.segment, self.segment
        whole = {"t0": first.t0, "position_start": first.position_start}
        weighed = [step for step in (before, self) if step.segment.load_kg is not None]
        load = {name: average(weighed, name) for name in ("load_kg", "load_sd_kg")} if weighed else {}
        approach = (*before.parts, *self.approach)
        return replace(self, approach=approach, segment=last.model_copy(update=whole | load))

    def read_as(self, contact: str, **fields: object) -> ProgramSegment:
        """The same movement or rest, touching, carrying or neither; what an operator has named stays."""
        if self.segment.corrected:
            return self
        kind = "turning" if self.segment.kind == "turning" else KINDS[self.segment.motion, contact]
        read: dict[str, object] = {"kind": kind, "contact": contact, "load_kg": None, "load_sd_kg": None}
        return replace(self, segment=self.segment.model_copy(update=read | fields))

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return self.segment.tn - self.segment.t0

    def lasts(self, least_s: float) -> bool:
        """Does it last for so long [s]? Three observations are 0.3 s, whatever their times are rounded to."""
        return self.seconds >= least_s - ROUNDED_S

    @property
    def touches(self) -> bool:
        """Is it in contact?"""
        return self.segment.contact == "contact"

    @property
    def force(self) -> Vector:
        """[N] that the contact adds to what was there before it."""
        (x, y, z), (a, b, c) = self.segment.force, self.base
        return x - a, y - b, z - c

    @property
    def moved(self) -> NDArray[np.float64]:
        """(3,) [m] from its beginning to its end."""
        return np.subtract(self.segment.position_end, self.segment.position_start)

    @property
    def pushed_in(self) -> float:
        """[m] by which it goes against the force that acts on the robot."""
        return -float(self.moved @ direction(self.force))

    @property
    def gives_way(self) -> bool:
        """Does what is touched move with the force, as a pump does, rather than the hand along a surface?"""
        along = direction(self.force)
        across = length(self.moved - along * float(along @ self.moved))
        return across < max(ACROSS_M, ACROSS_SHARE * abs(self.pushed_in))

    @property
    def arrives(self) -> bool:
        """Is it a way down that ends in a press without a pause? It has a Move To Contact of its own."""
        return self.segment.kind == "sliding" and self.gives_way and self.pushed_in > ARRIVES_M


def joined_where(
    steps: Sequence[ProgramSegment],
    are_one: Callable[[ProgramSegment, ProgramSegment], bool],
    as_one: Callable[[ProgramSegment, ProgramSegment], ProgramSegment] = lambda one, two: two.joined_to(one),
) -> list[ProgramSegment]:
    """The same steps; where the last one and the next are one, they are made one."""
    joined: list[ProgramSegment] = []
    for step in steps:
        if joined and are_one(joined[-1], step):
            joined[-1] = as_one(joined[-1], step)
        else:
            joined.append(step)
    return joined


def slows_at(ways: Sequence[float] | NDArray[np.float64], place: int, share: float) -> bool:
    """Is the slowest of three steps about a place at most a share of the lesser peak on both sides of it?

    ways: how far each step between two observations leads; place: of the step across a boundary.
    """
    peak = min(max(ways[: place + 1]), max(ways[place:]))
    return bool(min(ways[max(place - 1, 0) : place + 2]) <= share * peak)


def holds(step: ProgramSegment, grips: Sequence[GripperAction]) -> bool | None:
    """Whether the fingers hold something in the middle of it; None where they have not said anything."""
    middle = 0.5 * (step.segment.t0 + step.segment.tn)
    last = max((grip for grip in grips if grip.t <= middle), key=lambda grip: grip.t, default=None)
    return None if last is None else last.kind == "grasp"


def average(steps: Sequence[ProgramSegment], name: Literal["load_kg", "load_sd_kg"]) -> float:
    """[kg] Of a number of segments, weighted by time."""
    weighted: float = sum(step.seconds * (getattr(step.segment, name) or 0.0) for step in steps)
    return weighted / sum(step.seconds for step in steps)


def observed(begin: float, end: float) -> list[float]:
    """[s] Every observation between two boundaries, one at least; what lies at the end itself is left out."""
    count = max(round((end - begin - ROUNDED_S) / OBSERVED_S), 1)
    return [begin + TOUCHED_S + k * OBSERVED_S for k in range(count)]


def length(vector: Sequence[float] | NDArray[np.float64]) -> float:
    """Of a vector, in its unit."""
    return math.hypot(*vector)


def direction(vector: Vector) -> NDArray[np.float64]:
    """(3,) Of length 1; 0 of a vector without a length."""
    return np.asarray(vector) / max(length(vector), 1e-12)

"""A segment with the data for its app, and the context of a demonstration: robot states, gripper actions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from operator import mul
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Joints, Quaternion, Segment, Vector
from caesura_protocol.rotations import matrix_of, upright_rotation
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY, TARED_BIAS_N

OBSERVED_S, TOUCHED_S = 0.1, 0.05  # from one observation to the next; from a boundary, which lies midway
ROUNDED_S = 1e-6
UNLIKE_N = 2.0 * TARED_BIAS_N  # by which two forces differ, whatever the bias did between them
PUSHES_BACK_N = 3.0  # what is touched; below it is what a sensor makes up
STOPS_SHARE = 0.2  # of the lesser of the peaks of speed on both sides, up to which a movement or a turn stops
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
ACROSS_M, ACROSS_SHARE = 0.015, 1.0  # a stroke along a surface is longer than this, and pushes nothing in
ENDS = 3  # observations at each end of a way, of which the median is the force there
GRIP_SLACK_S = 0.3  # a grip this close to a contact belongs to it
BASE_AXES = np.eye(3)
BASE_AXES.flags.writeable = False
SPAN = ("t0", "tn", "position_start", "position_end")  # fields of a segment that a part has of its own
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
    """The robot's state at one time, base frame."""

    position: Vector  # [m]
    orientation: Quaternion | None  # x y z w
    joints: Joints | None  # [rad]
    gripper_width: float | None  # [m]
    force: Vector | None = None  # [N] on the robot

    @cached_property
    def axes(self) -> NDArray[np.float64]:
        """The tool's axes (3, 3) in the base frame; those of the base without an orientation."""
        return BASE_AXES if self.orientation is None else matrix_of(self.orientation)


MomentAt = Callable[[float], Moment]


def medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the medians (c,) of columns (n, c) of finite numbers, n > 0.

    They equal those of `np.median`, in a third of the time.
    """
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

    @property
    def opens(self) -> bool:
        """Whether the fingers open: at `t` they begin to move. Where they close, they have settled at `t`."""
        return self.kind in ("release", "open")

    def is_near(self, t0: float, tn: float) -> bool:
        """Whether the action lies between two times [s] of a contact, or within `GRIP_SLACK_S` of them."""
        return t0 - GRIP_SLACK_S <= self.t <= tn + GRIP_SLACK_S


@dataclass(frozen=True, slots=True)
class Context:
    """The gripper actions, robot states and vertical direction with which a demonstration's segments are
    interpreted.

    grips: all that are known; up: away from gravity, of length 1, base frame.
    """

    grips: Sequence[GripperAction]
    moment_at: MomentAt
    up: Vector = UP

    def fingers_move(self, t0: float, tn: float) -> bool:
        """Whether the fingers move between two times [s], or within `GRIP_SLACK_S` of them."""
        return any(grip.is_near(t0, tn) for grip in self.grips)

    def median(self, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the median (3,) [N] of forces (n, 3), taken along three axes of which one is vertical."""
        upright = upright_rotation(self.up)
        if upright is None:
            return medians(forces)
        return np.asarray(medians(forces @ upright.T) @ upright)

    def forces(self, times: Sequence[float]) -> NDArray[np.float64]:
        """Return the forces (n, 3) [N] at those of the times [s] at which they are known."""
        seen = (self.moment_at(t).force for t in times)
        return np.array([force for force in seen if force is not None]).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class ProgramSegment:
    """A segment as interpreted for the program, with the segments that are part of it.

    is_set_apart: whether an operator has set its start; base: of a contact, the force [N] before the touch;
    rests_before, rests_after: the rests at the ends of a stroke; approach: the movements into a contact, or
    the stroke, of which this segment is the end; is_resisted: whether a resistance acts on it as it moves.
    """

    index: int
    segment: Segment
    confidence: float
    is_set_apart: bool = False
    base: Vector = (0.0, 0.0, 0.0)
    rests_before: tuple[ProgramSegment, ...] = ()
    rests_after: tuple[ProgramSegment, ...] = ()
    approach: tuple[ProgramSegment, ...] = ()
    is_resisted: bool = False

    @property
    def parts(self) -> tuple[ProgramSegment, ...]:
        """The rests before it, its approach, the segment itself, and the rests after it, in time order."""
        return (*self.rests_before, *self.approach, self, *self.rests_after)

    @property
    def t0(self) -> float:
        """The time [s] at which its first part begins, rests included."""
        return self.parts[0].segment.t0

    @property
    def tn(self) -> float:
        """The time [s] at which its last part ends, rests included."""
        return self.parts[-1].segment.tn

    def joined_to(self, before: ProgramSegment) -> ProgramSegment:
        """Return this segment and the one before it as one, with the average load of both.

        The earlier one becomes part of the approach.
        """
        first, last = before.segment, self.segment
        whole = {"t0": first.t0, "position_start": first.position_start}
        weighed = [step for step in (before, self) if step.segment.load_kg is not None]
        load = {name: average(weighed, name) for name in ("load_kg", "load_sd_kg")} if weighed else {}
        approach = (*before.parts, *self.approach)
        return replace(self, approach=approach, segment=last.model_copy(update=whole | load))

    def read_as(self, contact: str, **fields: object) -> ProgramSegment:
        """Return the same movement or rest with another contact state.

        A segment whose kind an operator has set is unchanged. The load becomes None. fields: other fields of
        the segment.
        """
        if self.segment.corrected:
            return self
        kind = "turning" if self.segment.kind == "turning" else KINDS[self.segment.motion, contact]
        read: dict[str, object] = {"kind": kind, "contact": contact, "load_kg": None, "load_sd_kg": None}
        return replace(self, segment=self.segment.model_copy(update=read | fields))

    @property
    def seconds(self) -> float:
        """The duration [s] of the segment, without its rests."""
        return self.segment.tn - self.segment.t0

    def lasts(self, least_s: float) -> bool:
        """Whether the segment lasts for `least_s` [s] or longer.

        Three observations count as 0.3 s, however their times are rounded.
        """
        return self.seconds >= least_s - ROUNDED_S

    @property
    def touches(self) -> bool:
        """Whether the segment is in contact."""
        return self.segment.contact == "contact"

    @property
    def force(self) -> Vector:
        """The force [N] that the contact adds to its base."""
        (x, y, z), (a, b, c) = self.segment.force, self.base
        return x - a, y - b, z - c

    @property
    def moved(self) -> NDArray[np.float64]:
        """The displacement (3,) [m] from the segment's start to its end."""
        return np.subtract(self.segment.position_end, self.segment.position_start)

    @property
    def moved_m(self) -> float:
        """The distance [m] from the segment's start to its end."""
        return math.dist(self.segment.position_end, self.segment.position_start)

    @property
    def pushed_in(self) -> float:
        """The distance [m] that the segment moves against the force on the robot; negative for a way out."""
        return -float(self.moved @ direction(self.force))

    @property
    def gives_way(self) -> bool:
        """Whether the touched object moves with the force, as a pump does.

        Otherwise the tool slides along it.
        """
        along = direction(self.force)
        across = length(self.moved - along * float(along @ self.moved))
        return across < max(ACROSS_M, ACROSS_SHARE * abs(self.pushed_in))

    @property
    def arrives(self) -> bool:
        """Whether the segment is an approach that ends in a press without a pause.

        Such an approach has a Move To Contact of its own.
        """
        return self.segment.kind == "sliding" and self.gives_way and self.pushed_in > ARRIVES_M


def joined_where(
    steps: Sequence[ProgramSegment],
    are_one: Callable[[ProgramSegment, ProgramSegment], bool],
    as_one: Callable[[ProgramSegment, ProgramSegment], ProgramSegment] = lambda one, two: two.joined_to(one),
) -> list[ProgramSegment]:
    """Return the steps; a step for which `are_one` holds is joined with the step before it.

    are_one: a test of two successive steps; as_one: makes their joint step.
    """
    joined: list[ProgramSegment] = []
    for step in steps:
        if joined and are_one(joined[-1], step):
            joined[-1] = as_one(joined[-1], step)
        else:
            joined.append(step)
    return joined


def slows_at(ways: Sequence[float] | NDArray[np.float64], place: int, share: float) -> bool:
    """Whether a movement slows to a share of the lesser peak on both sides of a place.

    The slowest of the three steps about the place counts. ways: the length of each step between two
    observations; place: the index of the step across a boundary.
    """
    peak = min(max(ways[: place + 1]), max(ways[place:]))
    return bool(min(ways[max(place - 1, 0) : place + 2]) <= share * peak)


def holds(step: ProgramSegment, grips: Sequence[GripperAction]) -> bool | None:
    """Whether the fingers hold something in the middle of a step; None where no grip precedes it."""
    middle = 0.5 * (step.segment.t0 + step.segment.tn)
    last = max((grip for grip in grips if grip.t <= middle), key=lambda grip: grip.t, default=None)
    return None if last is None else last.kind == "grasp"


def average(steps: Sequence[ProgramSegment], name: Literal["load_kg", "load_sd_kg"]) -> float:
    """Return the average [kg] of a load field over segments, weighted by time; None counts as 0.

    A segment that begins at the last observation has no duration yet, and counts for `ROUNDED_S`.
    """
    seconds = [max(step.seconds, ROUNDED_S) for step in steps]
    loads = [getattr(step.segment, name) or 0.0 for step in steps]
    weighted: float = sum(map(mul, seconds, loads))
    return weighted / sum(seconds)


def parts_at(step: ProgramSegment, times: Sequence[float], moment_at: MomentAt) -> list[ProgramSegment]:
    """Return the parts of a step between times [s] inside of it."""
    first = step.segment
    ends = [(first.t0, first.position_start), *((t, moment_at(t).position) for t in times)]
    spans = pairwise([*ends, (first.tn, first.position_end)])
    return [
        replace(step, segment=first.model_copy(update=dict(zip(SPAN, (t0, tn, here, there), strict=True))))
        for (t0, here), (tn, there) in spans
    ]


def divided_at(step: ProgramSegment, t: float, moment_at: MomentAt) -> tuple[ProgramSegment, ProgramSegment]:
    """Return the parts of a contact before and after a time [s] in it, the second with its own force."""
    before, after = parts_at(step, [t], moment_at)
    later = [force for at in observed(t, step.segment.tn) if (force := moment_at(at).force) is not None]
    held = {"force_held": tuple(medians(np.array(later)).tolist())} if later else {}
    return before, replace(after, segment=after.segment.model_copy(update=held), rests_before=(), approach=())


def carried_weight(segment: Segment, context: Context) -> NDArray[np.float64]:
    """Return the force (3,) [N] with which the load of a segment pulls on the robot; 0 without a load."""
    weight: NDArray[np.float64] = -GRAVITY * (segment.load_kg or 0.0) * np.array(context.up)
    return weight


def way_and_forces(step: ProgramSegment, context: Context) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the positions (n, 3) [m] and forces (n, 3) [N] on the way of a step.

    The forces are (0, 3) if one of them is unknown.
    """
    times = observed(step.segment.t0, step.segment.tn)
    places, forces = np.array([context.moment_at(t).position for t in times]), context.forces(times)
    return places, forces if len(forces) == len(times) else forces[:0]


def observed(begin: float, end: float) -> list[float]:
    """Return the times [s] of the observations between two boundaries, at least one; `end` is left out."""
    count = max(round((end - begin - ROUNDED_S) / OBSERVED_S), 1)
    return [begin + TOUCHED_S + k * OBSERVED_S for k in range(count)]


def length(vector: Sequence[float] | NDArray[np.float64]) -> float:
    """Return the length of a vector, in its unit."""
    return math.hypot(*vector)


def direction(vector: Vector | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction (3,) of a vector, of length 1; zeros for a vector of length 0."""
    return np.asarray(vector) / max(length(vector), 1e-12)

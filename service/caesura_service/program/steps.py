"""Which segments a program is made of, and what each is taken for beside what came before it.

A segment is judged by itself. Here it is seen that
- what is shorter than the minimum time is nothing, nor is the force of a contact that decays;
- a contact changes the force: what begins without a change goes on as what came before it. A sensor drifts
  by newtons within a recording, and a press is what is added to that;
- what the fingers have let go is not carried, what they hold is, and so is what only hangs on the robot;
  a load that rests for less than a second is not held, but on its way;
- a movement far out of what was pressed goes on in the air.
What an operator has named is what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Joints, Quaternion, Segment, Vector

GRAVITY = 9.81
OBSERVED_S, TOUCHED_S = 0.1, 0.05  # from one observation to the next; from a boundary, which lies midway
BASE_S = 1.0  # before a contact, over which the force is what the sensor makes up
PUSHES_BACK_N = 3.0  # what is touched; below it is what a sensor makes up
HANGING_N, HANGING_ASIDE, HANGING_SD_N = 1.5, 0.6, 1.0  # a load's weight, what is aside of it, its error
SURE_SDS = 2.0  # deviations of a load from nothing
HOLD_S = 1.0  # a load is held for so long where it is meant: hesitating takes less
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
ACROSS_M, ACROSS_SHARE = 0.015, 1.0  # a stroke along a surface is longer than this, and pushes nothing in
DECAY_REACH_M = 0.02  # a movement shorter than this, out of a contact, is the contact letting go
KINDS = {
    ("motion", "free"): "motion",
    ("steady", "free"): "steady",
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


@dataclass(frozen=True)
class Grip:
    """A gripper event."""

    t: float  # [s]
    kind: Literal["grasp", "release", "open", "close"]
    width: float | None  # [m] where the fingers settled


@dataclass(frozen=True, slots=True)
class ProgramSegment:
    """A segment as the program sees it. base: of a contact, the force [N] before anything was touched."""

    index: int
    segment: Segment
    confidence: float
    base: Vector = (0.0, 0.0, 0.0)

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return self.segment.tn - self.segment.t0

    @property
    def touches(self) -> bool:
        """Is it in contact?"""
        return self.segment.contact == "contact"

    @property
    def force(self) -> Vector:
        """[N] that the contact adds to what was there before it."""
        (x, y, z), (a, b, c) = self.segment.force, self.base
        return x - a, y - b, z - c


def kept_steps(
    steps: Sequence[ProgramSegment], grips: Sequence[Grip], moment_at: MomentAt, least_s: float
) -> list[ProgramSegment]:
    """Those that apps are made of, as what they are taken for; grips: all that are known."""
    long = [step for step in steps if step.seconds >= least_s]
    kept: list[ProgramSegment] = []
    for before, step in zip([None, *long], long, strict=False):
        if not _lets_go(before, step):
            read = _leaving(_hanging(_in_hand(step, grips), grips))
            read = _as_touching(kept[-1] if kept else None, read, moment_at)
            kept += [] if _pauses(read) else [read]
    return kept


def observed(begin: float, end: float) -> list[float]:
    """[s] Every observation between two boundaries, one at least."""
    count = max(round((end - begin) / OBSERVED_S), 1)
    return [begin + TOUCHED_S + k * OBSERVED_S for k in range(count)]


def pushed_in(segment: Segment) -> float:
    """[m] by which it goes against the force that acts on the robot."""
    moved = np.subtract(segment.position_end, segment.position_start)
    return -float(moved @ np.asarray(segment.force)) / max(length(segment.force), 1e-12)


def gives_way(segment: Segment) -> bool:
    """Does what is touched move with the force, a pump or a button, rather than the hand along a surface?"""
    moved = np.subtract(segment.position_end, segment.position_start)
    along = np.asarray(segment.force) / max(length(segment.force), 1e-12)
    across = length(moved - along * float(along @ moved))
    return across < max(ACROSS_M, ACROSS_SHARE * abs(pushed_in(segment)))


def _hangs(segment: Segment) -> bool:
    """Does its force pull straight down on the robot?"""
    down, aside = -segment.force[2], length(segment.force[:2])
    return down >= HANGING_N and aside <= HANGING_ASIDE * down


def length(vector: Sequence[float] | NDArray[np.float64]) -> float:
    """Of a vector, in its unit."""
    return math.hypot(*vector)


def _as_touching(before: ProgramSegment | None, step: ProgramSegment, moment_at: MomentAt) -> ProgramSegment:
    """A contact, with the force before it; one that begins without a change goes on as what came before."""
    if before is None or not step.touches:
        return step
    if before.touches:
        return replace(step, base=before.base)
    step = replace(step, base=_force_at_end(before.segment, moment_at))
    return step if length(step.force) >= PUSHES_BACK_N else _as(step, before.segment.contact)


def _force_at_end(segment: Segment, moment_at: MomentAt) -> Vector:
    """[N] median of its last second, for its very end may lie in the contact; 0 where there is no force."""
    seen = (moment_at(t).force for t in observed(max(segment.t0, segment.tn - BASE_S), segment.tn))
    forces = [force for force in seen if force is not None] or [(0.0, 0.0, 0.0)]
    x, y, z = map(median, zip(*forces, strict=True))
    return x, y, z


def _in_hand(step: ProgramSegment, grips: Sequence[Grip]) -> ProgramSegment:
    """What the fingers hold is carried, however light; what they have let go is not.

    Where they say nothing, what weighs nothing is not carried.
    """
    segment = step.segment
    if segment.contact == "free" and segment.motion == "motion":
        return _as(step, "transport") if holds(step, grips) else step
    if segment.contact != "transport":
        return step
    carried, kg, sd_kg = holds(step, grips), segment.load_kg, segment.load_sd_kg
    if carried is None:
        carried = kg is None or kg > SURE_SDS * (sd_kg or 0.0)
    return step if carried else _as(step, "free")


def _pauses(step: ProgramSegment) -> bool:
    """Is it but the pause between two carries? Their times keep it, as they keep every other rest."""
    segment = step.segment
    return segment.kind == "hold" and step.seconds < HOLD_S and not segment.corrected


def holds(step: ProgramSegment, grips: Sequence[Grip]) -> bool | None:
    """Whether the fingers hold something in the middle of it; None where they have not said anything."""
    middle = 0.5 * (step.segment.t0 + step.segment.tn)
    last = max((grip for grip in grips if grip.t <= middle), key=lambda grip: grip.t, default=None)
    return None if last is None else last.kind == "grasp"


def _hanging(step: ProgramSegment, grips: Sequence[Grip]) -> ProgramSegment:
    """A movement under a force that hangs on the robot is a carry, and so is a rest with something in hand.

    What a hand slides along pushes back; only a load pulls straight down.
    """
    if not step.touches or not _hangs(step.segment):
        return step
    if step.segment.kind == "contact" and not holds(step, grips):
        return step
    down = -step.segment.force[2]
    return _as(step, "transport", load_kg=down / GRAVITY, load_sd_kg=HANGING_SD_N / GRAVITY)


def _leaving(step: ProgramSegment) -> ProgramSegment:
    """A movement far out of what was pressed goes on in the air: it is no press."""
    segment = step.segment
    leaves = segment.kind == "sliding" and gives_way(segment) and -pushed_in(segment) >= ARRIVES_M
    return _as(step, "free") if leaves else step


def _lets_go(before: ProgramSegment | None, step: ProgramSegment) -> bool:
    """Is this the force of the contact before it, decaying? The arm hardly moves, the force falls off."""
    if before is None or before.segment.kind != "contact" or step.segment.kind != "motion":
        return False
    segment = step.segment
    moved = length(np.subtract(segment.position_end, segment.position_start))
    return moved < DECAY_REACH_M and length(segment.force_end) < length(segment.force_start)


def _as(
    step: ProgramSegment, contact: str, load_kg: float | None = None, load_sd_kg: float | None = None
) -> ProgramSegment:
    """The same movement or rest, touching nothing or carrying something; what an operator has named stays."""
    if step.segment.corrected:
        return step
    kind = KINDS[step.segment.motion, contact]
    read = {"kind": kind, "contact": contact, "load_kg": load_kg, "load_sd_kg": load_sd_kg}
    return replace(step, segment=step.segment.model_copy(update=read))

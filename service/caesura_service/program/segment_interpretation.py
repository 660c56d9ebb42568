"""Which segments a program is made of, and what each is taken for beside what came before it.

A segment is judged by itself. Here it is seen that
- what is shorter than the minimum time is nothing, nor is the force of a contact that decays. But a way in
  the air after it is a movement;
- a contact changes the force: what does not is no contact, and goes on as what came before it. What follows
  a contact and holds its force, without leaving, is still in contact. A sensor drifts by newtons within a
  recording, and a press is what is added to that;
- a rest at either end of a stroke or of a turn in contact is part of it. It has a force of its own where it
  lasts for half a second;
- what is held keeps its weight: where its force changes and stays so, it touches;
- what the fingers have let go is not carried, nor is anything between fingers that are shut, nor what begins
  to weigh in the air. What they hold is, and so is what only hangs on the robot. What stands where it was
  gripped is not held yet;
- a movement far out of what was pressed goes on in the air;
- a short slide or a tilt beside a stroke is an end of it, and the last centimetres before a contact are an
  end of the movement into it.
What an operator has named is what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import dropwhile, groupby, pairwise, takewhile, zip_longest
from statistics import median
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_protocol.messages import Joints, Quaternion, Segment, Vector
from caesura_protocol.rotations import matrix_of
from caesura_service.constants import GRAVITY, TARED_BIAS_N

OBSERVED_S, TOUCHED_S = 0.1, 0.05  # from one observation to the next; from a boundary, which lies midway
ROUNDED_S = 1e-6
BASE_S = 1.0  # before a contact, over which the force is what the sensor makes up
PUSHES_BACK_N = 3.0  # what is touched; below it is what a sensor makes up
LASTING = 5  # observations over which a force is averaged
HANGING_N, HANGING_ASIDE, HANGING_SD_N = 1.5, 0.6, 1.0  # a load's weight, what is aside of it, its error
SURE_SDS = 2.0  # deviations of a load from nothing
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
ACROSS_M, ACROSS_SHARE = 0.015, 1.0  # a stroke along a surface is longer than this, and pushes nothing in
DECAY_REACH_M = 0.02  # a movement shorter than this, out of a contact, is the contact letting go
APPROACH_REST_S = 0.3  # a movement that stands for less before its last centimetres goes on
IN_AIR_M = 0.005  # but for one that goes on for longer than this without the force of the contact
OUT_M, OUT_SHARE = 0.005, 0.3  # from which on a movement leaves a contact; friction tilts a force less
STANDS_S = 1.0  # a load that rests for longer where it was gripped is held there on purpose
INSERTED_M = 0.01  # from which depth on what is pushed in is an app of its own
SAME_SIDE = 0.5  # cosine between two forces; friction tilts that of a stroke, and a bias a weak one
UNLIKE_N = SURE_SDS * TARED_BIAS_N  # by which two forces differ, whatever the bias did between them
PRESS_LOOKS = 100  # observations of a press that are looked at
PRESS_SHARE = 0.7  # of the largest force of a stroke, from which on it is pressed: as of a segment
LEAST_TURN_RAD = 0.1  # a turn by less is a rest: it has no screw motion
TILT_COSINE = 0.7  # of the angle between the tool and the axis of a turn: 45 degrees
STROKE_REST_S = 0.5  # a rest at either end of a stroke that is shorter than this has no force of its own
GRIP_SLACK_S = 0.3  # a grip this close to a contact belongs to it
SHUT_M = 0.003  # between fingers that hold nothing
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
class ProgramSegment:
    """A segment as the program sees it.

    base: of a contact, the force [N] before anything was touched; rests_before, rests_after: of a stroke, as
    parts of it; approach: what it is the end of, as a part of it: movements into a contact, a stroke.
    """

    index: int
    segment: Segment
    confidence: float
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
        return -float(self.moved @ _direction(self.force))

    @property
    def gives_way(self) -> bool:
        """Does what is touched move with the force, as a pump does, rather than the hand along a surface?"""
        along = _direction(self.force)
        across = length(self.moved - along * float(along @ self.moved))
        return across < max(ACROSS_M, ACROSS_SHARE * abs(self.pushed_in))


def kept_steps(
    steps: Sequence[ProgramSegment], grips: Sequence[GripperAction], moment_at: MomentAt, least_s: float
) -> list[ProgramSegment]:
    """Those that apps are made of, as what they are taken for; grips: all that are known."""
    kept: list[ProgramSegment] = []
    before: ProgramSegment | None = None
    touched = -1  # the last step in contact, however short
    for behind, beside, step in zip([None, None, *steps], [None, *steps], steps, strict=False):
        touched = beside.index if beside is not None and beside.touches else touched
        if not step.lasts(least_s):
            continue
        last = kept[-1] if kept else None
        if not _lets_go(before, kept, step, moment_at):
            read = _hanging(_in_hand(step, grips, _from_air(kept, touched), moment_at), grips)
            read = _leaving(_as_touching(last, read, grips, moment_at))
            contact = _contact_before(behind, beside, last, grips)
            if last is not None and not read.touches:
                if contact is not None:
                    read = _still_touching(contact, _base(last, moment_at), read, moment_at)
                elif last.segment.contact == read.segment.contact == "transport":
                    read = _set_down(_base(last, moment_at), read, moment_at)
            kept += [] if _stands(contact or last, read) else [read]
        before = step
    return _with_rests(_with_ends(_with_approaches(kept, grips), grips, moment_at), grips, moment_at)


def stroke_force(stroke: ProgramSegment, moment_at: MomentAt) -> Vector | None:
    """[N] median with which a stroke is pressed; None where nothing pushes back.

    Touching and letting go are left out, as in the force of a segment. The median is taken in the tool's
    axes, because a force turns with the tool along a surface.
    """
    turn, force = _in_tool([stroke], moment_at, PRESS_SHARE)
    return None if force is None else tuple((turn @ force).tolist())


def rest_force_n(rests: Sequence[ProgramSegment], moment_at: MomentAt) -> float | None:
    """[N] median with which rests are pressed; None for less than `STROKE_REST_S`, in which the force rises.

    It is one median over all of them, so it is the same however they are divided.
    """
    if not rests or rests[-1].segment.tn - rests[0].segment.t0 < STROKE_REST_S - ROUNDED_S:
        return None
    _, force = _in_tool(rests, moment_at)
    return None if force is None else length(force)


def _in_tool(
    steps: Sequence[ProgramSegment], moment_at: MomentAt, share: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """The tool's axes (3, 3) halfway, and the median force (3,) [N] in them while something pushes back.

    share: of the force that a tenth of the time exceeds; what is pressed softer is left out.
    """
    seen = [(moment_at(t), step.base) for step in steps for t in _looks(step.segment)]
    known = [(moment, np.subtract(moment.force, base)) for moment, base in seen if moment.force is not None]
    most_n = float(np.quantile([length(force) for _, force in known], 0.9)) if known else 0.0
    least_n = max(share * most_n, PUSHES_BACK_N)
    pressed = [(_axes(moment), force) for moment, force in known if length(force) >= least_n]
    if not pressed:
        return np.eye(3), None
    return pressed[len(pressed) // 2][0], np.median([force @ turn for turn, force in pressed], axis=0)


def _looks(segment: Segment) -> list[float]:
    """[s] Observations of a segment, of more than `PRESS_LOOKS` evenly some."""
    times = observed(segment.t0, segment.tn)
    return times[:: -(-len(times) // PRESS_LOOKS)]


def _axes(moment: Moment) -> NDArray[np.float64]:
    """(3, 3) The tool's axes in the base frame; those of the base where they are not known."""
    return np.eye(3) if moment.orientation is None else matrix_of(moment.orientation)


def observed(begin: float, end: float) -> list[float]:
    """[s] Every observation between two boundaries, one at least."""
    count = max(round((end - begin) / OBSERVED_S), 1)
    return [begin + TOUCHED_S + k * OBSERVED_S for k in range(count)]


def _hangs(segment: Segment) -> bool:
    """Does its force pull straight down on the robot?"""
    down, aside = -segment.force[2], length(segment.force[:2])
    return down >= HANGING_N and aside <= HANGING_ASIDE * down


def length(vector: Sequence[float] | NDArray[np.float64]) -> float:
    """Of a vector, in its unit."""
    return math.hypot(*vector)


def _as_touching(
    before: ProgramSegment | None, step: ProgramSegment, grips: Sequence[GripperAction], moment_at: MomentAt
) -> ProgramSegment:
    """A contact, with the force before it; what does not change that goes on as what came before."""
    if before is None or not step.touches:
        return step
    step = replace(step, base=_base(before, moment_at))
    if length(step.force) >= PUSHES_BACK_N or (before.touches and step.segment.motion == "steady"):
        return step
    if before.touches:
        return _as(step, "transport" if holds(step, grips) else "free")
    return _as(step, before.segment.contact)


def _base(before: ProgramSegment, moment_at: MomentAt) -> Vector:
    """[N] before the contact that a step belongs to, or that follows it."""
    return before.base if before.touches else _force_at_end(before.segment, moment_at)


def _contact_before(
    behind: ProgramSegment | None,
    beside: ProgramSegment | None,
    last: ProgramSegment | None,
    grips: Sequence[GripperAction],
) -> ProgramSegment | None:
    """The contact that a step follows directly, or with one step between that was read as a contact itself.

    With something between the fingers there may be more of them: what it weighs is known.
    behind, beside: the last but one and the last step before it, however short; last: the last one kept.
    """
    if beside is None or beside.touches:
        return beside
    read = last is not None and last.touches and last.index == beside.index
    known = (behind is not None and behind.touches) or holds(beside, grips)
    return last if read and known else None


def _still_touching(
    contact: ProgramSegment, base: Vector, step: ProgramSegment, moment_at: MomentAt
) -> ProgramSegment:
    """What follows a contact is one too, where its force above a base lasts and the tool does not leave."""
    return _touching(_direction(replace(contact, base=base).force), PUSHES_BACK_N, base, step, moment_at)


def _set_down(base: Vector, step: ProgramSegment, moment_at: MomentAt) -> ProgramSegment:
    """A load keeps its weight: where its force changes by more than a bias can and stays so, it touches."""
    forces = _forces(observed(step.segment.t0, step.segment.tn), moment_at)
    changed = np.median(forces, axis=0) - base if len(forces) else np.zeros(3)
    return _touching(changed / max(length(changed), 1e-12), UNLIKE_N, base, step, moment_at)


def _touching(
    normal: NDArray[np.float64], least_n: float, base: Vector, step: ProgramSegment, moment_at: MomentAt
) -> ProgramSegment:
    """A step as a contact, where its force along a normal stays above a base and the tool does not leave."""
    forces = _forces(observed(step.segment.t0, step.segment.tn), moment_at)
    leaves = float(step.moved @ normal) > max(OUT_M, OUT_SHARE * length(step.moved))
    if leaves or not len(forces) or _least_lasting((forces - base) @ normal) < least_n:
        return step
    held: tuple[float, ...] = tuple(np.median(forces, axis=0).tolist())
    return replace(_as(step, "contact", force_held=held), base=base)


def _least_lasting(pushes: NDArray[np.float64]) -> float:
    """[N] the least mean over `LASTING` observations: one of them is as good as the sensor's noise."""
    return float(sliding_window_view(pushes, min(LASTING, len(pushes))).mean(axis=1).min())


def _stands(last: ProgramSegment | None, step: ProgramSegment) -> bool:
    """Is it a load that seems to be held, but stands where the contact before it was?"""
    segment = step.segment
    if last is None or not last.touches or segment.kind != "hold" or segment.corrected:
        return False
    if step.lasts(STANDS_S):
        return False
    return length(np.subtract(segment.position_end, last.segment.position_end)) < OUT_M


def _with_approaches(steps: Sequence[ProgramSegment], grips: Sequence[GripperAction]) -> list[ProgramSegment]:
    """The same steps; the last centimetres before a contact are part of the movement that they go on from."""
    joined: list[ProgramSegment] = []
    for place, step in enumerate(steps):
        touched = place + 1 < len(steps) and steps[place + 1].touches
        last = joined[-1] if joined else None
        if last is None or not touched or not _ends(last, step) or _fingers_move(last.tn, step, grips):
            joined.append(step)
            continue
        whole = {"t0": last.segment.t0, "position_start": last.segment.position_start}
        joined[-1] = replace(step, approach=(*last.parts,), segment=step.segment.model_copy(update=whole))
    return joined


def _ends(movement: ProgramSegment, step: ProgramSegment) -> bool:
    """Is a step the last of a movement: short, of the same kind, and without a rest between the two?"""
    one, other = movement.segment, step.segment
    same = other.kind in ("motion", "transport") and one.kind == other.kind and one.contact == other.contact
    at_once = other.t0 - one.tn < APPROACH_REST_S - ROUNDED_S and _goes_on(movement, step)
    return same and at_once and not other.corrected and may_end_movement(step)


def may_end_movement(step: ProgramSegment) -> bool:
    """Is a movement so short that it is the end of the one before it, where a contact follows?"""
    return length(step.moved) < DECAY_REACH_M


def _fingers_move(since: float, step: ProgramSegment, grips: Sequence[GripperAction]) -> bool:
    return any(grip.is_near(since, step.segment.t0) for grip in grips)


def _with_rests(
    steps: Sequence[ProgramSegment], grips: Sequence[GripperAction], moment_at: MomentAt
) -> list[ProgramSegment]:
    """The same steps, each stroke with the rests at its ends; those between two strokes end the first."""
    joined: list[ProgramSegment] = []
    begins: tuple[ProgramSegment, ...] = ()
    runs = [(rests, tuple(run)) for rests, run in groupby(steps, key=lambda step: _rests(step, grips))]
    for (rests, run), (_, following) in zip_longest(runs, runs[1:], fillvalue=(False, ())):
        last = joined[-1] if joined else None
        pressed = last is not None and last.touches and not _is_stroke(last)
        if rests and last is not None and _goes_on(last, run[0]) and _belong(run, last, moment_at):
            joined[-1] = replace(last, rests_after=run)
        elif rests and _leads_to(run, following, moment_at) and not pressed:
            begins = run
        else:
            joined += (replace(run[0], rests_before=begins), *run[1:])
            begins = ()
    return joined


def _rests(step: ProgramSegment, grips: Sequence[GripperAction]) -> bool:
    """Does it rest in contact, but for what the touch pushes in, while the fingers stay as they are?"""
    segment = step.segment
    pushes = segment.kind == "sliding" and step.gives_way and length(step.moved) < INSERTED_M
    still = segment.turn is not None and length(segment.turn) < LEAST_TURN_RAD
    stands = segment.kind == "turning" and step.touches and still and length(step.moved) < INSERTED_M
    if segment.corrected or not (segment.kind == "contact" or pushes or stands):
        return False
    return not any(grip.is_near(segment.t0, segment.tn) for grip in grips)


def _belong(rests: Sequence[ProgramSegment], stroke: ProgramSegment, moment_at: MomentAt) -> bool:
    """Is a step a stroke, and are rests beside it pressed to the same side of the tool?"""
    if not _is_stroke(stroke):
        return False
    (_, here), (_, there) = _in_tool(rests, moment_at), _in_tool([stroke], moment_at)
    return here is None or there is None or float(here @ there) >= SAME_SIDE * length(here) * length(there)


def _leads_to(
    rests: Sequence[ProgramSegment], following: Sequence[ProgramSegment], moment_at: MomentAt
) -> bool:
    """Are rests part of the stroke that follows, if one does?"""
    return bool(following) and _goes_on(rests[-1], following[0]) and _belong(rests, following[0], moment_at)


def _with_ends(
    steps: Sequence[ProgramSegment], grips: Sequence[GripperAction], moment_at: MomentAt
) -> list[ProgramSegment]:
    """The same steps; short slides and tilts beside a stroke are ends of it, with one path.

    Whether such an end is divided from its stroke is a close decision: a person and a robot differ in it.
    """
    joined: list[ProgramSegment] = []
    for step in steps:
        ends = _is_end(step, grips, moment_at)
        rests = _length_of(joined, lambda one: _rests(one, grips))
        lead = _length_of(joined, lambda one: _rests(one, grips) or _is_end(one, grips, moment_at))
        before = joined[-rests - 1] if rests < len(joined) else None
        parts: list[ProgramSegment] = []
        if (
            ends
            and before is not None
            and _has_ends(before, moment_at)
            and not _is_end(before, grips, moment_at)
        ):
            parts = [*joined[len(joined) - rests - 1 :], step]
        elif not ends and _has_ends(step, moment_at):
            parts = [*dropwhile(lambda one: _rests(one, grips), joined[len(joined) - lead :]), step]
        if len(parts) > 1 and all(_stays(one, other) for one, other in pairwise(parts)):
            joined[len(joined) - len(parts) + 1 :] = [_one_way(parts)]
        else:
            joined.append(step)
    return joined


def _length_of(steps: Sequence[ProgramSegment], belongs: Callable[[ProgramSegment], bool]) -> int:
    """How many of the last steps belong to something."""
    return len(list(takewhile(belongs, reversed(steps))))


def _one_way(parts: Sequence[ProgramSegment]) -> ProgramSegment:
    """A stroke and its ends as one way in contact; rests between them are part of it."""
    first, last = parts[0], parts[-1]
    whole = {
        "kind": "turning",
        "turn": None,
        "screw": None,
        "t0": first.segment.t0,
        "position_start": first.segment.position_start,
    }
    before = tuple(one for part in parts[:-1] for one in part.parts)
    return replace(last, segment=last.segment.model_copy(update=whole), approach=(*before, *last.approach))


def _is_end(step: ProgramSegment, grips: Sequence[GripperAction], moment_at: MomentAt) -> bool:
    """Is it a tilt in contact, or a slide so short that it is the end of a stroke?"""
    segment = step.segment
    if segment.corrected or any(grip.is_near(segment.t0, segment.tn) for grip in grips):
        return False
    slides = segment.kind == "sliding" and not _rests(step, grips) and abs(step.pushed_in) < INSERTED_M
    return (slides and length(step.moved) < DECAY_REACH_M) or _is_tilt(step, moment_at)


def _has_ends(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Is it a stroke other than a screw that is driven?"""
    segment = step.segment
    driven = segment.kind == "turning" and segment.turn is not None and not _is_tilt(step, moment_at)
    return _is_stroke(step) and not segment.corrected and not driven


def _stays(one: ProgramSegment, following: ProgramSegment) -> bool:
    """Does the tool stay in contact from one step to the next? What is left out between them is short."""
    return _goes_on(one, following) or following.segment.t0 - one.segment.tn < APPROACH_REST_S - ROUNDED_S


def _is_tilt(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Does it turn in contact about an axis across the tool? A screw is driven about the tool."""
    segment, orientation = step.segment, moment_at(step.segment.tn).orientation
    if segment.kind != "turning" or not step.touches or segment.corrected:
        return False
    if segment.turn is None or orientation is None:
        return False
    return abs(float(matrix_of(orientation)[:, 2] @ segment.turn)) < TILT_COSINE * length(segment.turn)


def _goes_on(one: ProgramSegment, following: ProgramSegment) -> bool:
    """Does a step begin where another one ends? What is left out between them may lead elsewhere."""
    apart = np.subtract(following.segment.position_start, one.segment.position_end)
    return following.parts[0].index == one.parts[-1].index + 1 or length(apart) < OUT_M


def _is_stroke(step: ProgramSegment) -> bool:
    """Does it move along a surface, or turn in contact? What gives way is pressed in."""
    segment = step.segment
    moves = step.touches and segment.motion == "motion"
    return moves and (segment.kind == "turning" or not step.gives_way)


def _force_at_end(segment: Segment, moment_at: MomentAt) -> Vector:
    """[N] median of its last second, for its very end may lie in the contact; 0 where there is no force."""
    forces = _forces(observed(max(segment.t0, segment.tn - BASE_S), segment.tn), moment_at)
    x, y, z = map(median, forces.T.tolist()) if len(forces) else (0.0, 0.0, 0.0)
    return x, y, z


def _forces(times: Sequence[float], moment_at: MomentAt) -> NDArray[np.float64]:
    """(n, 3) [N] at some times [s], where they are known."""
    seen = (moment_at(t).force for t in times)
    return np.array([force for force in seen if force is not None]).reshape(-1, 3)


def _direction(vector: Vector) -> NDArray[np.float64]:
    return np.asarray(vector) / max(length(vector), 1e-12)


def _from_air(kept: Sequence[ProgramSegment], touched: int) -> bool:
    """Did the last movement carry nothing, and was nothing touched since? Then nothing was picked up.

    touched: index of the last step in contact.
    """
    moved = (step for step in reversed(kept) if step.touches or step.segment.motion == "motion")
    last = next(moved, None)
    return last is not None and last.segment.contact == "free" and touched < last.index


def _in_hand(
    step: ProgramSegment, grips: Sequence[GripperAction], from_air: bool, moment_at: MomentAt
) -> ProgramSegment:
    """What the fingers hold is carried, however light; what they have let go is not, nor while they are shut.

    Where they say nothing, what weighs nothing is not carried, nor what was not picked up.
    """
    segment = step.segment
    if segment.contact == "free":
        return _as(step, "transport") if holds(step, grips) else step
    if segment.contact != "transport":
        return step
    carried, kg, sd_kg = holds(step, grips), segment.load_kg, segment.load_sd_kg
    if carried is None:
        width_m = moment_at(0.5 * (segment.t0 + segment.tn)).gripper_width
        carried = False if from_air or (width_m is not None and width_m <= SHUT_M) else None
    if carried is None:
        carried = kg is None or kg > SURE_SDS * (sd_kg or 0.0)
    return step if carried else _as(step, "free")


def holds(step: ProgramSegment, grips: Sequence[GripperAction]) -> bool | None:
    """Whether the fingers hold something in the middle of it; None where they have not said anything."""
    middle = 0.5 * (step.segment.t0 + step.segment.tn)
    last = max((grip for grip in grips if grip.t <= middle), key=lambda grip: grip.t, default=None)
    return None if last is None else last.kind == "grasp"


def _hanging(step: ProgramSegment, grips: Sequence[GripperAction]) -> ProgramSegment:
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
    leaves = segment.kind == "sliding" and step.gives_way and -step.pushed_in >= ARRIVES_M
    return _as(step, "free") if leaves else step


def _lets_go(
    before: ProgramSegment | None, kept: Sequence[ProgramSegment], step: ProgramSegment, moment_at: MomentAt
) -> bool:
    """Is this the force of the contact before it, decaying? The arm hardly moves, the force falls off.

    What goes on without that force is a movement, once it is out of what was pressed in.
    """
    if before is None or before.segment.kind != "contact" or step.segment.kind != "motion":
        return False
    segment = step.segment
    if length(step.moved) >= DECAY_REACH_M or length(segment.force_end) >= length(segment.force_start):
        return False
    contact = list(takewhile(lambda one: one.touches, reversed(kept)))
    if not contact:
        return True
    normal = _direction(contact[0].force)
    if np.subtract(segment.position_end, _touched_at(contact[-1], moment_at)) @ normal <= 0.0:
        return True
    presses = list(filter(pushes_back(contact[0], moment_at), observed(segment.t0, segment.tn)))
    gone = moment_at(presses[-1]).position if presses else segment.position_start
    return length(np.subtract(segment.position_end, gone)) < IN_AIR_M


def _touched_at(contact: ProgramSegment, moment_at: MomentAt) -> Vector:
    """Where [m] a contact first pushes back: its segment may begin on the way down to it."""
    times = observed(contact.segment.t0, contact.segment.tn)
    t = next(filter(pushes_back(contact, moment_at), times), None)
    return contact.segment.position_start if t is None else moment_at(t).position


def pushes_back(contact: ProgramSegment, moment_at: MomentAt) -> Callable[[float], bool]:
    """Whether what a contact touches pushes back at a time [s], in the direction of its force."""
    base, normal = contact.base, _direction(contact.force)
    return lambda t: _along(moment_at(t).force, base, normal) >= PUSHES_BACK_N


def _along(force: Vector | None, base: Vector, normal: NDArray[np.float64]) -> float:
    """[N] of what is added to a base, in a direction; 0 where it is not known."""
    return 0.0 if force is None else float(np.subtract(force, base) @ normal)


def _as(
    step: ProgramSegment,
    contact: str,
    load_kg: float | None = None,
    load_sd_kg: float | None = None,
    force_held: tuple[float, ...] | None = None,
) -> ProgramSegment:
    """The same movement or rest, touching, carrying or neither; what an operator has named stays."""
    if step.segment.corrected:
        return step
    kind = "turning" if step.segment.kind == "turning" else KINDS[step.segment.motion, contact]
    read: dict[str, object] = {"kind": kind, "contact": contact, "load_kg": load_kg, "load_sd_kg": load_sd_kg}
    if force_held is not None:
        read["force_held"] = force_held
    return replace(step, segment=step.segment.model_copy(update=read))

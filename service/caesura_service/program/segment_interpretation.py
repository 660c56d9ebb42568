"""Which segments a program is made of, and what each is taken for beside what came before it.

A segment is judged by itself. Here it is seen that
- what is shorter than the minimum time is nothing, nor is the force of a contact that decays. But a way in
  the air after it is a movement, and a short movement is part of the one that it goes on to, or comes from;
- a contact changes the force: what does not is no contact, and goes on as what came before it. What follows
  a contact and holds its force, without leaving, is still in contact. A sensor drifts by newtons within a
  recording, and a press is what is added to that;
- what is held keeps its weight: where its force changes and stays so, it touches. So does a movement before a
  contact that is pushed back all the way;
- what the fingers have let go is not carried, nor is anything between fingers that are shut, nor what begins
  to weigh in the air. What they hold is, and so is what only hangs on the robot. What stands where it was
  gripped is not held yet;
- a movement far out of what was pressed goes on in the air;
- a carry, or a turn in the air, that leads nowhere is a rest.
What an operator has named is what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby, takewhile
from statistics import median

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_protocol.messages import Segment, Vector
from caesura_protocol.rotations import angle_between
from caesura_service.constants import GRAVITY, TARED_BIAS_N
from caesura_service.program.program_segment import (
    ACROSS_M,
    OBSERVED_S,
    PUSHES_BACK_N,
    ROUNDED_S,
    UNLIKE_N,
    GripperAction,
    MomentAt,
    ProgramSegment,
    direction,
    holds,
    length,
    observed,
)
from caesura_service.program.sensor_bias import bias_between
from caesura_service.program.strokes import (
    DECAY_REACH_M,
    LEAST_TURN_RAD,
    NOWHERE_M,
    OUT_M,
    OUT_SHARE,
    are_one_kind,
    is_directly_before,
    with_ends,
    with_last_ways,
    with_rests,
    with_whole_turns,
)

BASE_S = 1.0  # before a contact, over which the force is what the sensor makes up
LASTING = 5  # observations over which a force is averaged
HANGING_N, HANGING_ASIDE, HANGING_SD_N = 1.5, 0.6, 1.0  # a load's weight, what is aside of it, its error
SURE_SDS = 2.0  # deviations of a load from nothing
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
MOST_WANDER_N = 3.0 * TARED_BIAS_N  # of what a sensor makes up, from before a contact to after it
NOWHERE_RAD = math.radians(3.0)  # of a turn in the air: a check names what is more
IN_AIR_M = 0.005  # a contact that lets go does not go on for longer than this without its force
STANDS_S = 1.0  # a load that rests for longer where it was gripped is held there on purpose
SHUT_M = 0.003  # between fingers that hold nothing
KINDS = {
    ("motion", "free"): "motion",
    ("steady", "free"): "steady",
    ("motion", "contact"): "sliding",
    ("steady", "contact"): "contact",
    ("motion", "transport"): "transport",
    ("steady", "transport"): "hold",
}


def kept_steps(
    steps: Sequence[ProgramSegment], grips: Sequence[GripperAction], moment_at: MomentAt, least_s: float
) -> list[ProgramSegment]:
    """Those that apps are made of, as what they are taken for; grips: all that are known."""
    kept: list[ProgramSegment] = []
    before: ProgramSegment | None = None
    earlier: ProgramSegment | None = None  # the one before that: both last for the minimum time
    touched = -1  # the last step in contact, however short
    short: dict[int, tuple[ProgramSegment, ...]] = {}
    around = zip([None, None, *steps], [None, *steps], steps, [*steps[1:], None], strict=False)
    for behind, beside, step, ahead in around:
        touched = beside.index if beside is not None and beside.touches else touched
        in_hand = _in_hand(step, grips, _from_air(kept, touched), moment_at)
        if not step.lasts(least_s):
            short[step.index] = (in_hand,) if holds(step, grips) is not None else (in_hand, step)
            continue
        last = kept[-1] if kept else None
        if not _lets_go(before, kept, step, moment_at):
            read = _hanging(in_hand, grips)
            read = _resting(_leaving(_as_touching(last, read, grips, moment_at)), grips, moment_at)
            contact = _contact_before(behind, beside, earlier, last, grips, least_s)
            if last is not None and not read.touches:
                if contact is not None:
                    read = _still_touching(contact, _base(last, moment_at), read, moment_at)
                elif last.segment.contact == read.segment.contact and (
                    read.segment.contact == "transport" or _arrives_at(read, ahead)
                ):
                    read = _set_down(_base(last, moment_at), read, moment_at)
            kept += [] if _stands(contact or last, read) else [read]
        earlier, before = before, step
    based = _with_short_movements(_with_bases(_as_one_hold(kept), grips, moment_at), short)
    movements = _with_departures(with_last_ways(based, grips), moment_at)
    strokes = with_ends(with_whole_turns(movements, moment_at), grips, moment_at)
    return with_rests(strokes, grips, moment_at)


def _with_short_movements(
    kept: Sequence[ProgramSegment], short: dict[int, tuple[ProgramSegment, ...]]
) -> list[ProgramSegment]:
    """The kept steps; movements below the minimum time are parts of those of their kind beside them.

    One between two such movements belongs to the second. short: by index, as what such a step may be taken
    for: too short to be weighed, it is a carry or none where the fingers say nothing.
    """
    joined: list[ProgramSegment] = []
    for step in kept:
        whole = step
        while before := _taken_with(whole, short, whole.parts[0].index - 1):
            whole = whole.joined_to(before)
        joined.append(whole)
    for place, step in enumerate(joined):
        whole = step
        while after := _taken_with(whole, short, whole.index + 1):
            whole = after.joined_to(whole)
        joined[place] = whole
    return joined


def _taken_with(
    movement: ProgramSegment, short: dict[int, tuple[ProgramSegment, ...]], index: int
) -> ProgramSegment | None:
    """Take out a short step that a movement meets, as one of its kind; None where there is none."""
    for step in short.get(index, ()):
        apart_s = min(abs(movement.t0 - step.tn), abs(step.t0 - movement.tn))
        if are_one_kind(step, movement) and apart_s < ROUNDED_S:
            del short[index]
            return step
    return None


def _as_one_hold(kept: Sequence[ProgramSegment]) -> list[ProgramSegment]:
    """The same steps; holds that follow each other at once are one."""
    joined: list[ProgramSegment] = []
    for step in kept:
        last = joined[-1] if joined else None
        holds_on = last is not None and last.segment.kind == step.segment.kind == "hold"
        if last is None or not holds_on or last.segment.corrected or step.segment.corrected:
            joined.append(step)
            continue
        joined[-1] = step.joined_to(last)
    return joined


def _with_departures(steps: Sequence[ProgramSegment], moment_at: MomentAt) -> list[ProgramSegment]:
    """The same steps; what does not leave what was pressed in is part of the movement that it goes on to."""
    joined: list[ProgramSegment] = []
    for step in steps:
        if joined and is_directly_before(joined[-1], step) and _is_inside(joined[-1], joined[:-1], moment_at):
            joined[-1] = step.joined_to(joined[-1])
        else:
            joined.append(step)
    return joined


def _is_inside(movement: ProgramSegment, before: Sequence[ProgramSegment], moment_at: MomentAt) -> bool:
    """Does a movement end below where what gave way before it was touched, and not beside it?"""
    pressed = list(takewhile(lambda step: step.touches and step.gives_way, reversed(before)))
    if not pressed:
        return False
    normal = direction(pressed[0].force)
    out = np.subtract(movement.segment.position_end, _touched_at(pressed[-1], moment_at))
    risen_m = float(out @ normal)
    return risen_m < 0.0 and length(out - risen_m * normal) < ACROSS_M


def _with_bases(
    kept: Sequence[ProgramSegment], grips: Sequence[GripperAction], moment_at: MomentAt
) -> list[ProgramSegment]:
    """The same steps; of contacts, the force that the sensor makes up is read on both sides of them.

    Where the fingers move, or more has changed than a sensor makes up, something else did change it.
    """
    based: list[ProgramSegment] = []
    for touches, run in groupby(kept, key=lambda step: step.touches):
        steps, place = list(run), len(based)
        based += steps
        if not touches or place == 0 or len(based) == len(kept):
            continue
        before, after = kept[place - 1].segment, kept[len(based)].segment
        changed = np.subtract(_force_at_start(after, moment_at), steps[0].base)
        if before.contact != after.contact or length(changed) >= MOST_WANDER_N:
            continue
        if any(grip.is_near(before.tn, after.t0) for grip in grips):
            continue
        bias = bias_between(before, after, steps[0].base, moment_at)
        for k, step in enumerate(steps, start=place):
            based[k] = replace(step, base=bias(0.5 * (step.segment.t0 + step.segment.tn)))
    return based


def _hangs(segment: Segment) -> bool:
    """Does its force pull straight down on the robot?"""
    down, aside = -segment.force[2], length(segment.force[:2])
    return down >= HANGING_N and aside <= HANGING_ASIDE * down


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
    earlier: ProgramSegment | None,
    last: ProgramSegment | None,
    grips: Sequence[GripperAction],
    least_s: float,
) -> ProgramSegment | None:
    """The contact that a step follows directly, or with one step between.

    That one was read as a contact itself, or is shorter than the minimum time [s]. With something between the
    fingers there may be more of them: what it weighs is known.
    behind, beside: the last but one and the last step before it, however short; earlier: the last but one
    that lasts; last: the last one kept.
    """
    if beside is None or beside.touches:
        return beside
    if not beside.lasts(least_s) and behind is not None and behind.touches:
        return behind
    read = last is not None and last.touches and last.index == beside.index
    after_contact = any(one is not None and one.touches for one in (behind, earlier))
    return last if read and (after_contact or holds(beside, grips)) else None


def _still_touching(
    contact: ProgramSegment, base: Vector, step: ProgramSegment, moment_at: MomentAt
) -> ProgramSegment:
    """What follows a contact is one too, where its force above a base lasts and the tool does not leave."""
    return _touching(direction(replace(contact, base=base).force), PUSHES_BACK_N, base, step, moment_at)


def _arrives_at(step: ProgramSegment, ahead: ProgramSegment | None) -> bool:
    """Is it a short movement with nothing in hand, directly before a contact?"""
    return step.segment.kind == "motion" and ahead is not None and ahead.touches and may_press_in(step)


def may_press_in(step: ProgramSegment) -> bool:
    """Is a movement so short that it may press something in? Then it depends on the force before it."""
    return length(step.moved) < ARRIVES_M


def _set_down(base: Vector, step: ProgramSegment, moment_at: MomentAt) -> ProgramSegment:
    """A load keeps its weight, and in the air nothing resists.

    Where the force changes by more than a bias can and stays so, it touches.
    """
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


def _force_at_end(segment: Segment, moment_at: MomentAt) -> Vector:
    """[N] median of its last second, for its very end may lie in the contact; 0 where there is no force."""
    return _free_force(observed(segment.t0, segment.tn)[::-1], moment_at)


def _force_at_start(segment: Segment, moment_at: MomentAt) -> Vector:
    """[N] median of its first second; 0 where there is no force."""
    return _free_force(observed(segment.t0, segment.tn), moment_at)


def _free_force(times: Sequence[float], moment_at: MomentAt) -> Vector:
    """[N] median over `BASE_S`, beginning behind the contact that the first of these times may lie in."""
    looks = round(BASE_S / OBSERVED_S)
    forces = _forces(times[: 2 * looks], moment_at)
    if not len(forces):
        return 0.0, 0.0, 0.0
    apart = np.linalg.norm(forces - np.median(forces, axis=0), axis=1) >= PUSHES_BACK_N
    begun = 0 if apart.all() else int(np.argmin(apart))
    x, y, z = map(median, forces[begun : begun + looks].T.tolist())
    return x, y, z


def _forces(times: Sequence[float], moment_at: MomentAt) -> NDArray[np.float64]:
    """(n, 3) [N] at some times [s], where they are known."""
    seen = (moment_at(t).force for t in times)
    return np.array([force for force in seen if force is not None]).reshape(-1, 3)


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


def _resting(step: ProgramSegment, grips: Sequence[GripperAction], moment_at: MomentAt) -> ProgramSegment:
    """A carry, or a turn in the air, that leads nowhere is a rest: a person and a robot differ in it.

    The path of what the fingers hold is kept; of a turn in the air, only what is less than a check names.
    """
    segment = step.segment
    carried = segment.contact == "transport" and holds(step, grips)
    turned = segment.contact == "free" and segment.kind == "turning"
    if segment.corrected or segment.motion == "steady" or not (carried or turned):
        return step
    seen = [moment_at(t) for t in observed(segment.t0, segment.tn)]
    way = max(length(np.subtract(one.position, seen[0].position)) for one in seen)
    turns = [one.orientation for one in seen if one.orientation is not None]
    most_m, most_rad = (NOWHERE_M, LEAST_TURN_RAD) if carried else (OUT_M, NOWHERE_RAD)
    if way >= most_m or (turns and max(angle_between(one, turns[0]) for one in turns) >= most_rad):
        return step
    kind = KINDS["steady", segment.contact]
    still: dict[str, object] = {"kind": kind, "motion": "steady", "turn": None, "screw": None}
    return replace(step, segment=segment.model_copy(update=still))


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
    normal = direction(contact[0].force)
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
    base, normal = contact.base, direction(contact.force)
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

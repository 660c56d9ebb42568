"""The loads that the robot carries or holds.

- A released object is not carried, nor is anything in closed fingers, nor a weight that appears in the air.
  An object in the fingers is carried, and so is a load that only hangs on the robot.
- An object that still stands where it was gripped is not held yet.
- What has the force with which it is moved up or down next is not supported, whatever the force was before.
- A carry, or a movement in the air, with a negligible displacement is a rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from operator import mul

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_protocol.programs.program_gripper import SHUT_M, SURE_SDS
from caesura_protocol.reproduced_path import TOLERANCE_M, TOLERANCE_RAD
from caesura_protocol.rotations import angle_between
from caesura_service.constants import GRAVITY
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.program.interpretation.joined_strokes import LEAST_TURN_RAD, NOWHERE_M, OUT_M
from caesura_service.program.program_segment import (
    ARRIVES_M,
    KINDS,
    PUSHES_BACK_N,
    ROUNDED_S,
    Context,
    GripperAction,
    ProgramSegment,
    average,
    holds,
    length,
    observed,
    parts_at,
)

HANGING_N, HANGING_ASIDE, HANGING_SD_N = 1.5, 0.6, 1.0  # a load's weight, what is aside of it, its error
KEPT_SHARE = 0.5  # of a weight: what hangs on the robot is then nearer to all of it than to nothing
NOWHERE = {  # how far [m] and by how much [rad] a step leads at least, by kind; of a turn, a check names more
    "transport": (NOWHERE_M, LEAST_TURN_RAD),
    "turning": (OUT_M, math.radians(3.0)),
    "motion": (TOLERANCE_M, TOLERANCE_RAD),
}
WEIGHED_S = 1.0  # in which a load is weighed well: a shorter step may end with a touch
CHANGED_KG, CHANGED_SDS = 0.25, 4.0  # from which on a load is another one; steps of a carry differ by less
STANDS_S = 1.0  # a load that rests for longer where it was gripped is held there on purpose


def divided_at_grips(
    steps: Sequence[ProgramSegment], context: Context, least_s: float
) -> list[ProgramSegment]:
    """Return the steps; a step in the air is divided where the fingers act: before, they held something else.

    A step is whole if an operator has set its kind, if it is a turn, or if none of its parts would last for
    `least_s` [s]. An action near a contact belongs to the contact, and divides no step.
    """
    apart = [grip.t for grip in away_from_contacts(context.grips, steps, least_s)]
    divided: list[ProgramSegment] = []
    for step in steps:
        segment = step.segment
        inside = [t for t in apart if segment.t0 < t < segment.tn]
        whole = not inside or step.touches or segment.corrected or segment.kind == "turning"
        parts = [] if whole else parts_at(step, inside, context.moment_at)
        divided += parts if any(part.lasts(least_s) for part in parts) else [step]
    return divided


def away_from_contacts(
    grips: Sequence[GripperAction], steps: Sequence[ProgramSegment], least_s: float
) -> list[GripperAction]:
    """Return the gripper actions that belong to no contact of `least_s` [s] or longer."""
    contacts = [step.segment for step in steps if step.touches and step.lasts(least_s)]
    return [grip for grip in grips if not any(grip.is_near(one.t0, one.tn) for one in contacts)]


def in_hand(step: ProgramSegment, from_air: bool, context: Context) -> ProgramSegment:
    """Return a step as a carry if the fingers hold something, however light; as free if they do not.

    A contact stays as it is. Without a grip event, a carry is free where nothing was picked up, where the
    fingers are shut, or where its load may be 0. from_air: as `is_from_air`.
    """
    segment = step.segment
    if segment.contact == "free":
        return step.read_as("transport") if holds(step, context.grips) else step
    if segment.contact != "transport":
        return step
    carried, kg, sd_kg = holds(step, context.grips), segment.load_kg, segment.load_sd_kg
    if carried is None:
        width_m = context.moment_at(0.5 * (segment.t0 + segment.tn)).gripper_width
        carried = False if from_air or (width_m is not None and width_m <= SHUT_M) else None
    if carried is None:
        carried = kg is None or kg > SURE_SDS * (sd_kg or 0.0)
    return step if carried else step.read_as("free")


def is_from_air(kept: Sequence[ProgramSegment], touched: int) -> bool:
    """Whether nothing was picked up: the last movement carried nothing, and nothing was touched since.

    touched: index of the last step in contact.
    """
    moved = (step for step in reversed(kept) if step.touches or step.segment.motion == "motion")
    last = next(moved, None)
    return last is not None and last.segment.contact == "free" and touched < last.index


def hanging(step: ProgramSegment, later: Iterable[ProgramSegment], context: Context) -> ProgramSegment:
    """Return a step in contact as a carry with its load, where its force hangs on the robot.

    A rest is one only with something in hand, or where no gripper is known if it is lifted next. A surface
    pushes back; only a load pulls straight down. A rest in contact may be a fast lift: it is a movement if it
    leads somewhere. A sensor's bias and the inertia of a fast movement also act aside of a load. So a rest in
    the fingers hangs, too, if it moves freely next, and a movement if the mean of its force does. later: the
    steps after it.
    """
    if not step.touches:
        return step
    force, rests, held = step.segment.force, step.segment.kind == "contact", holds(step, context.grips)
    if held and not rests and not hangs(force, context.up):
        force = _mean_force(step, context)
    is_load = hangs(force, context.up)
    lifts = rests and step.moved_m >= NOWHERE_M
    moving = {"kind": "transport", "motion": "motion"} if lifts else {}
    carry = as_carry_of(force, step, context, **moving)
    if rests and held:
        is_load = is_load or _is_never_pressed(carry, later, context)
    elif rests:
        is_load = is_load and held is None and moves_freely(carry, later, context)
    return carry if is_load else step


def _is_never_pressed(step: ProgramSegment, later: Iterable[ProgramSegment], context: Context) -> bool:
    """Return whether a step keeps the force with which it is moved up or down next: a tap is short."""
    free = _force_moved_next(step, later, context)
    forces = context.forces(observed(step.segment.t0, step.segment.tn))
    if free is None or not len(forces):
        return False
    beyond = np.linalg.norm(forces - free, axis=1)
    return float(np.median(beyond[beyond >= pressed_from(beyond)])) < PUSHES_BACK_N


def _mean_force(step: ProgramSegment, context: Context) -> Vector:
    """Return the mean force (3,) [N] of a step, that of the segment where none is known.

    From rest to rest, the inertia of what is moved has no mean.
    """
    forces = context.forces(observed(step.segment.t0, step.segment.tn))
    if not len(forces):
        return step.segment.force
    x, y, z = forces.mean(axis=0).tolist()
    return x, y, z


def as_carry_of(force: Vector, step: ProgramSegment, context: Context, **fields: object) -> ProgramSegment:
    """Return a contact as a carry of the load whose weight is a force [N]; of none for one that pushes up.

    fields: other fields of the segment.
    """
    down = max(_weight_n(force, context.up), 0.0)
    return step.read_as("transport", load_kg=down / GRAVITY, load_sd_kg=HANGING_SD_N / GRAVITY, **fields)


def hangs(force: Vector, up: Vector) -> bool:
    """Whether a force [N] pulls straight down on the robot, as a load does; up: of length 1."""
    (x, y, z), (ux, uy, uz), down = force, up, _weight_n(force, up)
    aside = length((x + down * ux, y + down * uy, z + down * uz))
    return down >= HANGING_N and aside <= HANGING_ASIDE * down


def _weight_n(force: Vector, up: Vector) -> float:
    """Return the component [N] of a force (3,) [N] against `up`: the weight of what hangs on the robot."""
    against: float = -sum(map(mul, force, up))
    return against


def moves_freely(step: ProgramSegment, later: Iterable[ProgramSegment], context: Context) -> bool:
    """Whether a step in the air has the force with which the flange is moved up or down next.

    A support would end with that movement. In free space that force is none or hangs: a tool may slide down a
    slope that pushes constantly. False where the fingers act, or the contact state changes, before it, and
    for empty fingers: what they have set down rests on its surface. later: the steps after it.
    """
    free = _force_moved_next(step, later, context)
    if free is None:
        return False
    here = context.forces(observed(step.segment.t0, step.segment.tn))
    return not len(here) or length(context.median(here) - free) < PUSHES_BACK_N


def _force_moved_next(
    step: ProgramSegment, later: Iterable[ProgramSegment], context: Context
) -> NDArray[np.float64] | None:
    """Return the force (3,) [N] with which the flange is moved up or down next; None if it may not be free.

    As for `moves_freely`.
    """
    state, held = step.segment.contact, holds(step, context.grips)
    pressed = length(step.segment.force) >= PUSHES_BACK_N and not hangs(step.segment.force, context.up)
    if step.touches or held is False or (state == "free" and (held or pressed)):
        return None
    for one in later:
        acts = any(step.segment.t0 <= grip.t < one.segment.tn for grip in context.grips)
        read = one if state == "free" else hanging(one, (), context)
        if acts or read.segment.contact != state:
            return None
        if read is one and abs(float(one.moved @ np.array(context.up))) >= ARRIVES_M:
            there = context.forces(observed(one.segment.t0, one.segment.tn))
            return context.median(there) if len(there) else None
    return None


def resting(step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a movement in the air, or a carry in the fingers, as a rest if its displacement is negligible.

    A person and a robot differ in such movements. The omitted turn is below the limit of the check, and the
    omitted displacement below the tolerance of a path. A carry that no grip confirms is unchanged.
    """
    segment = step.segment
    is_carried = segment.contact == "transport" and bool(holds(step, context.grips))
    if segment.corrected or segment.motion == "steady" or not (is_carried or segment.contact == "free"):
        return step
    if step.moved_m >= NOWHERE_M:  # as most do: what was seen in between need not be looked at
        return step
    seen = [context.moment_at(t) for t in observed(segment.t0, segment.tn)]
    way = max(math.dist(one.position, seen[0].position) for one in seen)
    turns = [one.orientation for one in seen if one.orientation is not None]
    most_m, most_rad = NOWHERE["transport" if is_carried else segment.kind]
    if way >= most_m or (turns and max(angle_between(one, turns[0]) for one in turns) >= most_rad):
        return step
    kind = KINDS["steady", segment.contact]
    still: dict[str, object] = {"kind": kind, "motion": "steady", "turn": None, "screw": None}
    return replace(step, segment=segment.model_copy(update=still))


def is_not_yet_held(
    last: ProgramSegment | None, step: ProgramSegment, ahead: ProgramSegment | None, context: Context
) -> bool:
    """Whether a step seems to hold a load that still stands where it was grasped.

    It was grasped in the contact before it, or less than `STANDS_S` before its end. It leads nowhere, or most
    of the load that is carried next does not hang on the robot yet. A hold of `STANDS_S` or longer is one on
    purpose. last: the contact, or else the step kept, before it; ahead: the step after it; None without one.
    """
    if not _is_hold(step) or step.lasts(STANDS_S):
        return False
    grasped = max((grip.t for grip in context.grips if grip.t <= step.segment.t0), default=-math.inf)
    if last is not None and last.touches:
        if _is_lifted_next(step, ahead):
            return True
        place = last.segment.position_end
    elif step.segment.tn - grasped < STANDS_S:
        place = context.moment_at(grasped).position
    else:
        return False
    return math.dist(step.segment.position_end, place) < OUT_M


def _is_lifted_next(step: ProgramSegment, ahead: ProgramSegment | None) -> bool:
    """Return whether less than `KEPT_SHARE` of the load that is carried next hangs on the robot in a step."""
    if ahead is None or ahead.segment.contact != "transport" or ahead.segment.motion != "motion":
        return False
    held_kg, carried_kg = step.segment.load_kg, ahead.segment.load_kg
    return held_kg is not None and carried_kg is not None and held_kg < KEPT_SHARE * carried_kg


def as_one_hold(kept: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; holds that follow each other at once are joined.

    They stay apart if the fingers act between them, or if the second has another load than the carry before:
    the first hold alone may be too short to be weighed well.
    """
    joined: list[ProgramSegment] = []
    carry: list[ProgramSegment] = []  # the steps with the load of the last one
    for step in kept:
        acts = any(abs(grip.t - step.segment.t0) < ROUNDED_S for grip in context.grips)
        if acts or step.segment.contact != "transport" or has_other_load(step, carry):
            carry = []
        if carry and _is_hold(joined[-1]) and _is_hold(step):
            joined[-1] = step.joined_to(joined[-1])
        else:
            joined.append(step)
        carry.append(step)
    return joined


def is_weighed_well(step: ProgramSegment) -> bool:
    """Return whether a step has a load, and lasts long enough for it to be weighed well."""
    return step.segment.load_kg is not None and step.lasts(WEIGHED_S)


def weighed_steps(steps: Sequence[ProgramSegment]) -> list[ProgramSegment]:
    """Return the steps with a load; of these, those that are weighed well, if there are any."""
    well = [step for step in steps if is_weighed_well(step)]
    return well or [step for step in steps if step.segment.load_kg is not None]


def has_other_load(step: ProgramSegment, before: Sequence[ProgramSegment]) -> bool:
    """Return whether the load of a step is another one than the average of steps before it.

    A step that is too short to be weighed well does not count.
    """
    weighed = [one for one in before if is_weighed_well(one)]
    kg, sd_kg = step.segment.load_kg, step.segment.load_sd_kg or 0.0
    if not weighed or kg is None or not is_weighed_well(step):
        return False
    least_kg = max(CHANGED_KG, CHANGED_SDS * math.hypot(sd_kg, average(weighed, "load_sd_kg")))
    return abs(kg - average(weighed, "load_kg")) > least_kg


def _is_hold(step: ProgramSegment) -> bool:
    """Return whether a step is a hold whose kind no operator has set."""
    return step.segment.kind == "hold" and not step.segment.corrected

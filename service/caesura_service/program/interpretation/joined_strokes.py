"""The parts of a stroke: its rests and its ends.

- A rest at either end of a stroke or of a turn in contact is part of it, however short. It has a force of its
  own if it lasts for half a second. A rest with another force before or after it is a press of its own. A
  short skid at the end of a landing is part of the rest after it.
- A short slide or a tilt beside a stroke is an end of it, if it has the stroke's force, however brief.
- The last centimetres before a contact are the end of the movement into it, the last one before a rest too.
- A turn in contact that continues about its axis without a stop is one turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, MutableMapping, Sequence
from dataclasses import replace
from itertools import dropwhile, groupby, pairwise, takewhile, zip_longest
from operator import itemgetter

import numpy as np

from caesura_protocol.messages import ScrewMotion
from caesura_protocol.rotations import angle_between
from caesura_protocol.screw_torque_and_text import exerted, stop_torque_nm, torque_about_axis
from caesura_service.constants import HANDS_BREADTH_M, TURN_SHARE
from caesura_service.program.forces.stroke_forces import (
    NO_FORCES,
    STROKE_REST_S,
    ToolForces,
    force_of_rests,
    pressed_force,
    pushing_force,
    rest_force_n,
    same_side,
    stroke_force,
    tool_forces,
)
from caesura_service.program.interpretation.touches import pushes_back
from caesura_service.program.program_segment import (
    ENDS,
    OBSERVED_S,
    PUSHES_BACK_N,
    ROUNDED_S,
    STOPS_SHARE,
    TOUCHED_S,
    UNLIKE_N,
    Context,
    MomentAt,
    ProgramSegment,
    joined_where,
    length,
    observed,
    slows_at,
)

NOWHERE_M = 0.01  # a movement shorter than this leads nowhere
DECAY_REACH_M = 0.02  # a movement shorter than this beside a contact may belong to it
APPROACH_REST_S = 0.3  # a movement that stands for less before its last centimetres goes on
INSERTED_M = 0.01  # from which depth on what is pushed in is an app of its own
SAME_AXIS = 0.9  # cosine between two turns that are one
LEAST_TURN_RAD = 0.1  # a turn by less is a rest: it has no screw motion
TILT_COSINE = 0.7  # of the angle between the tool and the axis of a turn: 45 degrees
TIP_REACH_M = 0.2  # from the reported point to the tip of a tool
OUT_M, OUT_SHARE = 0.005, 0.3  # from which on a movement leaves a contact; friction tilts a force less


def with_last_ways(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; the last movement into a contact, or to a rest, is part of the movement before it."""
    joined: list[ProgramSegment] = []
    for step, following in zip_longest(steps, steps[1:]):
        last = joined[-1] if joined else None
        if last is None or not _ends(last, step, following) or context.fingers_move(last.tn, step.segment.t0):
            joined.append(step)
            continue
        joined[-1] = step.joined_to(last)
    return joined


def with_whole_turns(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; parts of a turn that continues about its axis without a stop are joined."""
    return joined_where(steps, lambda turn, step: _turns_on(turn, step, context.moment_at), _one_turn)


def with_ends(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; short slides and tilts beside a stroke are ends of it, with one path.

    The segmentation may divide such an end from its stroke or not, and differs between a person and a robot.
    So short slides and a tilt beside each other are one stroke too, although none of them is one alone.
    """
    joined: list[ProgramSegment] = []
    for step in steps:
        parts, stroke = _one_with(step, joined, context)
        if len(parts) > 1 and _are_one(parts, stroke, context.moment_at):
            joined[len(joined) - len(parts) + 1 :] = [_one_way(parts)]
        else:
            joined.append(step)
    runs = groupby(joined, key=lambda step: _is_end(step, context) or _rests(step, context))
    return [step for ends, run in runs for step in (_with_tilt(list(run), context) if ends else run)]


def _with_tilt(run: list[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return ends of strokes and rests in a row; short slides are joined with the only tilt among them."""
    places = [place for place, step in enumerate(run) if not _rests(step, context)]
    tilts = [run[place] for place in places if _is_tilt(run[place], context.moment_at)]
    if len(tilts) != 1 or len(places) < 2:
        return run
    first, end = places[0], places[-1] + 1
    parts = run[first:end]
    one = [_one_way(parts)] if _are_one(parts, tilts[0], context.moment_at) else parts
    return [*run[:first], *one, *run[end:]]


def _one_with(
    step: ProgramSegment, before: Sequence[ProgramSegment], context: Context
) -> tuple[list[ProgramSegment], ProgramSegment]:
    """Return the steps that may be one stroke with `step`, in time order, and the stroke among them.

    Without such steps, return `step` alone, as the stroke.
    """
    if _is_end(step, context):
        rests = _length_of(before, lambda one: _rests(one, context))
        parts = [*before[-rests - 1 :], step]
        stroke = parts[0]
        if rests < len(before) and _has_ends(stroke, context.moment_at) and not _is_end(stroke, context):
            return parts, stroke
    elif _has_ends(step, context.moment_at):
        lead = _length_of(before, lambda one: _rests(one, context) or _is_end(one, context))
        return [*dropwhile(lambda one: _rests(one, context), before[len(before) - lead :]), step], step
    return [step], step


def with_short_ends(
    steps: Sequence[ProgramSegment], context: Context, short: MutableMapping[int, tuple[ProgramSegment, ...]]
) -> list[ProgramSegment]:
    """Return the steps; a slide below the minimum time directly before or after a stroke is an end of it.

    short: by index, the possible interpretations of a short step; those that belong to a stroke are removed.
    """
    joined: list[ProgramSegment] = []
    for step in steps:
        stroke = step
        for index in (step.parts[0].index - 1, step.parts[-1].index + 1):
            for end in short.get(index, ())[:1] if _has_ends(step, context.moment_at) else ():
                end = replace(end, base=step.base, confidence=step.confidence)
                parts = [end, stroke] if index < step.index else [stroke, end]
                if _is_end(end, context) and _are_one(parts, stroke, context.moment_at):
                    del short[index]
                    stroke = _one_way(parts)
        joined.append(stroke)
    return joined


def with_rests(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps, each stroke with the rests at its ends.

    A hand that lands may skid before it rests: that is a part of the rest. Rests between two strokes end the
    first, unless they are pressed as the second is and not as the first.
    """
    joined: list[ProgramSegment] = []
    begins: tuple[ProgramSegment, ...] = ()
    moment_at = context.moment_at
    resting = [_rests(step, context) for step in steps]
    followed = zip(steps, resting, [*resting, False][1:], strict=True)
    at_rest = [rests or (rest_follows and _skids(step, context)) for step, rests, rest_follows in followed]
    runs: list[tuple[bool, tuple[ProgramSegment, ...]]] = []
    for rests, pairs in groupby(zip(steps, at_rest, strict=True), key=itemgetter(1)):
        run = tuple(step for step, _ in pairs)
        runs += [(rests, level) for level in (_levels(run, context) if rests else [run])]
    for (rests, run), (_, following) in zip_longest(runs, runs[1:], fillvalue=(False, ())):
        last = joined[-1] if joined else None
        presses = last is not None and last.touches and not _is_stroke(last)
        pressed = last is not None and presses and not only_touches(last, moment_at)
        ends = last is not None and not last.rests_after and _goes_on(last, run[0])
        leads = rests and _leads_to(run, following, moment_at)
        ends = ends and rests and last is not None and _belong(run, last, moment_at)
        if ends and last is not None and not (leads and _is_begun(run, last, following[0], moment_at)):
            joined[-1] = replace(last, rests_after=run)
        elif leads and not pressed:
            begins = run
        else:
            joined += (replace(run[0], rests_before=begins), *run[1:])
            begins = ()
    return joined


def with_short_rests(
    steps: Sequence[ProgramSegment], context: Context, short: MutableMapping[int, tuple[ProgramSegment, ...]]
) -> list[ProgramSegment]:
    """Return the steps, each stroke with the rests beside it that are below the minimum time.

    One between two strokes ends the first. short: by index, the possible interpretations of a short step;
    those that belong to a stroke are removed.
    """
    joined: list[ProgramSegment] = []
    for step in steps:
        first, last = step.parts[0].index, step.parts[-1].index
        before, after = (_short_rests(step, short, index, context) for index in (first - 1, last + 1))
        joined.append(
            replace(step, rests_before=before + step.rests_before, rests_after=step.rests_after + after)
        )
    return joined


def _short_rests(
    stroke: ProgramSegment,
    short: MutableMapping[int, tuple[ProgramSegment, ...]],
    index: int,
    context: Context,
) -> tuple[ProgramSegment, ...]:
    """Remove the short step of an index from `short`, and return it, where it is a rest of a stroke.

    It is too short for a confidence of its own.
    """
    rests = tuple(
        replace(one, base=stroke.base, confidence=stroke.confidence) for one in short.get(index, ())[:1]
    )
    if not rests or not _rests(rests[0], context) or not _belong(rests, stroke, context.moment_at):
        return ()
    del short[index]
    return rests


def stands(step: ProgramSegment) -> bool:
    """Return whether a step is a turn in contact that is so small that it counts as a rest."""
    segment = step.segment
    still = segment.turn is not None and length(segment.turn) < LEAST_TURN_RAD
    return segment.kind == "turning" and step.touches and still and step.moved_m < INSERTED_M


def only_touches(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether a step ends in a contact and presses for less than a rest with a force of its own."""
    return step.arrives and _presses_briefly(step, moment_at)


def _presses_briefly(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether something pushes back in a step for less than a rest with a force of its own."""
    pushes = np.count_nonzero(tool_forces([step], moment_at).n >= PUSHES_BACK_N)
    return bool(OBSERVED_S * pushes < STROKE_REST_S - ROUNDED_S)


def may_end_movement(step: ProgramSegment) -> bool:
    """Return whether a movement is shorter than `DECAY_REACH_M`: it may be the end of another at a
    contact.
    """
    return step.moved_m < DECAY_REACH_M


def _ends(movement: ProgramSegment, step: ProgramSegment, following: ProgramSegment | None) -> bool:
    """Whether a step is the end of a movement: short, of the same kind, and without a rest between them.

    A step before another movement in the air is not its end. following: None after the last step.
    """
    touches = following is not None and following.touches
    if following is not None and following.segment.motion == "motion" and not touches:
        return False
    short = may_end_movement(step) if touches else step.moved_m < NOWHERE_M
    return short and is_directly_before(movement, step)


def is_directly_before(movement: ProgramSegment, step: ProgramSegment) -> bool:
    """Whether a movement in the air goes on in another of its kind, without a rest between the two."""
    at_once = step.segment.t0 - movement.segment.tn < APPROACH_REST_S - ROUNDED_S and _goes_on(movement, step)
    return are_one_kind(movement, step) and at_once


def are_one_kind(movement: ProgramSegment, other: ProgramSegment) -> bool:
    """Return whether both are movements in the air of one kind, whose kind no operator has set."""
    one, two = movement.segment, other.segment
    same = two.kind in ("motion", "transport") and one.kind == two.kind and one.contact == two.contact
    return same and not (one.corrected or two.corrected)


def _rests(step: ProgramSegment, context: Context) -> bool:
    """Whether a step rests in contact while the fingers do not move.

    A slide that only pushes in by less than `INSERTED_M`, and a turn that stands, are rests too.
    """
    segment = step.segment
    pushes = segment.kind == "sliding" and step.gives_way and step.moved_m < INSERTED_M
    if segment.corrected or not (segment.kind == "contact" or pushes or stands(step)):
        return False
    return not context.fingers_move(segment.t0, segment.tn)


def _skids(step: ProgramSegment, context: Context) -> bool:
    """Whether a step is the end of a landing: a short slide from a touch on, in which the force still rises.

    Or the hand only brakes in it, however long that takes. As an end of a stroke it is shorter than
    `DECAY_REACH_M`, and pushes nothing in.
    """
    segment = step.segment
    if segment.corrected or segment.kind != "sliding" or context.fingers_move(segment.t0, segment.tn):
        return False
    if step.moved_m >= DECAY_REACH_M or step.pushed_in >= INSERTED_M:
        return False
    lands = not pushes_back(step, context.moment_at)(segment.t0 - TOUCHED_S)
    return lands and (_presses_briefly(step, context.moment_at) or _only_brakes(step, context.moment_at))


def _only_brakes(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Whether a step is never faster than the way into it, up to `ENDS` observations before it.

    A stroke that is meant speeds up from its touch on.
    """
    times = observed(step.segment.t0, step.segment.tn)
    before = [times[0] - OBSERVED_S * k for k in range(ENDS - 1, 0, -1)]
    places = [moment_at(t).position for t in (*before, *times)]
    ways = [math.dist(*pair) for pair in pairwise(places)]
    return max(ways[ENDS - 1 :], default=0.0) <= max(ways[: ENDS - 1])


def _belong(rests: Sequence[ProgramSegment], stroke: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether `stroke` is a stroke, and the rests beside it press to the same side of the tool."""
    if not _is_stroke(stroke):
        return False
    return same_side(pushing_force(rests, moment_at), pushing_force([stroke], moment_at))


def _leads_to(
    rests: Sequence[ProgramSegment], following: Sequence[ProgramSegment], moment_at: MomentAt
) -> bool:
    """Return whether rests belong to the following stroke; False without one."""
    return bool(following) and _goes_on(rests[-1], following[0]) and _belong(rests, following[0], moment_at)


def _is_begun(
    rests: Sequence[ProgramSegment], last: ProgramSegment, following: ProgramSegment, moment_at: MomentAt
) -> bool:
    """Return whether rests between two strokes have the force of the second, and not of the first."""
    level_n = _level_n(rests, tool_forces(rests, moment_at))
    ended, begun = (stroke_force(one, moment_at) for one in (last, following))
    if level_n is None or ended is None or begun is None:
        return False
    return abs(level_n - length(begun)) < UNLIKE_N <= abs(level_n - length(ended))


def _length_of(steps: Sequence[ProgramSegment], belongs: Callable[[ProgramSegment], bool]) -> int:
    """Return the number of steps in a row at the end for which `belongs` holds."""
    return len(list(takewhile(belongs, reversed(steps))))


def _levels(run: Iterable[ProgramSegment], context: Context) -> list[tuple[ProgramSegment, ...]]:
    """Return consecutive rests, divided where a lasting one has another force than those before it.

    The end of a landing has no force of its own.
    """
    levels: list[tuple[ProgramSegment, ...]] = []
    before = NO_FORCES
    for rest in run:
        felt = NO_FORCES if _skids(rest, context) else tool_forces([rest], context.moment_at)
        here = _level_n([rest], felt)
        there = _level_n(levels[-1], before) if levels and here is not None else None
        if levels and (here is None or there is None or abs(here - there) < UNLIKE_N):
            levels[-1] += (rest,)
            before = before.and_then(felt)
        else:
            levels.append((rest,))
            before = felt
    return levels


def _level_n(rests: Sequence[ProgramSegment], felt: ToolForces) -> float | None:
    """Return the force [N] of rests once it has risen; None as `rest_force_n`, 0 without a push."""
    if force_of_rests(rests, felt) is None:
        return None
    _, force = pressed_force(felt)
    return 0.0 if force is None else length(force)


def _are_one(parts: Sequence[ProgramSegment], stroke: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether the tool stays in contact over all parts, and each has the force of the stroke among
    them.
    """
    others = [part for part in parts if part is not stroke]
    stay = all(_stays(one, other) for one, other in pairwise(parts))
    return stay and all(_pressed_as(part, stroke, moment_at) for part in others)


def _pressed_as(part: ProgramSegment, stroke: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether a part presses to the same side of the tool as a stroke, with about its force.

    The force of a short rest is not compared.
    """
    here = pushing_force([part], moment_at)
    _, there = pressed_force(tool_forces([stroke], moment_at))
    rest_n = rest_force_n([part], moment_at)
    rests = part.segment.motion == "steady"
    if rests and rest_n is not None:
        near = there is None or abs(rest_n - length(there)) < UNLIKE_N
    else:
        near = rests or here is None or there is None or abs(length(here) - length(there)) < UNLIKE_N
    return near and same_side(here, there)


def _one_way(parts: Sequence[ProgramSegment]) -> ProgramSegment:
    """Return a stroke, its ends, and the rests between them as one step in contact."""
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


def _turns_on(turn: ProgramSegment, step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether a turn continues in a step about the same axis, without a stop.

    In contact, it must also press in the same way (`_pressed_as`).
    """
    one, two = turn.segment, step.segment
    named = one.corrected or two.corrected or step.is_set_apart
    if named or not one.kind == two.kind == "turning" or one.contact != two.contact:
        return False
    if one.turn is None or two.turn is None or step.index != turn.index + 1:
        return False
    about_one_axis = float(np.dot(one.turn, two.turn)) >= SAME_AXIS * length(one.turn) * length(two.turn)
    as_hard = not turn.touches or _pressed_as(turn, step, moment_at)
    return about_one_axis and as_hard and not _stops_between(turn, step, moment_at)


def _stops_between(turn: ProgramSegment, following: ProgramSegment, moment_at: MomentAt) -> bool:
    """Whether the speed between two turns falls to `STOPS_SHARE` of the lesser of their peaks.

    True where an orientation is not known.
    """
    before, after = (observed(step.segment.t0, step.segment.tn) for step in (turn, following))
    seen = [moment_at(t).orientation for t in (*before, *after)]
    turned = [angle_between(a, b) for a, b in pairwise(seen) if a is not None and b is not None]
    if len(turned) < len(seen) - 1:
        return True
    return slows_at(turned, len(before) - 1, STOPS_SHARE)


def _one_turn(turn: ProgramSegment, following: ProgramSegment) -> ProgramSegment:
    """Return two parts of a divided turn as one."""
    whole, one, two = following.joined_to(turn), turn.segment, following.segment
    angle = None if one.turn is None or two.turn is None else tuple(np.add(one.turn, two.turn).tolist())
    screw = _one_screw(one.screw, two.screw)
    return replace(whole, segment=whole.segment.model_copy(update={"turn": angle, "screw": screw}))


def _one_screw(one: ScrewMotion | None, two: ScrewMotion | None) -> ScrewMotion | None:
    """Return the screw motion of a divided turn, with the larger torque of the two.

    None where one is unknown. The advance of each part counts by its angle.
    """
    if one is None or two is None:
        return None
    share = one.angle / (one.angle + two.angle)
    hardest = max((one, two), key=lambda part: abs(torque_about_axis(part) or 0.0))
    whole = {
        "angle": one.angle + two.angle,
        "point": one.point,
        "pitch_m": share * one.pitch_m + (1.0 - share) * two.pitch_m,
        "pitch_sd_m": math.hypot(share * one.pitch_sd_m, (1.0 - share) * two.pitch_sd_m),
        "torque": hardest.torque,
    }
    return two.model_copy(update=whole)


def _is_end(step: ProgramSegment, context: Context) -> bool:
    """Whether a step may be the end of a stroke: a tilt in contact, or a slide below `DECAY_REACH_M`."""
    segment = step.segment
    if segment.corrected or context.fingers_move(segment.t0, segment.tn):
        return False
    slides = segment.kind == "sliding" and not _rests(step, context) and abs(step.pushed_in) < INSERTED_M
    return (slides and step.moved_m < DECAY_REACH_M) or _is_tilt(step, context.moment_at)


def _has_ends(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether a step is a stroke that may have ends: no driven screw, and no kind set by an
    operator.
    """
    segment = step.segment
    driven = segment.kind == "turning" and segment.turn is not None and not _is_tilt(step, moment_at)
    return _is_stroke(step) and not segment.corrected and not driven


def _stays(one: ProgramSegment, following: ProgramSegment) -> bool:
    """Whether the tool stays in contact from one step to the next, with at most a short time between."""
    return _goes_on(one, following) or following.segment.t0 - one.segment.tn < APPROACH_REST_S - ROUNDED_S


def _is_tilt(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Whether a step turns in contact about an axis across the tool, unlike a screw, and against no lever."""
    segment, moment = step.segment, moment_at(step.segment.tn)
    if not step.touches or segment.corrected or segment.turn is None or moment.orientation is None:
        return False
    if not (segment.kind == "turning" or _turns_on_tip(step, moment_at)) or _is_resisted(step):
        return False
    return abs(float(moment.axes[:, 2] @ segment.turn)) < TILT_COSINE * length(segment.turn)


def _turns_on_tip(step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Whether a slide turns the tool while a place along the tool's axis hardly moves."""
    segment, first, last = step.segment, moment_at(step.segment.t0), moment_at(step.segment.tn)
    turned = 0.0 if segment.turn is None else length(segment.turn)
    if segment.kind != "sliding" or turned < LEAST_TURN_RAD:
        return False
    axis_moved = (last.axes - first.axes)[:, 2]
    nearest_m = -float(step.moved @ axis_moved) / max(float(axis_moved @ axis_moved), 1e-12)
    tip_moved = length(step.moved + min(max(nearest_m, 0.0), TIP_REACH_M) * axis_moved)
    return tip_moved**2 <= TURN_SHARE * (HANDS_BREADTH_M * turned) ** 2


def _is_resisted(step: ProgramSegment) -> bool:
    """Return whether a turn ends with a torque above that of its force at a hand's breadth from the tip."""
    torque_nm = None if step.segment.screw is None else stop_torque_nm(exerted(step.segment.screw))
    return torque_nm is not None and torque_nm > HANDS_BREADTH_M * length(step.force)


def _goes_on(one: ProgramSegment, following: ProgramSegment) -> bool:
    """Return whether a step begins where another one ends.

    Steps left out between the two may have moved the tool.
    """
    apart_m = math.dist(following.segment.position_start, one.segment.position_end)
    return following.parts[0].index == one.parts[-1].index + 1 or apart_m < OUT_M


def _is_stroke(step: ProgramSegment) -> bool:
    """Return whether a step moves along a surface, or turns in contact.

    A yielding object is pressed in instead.
    """
    segment = step.segment
    moves = step.touches and segment.motion == "motion"
    return moves and (segment.kind == "turning" or not step.gives_way)

"""Interprets the segments of a program, each in the context of its neighbours.

The filter infers each segment separately. In two passes,
1. each one is interpreted with its neighbours: what the robot carries (`carried_loads`), what it touches
   (`contacts`), and how it leaves the contact (`departures`). Segments below the minimum time, and the
   decaying force of a contact, are left out;
2. related segments are joined, stage by stage. A short movement is joined with the one before or after it.
   The rests and ends of a stroke are part of it (`joined_strokes`). A press that gives way is a movement
   (`resisted_movements`).
A kind that an operator has set is not changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import NamedTuple

from caesura_protocol.messages import Vector
from caesura_protocol.up_direction import UP
from caesura_service.program.forces.sensor_bias import with_bases
from caesura_service.program.interpretation.carried_loads import (
    as_one_hold,
    divided_at_grips,
    hanging,
    in_hand,
    is_from_air,
    is_not_yet_held,
    moves_freely,
    resting,
)
from caesura_service.program.interpretation.contacts import as_touching, set_down, still_touching
from caesura_service.program.interpretation.departures import hitting, leaving, lets_go, with_departures
from caesura_service.program.interpretation.joined_movements import with_whole_movements
from caesura_service.program.interpretation.joined_strokes import (
    are_one_kind,
    with_ends,
    with_last_ways,
    with_rests,
    with_short_ends,
    with_short_rests,
    with_whole_turns,
)
from caesura_service.program.interpretation.resisted_movements import with_resisted_movements
from caesura_service.program.interpretation.spring_pulls import pulled
from caesura_service.program.interpretation.supported_loads import with_supported_loads
from caesura_service.program.interpretation.touches import with_touches
from caesura_service.program.program_segment import (
    ROUNDED_S,
    Context,
    GripperAction,
    MomentAt,
    ProgramSegment,
    holds,
)

Stage = Callable[[Sequence[ProgramSegment], Context], list[ProgramSegment]]


class _Place(NamedTuple):
    """An inferred step, with its inferred neighbours."""

    step: ProgramSegment
    ahead: ProgramSegment | None  # the next one, however short
    beside: ProgramSegment | None  # the last one before it, however short
    behind: ProgramSegment | None  # the last but one, however short
    before: ProgramSegment | None  # the last one that lasts for the minimum time
    earlier: ProgramSegment | None  # the last but one that does
    touched: int  # index of the last one in contact, however short; -1 where there is none
    steps: Sequence[ProgramSegment]  # all of them
    number: int  # of the step among them, from 1 on

    @property
    def later(self) -> Iterator[ProgramSegment]:
        """The steps after this one."""
        return islice(self.steps, self.number, None)


def kept_steps(
    steps: Sequence[ProgramSegment],
    grips: Sequence[GripperAction],
    moment_at: MomentAt,
    least_s: float,
    up: Vector = UP,
) -> list[ProgramSegment]:
    """Return the steps from which apps are made, each interpreted with its neighbours.

    grips: all known gripper actions; least_s: minimum time filter [s]; up: away from gravity, base frame.
    """
    context = Context(grips, moment_at, up)
    kept: list[ProgramSegment] = []
    short: dict[int, tuple[ProgramSegment, ...]] = {}
    for place in _places(divided_at_grips(steps, context, least_s), least_s):
        step = place.step
        read = in_hand(step, is_from_air(kept, place.touched), context)
        if not step.lasts(least_s):
            short[step.index] = (read,) if holds(step, grips) is not None else (read, step)
        elif not lets_go(place.before, kept, step, context):
            kept += _read(read, place, kept[-1] if kept else None, context)
    stages: tuple[Stage, ...] = (
        as_one_hold,
        with_bases,
        with_supported_loads,
        with_touches,
        partial(_with_short_movements, short=short),
        with_whole_movements,
        with_last_ways,
        with_departures,
        with_whole_turns,
        partial(with_short_ends, short=short),
        with_ends,
        with_rests,
        partial(with_short_rests, short=short),
        with_resisted_movements,
    )
    for stage in stages:
        kept = stage(kept, context)
    return kept


def _places(steps: Sequence[ProgramSegment], least_s: float) -> Iterator[_Place]:
    """Yield every step with its neighbours."""
    before, earlier, touched = None, None, -1
    around = zip(steps, [*steps[1:], None], [None, *steps], [None, None, *steps], strict=False)
    for number, (step, ahead, beside, behind) in enumerate(around, start=1):
        yield _Place(step, ahead, beside, behind, before, earlier, touched, steps, number)
        touched = step.index if step.touches else touched
        if step.lasts(least_s):
            before, earlier = step, before


def _read(
    step: ProgramSegment, place: _Place, last: ProgramSegment | None, context: Context
) -> list[ProgramSegment]:
    """Return a list with the interpreted step, or an empty list for a load that is not held yet.

    last: the last step kept, None before the first.
    """
    pull = pulled(last, step, context)
    if pull is not None:
        return [pull]
    step = hanging(step, place.later, context)
    step = as_touching(last, step, context)
    step = hitting(leaving(last, step, context), place.ahead, context)
    step = resting(step, context)
    contact = _contact_before(place, last, context)
    if last is not None and not step.touches and not moves_freely(step, place.later, context):
        if contact is not None:
            step = still_touching(contact, last, step, context)
        else:
            step = set_down(last, step, place.ahead, context)
    return [] if is_not_yet_held(contact or last, step, place.ahead, context) else [step]


def _contact_before(place: _Place, last: ProgramSegment | None, context: Context) -> ProgramSegment | None:
    """Return the contact that a step follows directly, or with one step between; None without one.

    The step between was interpreted as a contact too, or is shorter than the minimum time. If the fingers
    hold something, there may be several steps between, because its weight is known. Then an inferred contact
    that was read as a carry is none: its force has no direction from a surface. last: the last step kept.
    """
    beside, behind = place.beside, place.behind
    if beside is None:
        return None
    if beside.touches:
        is_read_otherwise = last is not None and last.index == beside.index and not last.touches
        return None if is_read_otherwise and holds(beside, context.grips) else beside
    if beside is not place.before and behind is not None and behind.touches:
        return behind
    read = last is not None and last.touches and last.index == beside.index
    after_contact = any(one is not None and one.touches for one in (behind, place.earlier))
    return last if read and (after_contact or holds(beside, context.grips)) else None


def _with_short_movements(
    kept: Sequence[ProgramSegment], _context: Context, *, short: dict[int, tuple[ProgramSegment, ...]]
) -> list[ProgramSegment]:
    """Return the kept steps, joined with the movements below the minimum time beside them.

    Both are of one kind. A short one between two movements belongs to the second. short: by index, the
    possible interpretations of a short step: it is too short to be weighed, so without a grip it may be a
    carry or not.
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
    """Remove a short step that meets a movement of its kind from `short` and return it; None without one."""
    for step in short.get(index, ()):
        apart_s = min(abs(movement.t0 - step.tn), abs(step.t0 - movement.tn))
        if are_one_kind(step, movement) and apart_s < ROUNDED_S:
            del short[index]
            return step
    return None

"""Movements against a resistance that gives way: a drawer that is pulled, a box that is pushed.

A press that gives way by more than `ARRIVES_M` has no end against which a robot could press. The robot moves
along its path, and carries what the fingers hold. The app has the force that was taught, and controls none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from caesura_service.program.interpretation.carried_loads import STANDS_S, as_carry_of
from caesura_service.program.interpretation.touches import touched_at
from caesura_service.program.program_segment import (
    ARRIVES_M,
    ENDS,
    GRIP_SLACK_S,
    PUSHES_BACK_N,
    ROUNDED_S,
    UNLIKE_N,
    Context,
    ProgramSegment,
    carried_weight,
    direction,
    holds,
    length,
    way_and_forces,
)

PUSHES_ASIDE = 0.5  # force across a push, as a share of the force along it: friction alone leaves more across


def with_resisted_movements(kept: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps, in which each press that gives way is replaced by a carry or a movement.

    It is a carry of the weight that was held before, if an object is held. A rest in contact before it, in
    which its force rises, is joined to it. A rest in contact after such a carry becomes a hold.
    """
    read: list[ProgramSegment] = []
    for step in kept:
        moved = _moved(step, context)
        if moved is not None:
            begins = bool(read) and _begins(read[-1], step, context)
            read.append(moved.joined_to(read.pop()) if begins else moved)
        elif read and read[-1].is_resisted and _is_rest(step, context) and holds(step, context.grips):
            read.append(_carried(step, context))
        else:
            read.append(step)
    return read


def _moved(step: ProgramSegment, context: Context) -> ProgramSegment | None:
    """Return a press that gives way as a carry, or as a movement in the air; None for any other step.

    A carry against a force that rises, such as a spring's, is one, too.
    """
    if not _is_steady_grip(step, context):
        return None
    if step.segment.kind == "transport" and holds(step, context.grips):
        return replace(step, is_resisted=True) if _is_pulled(step, context) else None
    if not _gives_way(step, context):
        return None
    if holds(step, context.grips):
        return _carried(step, context)
    return replace(step.read_as("free"), is_resisted=True) if _pushes(step, context) else None


def _begins(rest: ProgramSegment, step: ProgramSegment, context: Context) -> bool:
    """Return whether the force of a movement rises in the rest before it.

    With nothing in the fingers, a rest of `STANDS_S` or longer is a press of its own.
    """
    held = holds(rest, context.grips)
    rises = held == holds(step, context.grips) and (bool(held) or not rest.lasts(STANDS_S))
    return rises and _is_rest(rest, context) and step.t0 - rest.tn < ROUNDED_S


def _is_rest(step: ProgramSegment, context: Context) -> bool:
    """Return whether a step is a rest in contact, in which the fingers do not move."""
    return step.segment.kind == "contact" and _is_steady_grip(step, context)


def _is_steady_grip(step: ProgramSegment, context: Context) -> bool:
    """Return whether the fingers do not move in a step whose kind no operator has set."""
    segment = step.segment
    acts = any(segment.t0 < grip.t < segment.tn - GRIP_SLACK_S for grip in context.grips)
    return not segment.corrected and not acts


def _gives_way(step: ProgramSegment, context: Context) -> bool:
    """Return whether what a step touches gives way by `ARRIVES_M` or more, counted from the touch."""
    if not step.arrives:
        return False
    way = np.subtract(step.segment.position_end, touched_at(step, context.moment_at))
    return float(way @ direction(step.force)) <= -ARRIVES_M


def _is_pulled(step: ProgramSegment, context: Context) -> bool:
    """Return whether what is carried is pulled back at its end, on `ARRIVES_M` or more of its way."""
    places, forces = way_and_forces(step, context)
    if len(forces) < ENDS:
        return False
    pulls = forces - carried_weight(step.segment, context)
    last = context.median(pulls[-ENDS:])
    along = direction(last)
    slack = np.flatnonzero(pulls @ along < PUSHES_BACK_N)
    begun = places[min(int(slack[-1]) + 1, len(places) - 1) if len(slack) else 0]
    way = np.subtract(step.segment.position_end, begun)
    return length(last) >= UNLIKE_N and float(way @ along) <= -ARRIVES_M


def _pushes(step: ProgramSegment, context: Context) -> bool:
    """Return whether the force acts along the way of a step, weighted by way; friction acts across it too.

    A tool that follows a surface presses on it. With a force across of `PUSHES_ASIDE` or more of that along
    the way, the friction coefficient is at most 2.
    """
    places, felt = way_and_forces(step, context)
    if len(felt) < 2:
        return False
    felt = felt - step.base
    ways, forces = np.diff(places, axis=0), 0.5 * (felt[1:] + felt[:-1])
    work = -float(np.vecdot(ways, forces).sum())
    across = np.linalg.norm(np.cross(ways, forces), axis=1).sum()
    return bool(across < PUSHES_ASIDE * work)


def _carried(step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a contact as a carry of the weight that was held before it."""
    return replace(as_carry_of(step.base, step, context), is_resisted=True)

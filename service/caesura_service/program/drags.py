"""Held objects that are moved against a resistance, such as a drawer. The robot carries them.

A press that gives way by more than `ARRIVES_M` has no end against which a robot could press. What the fingers
hold, the robot moves along its path. A note has the force, which no app exerts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from caesura_service.program.carried_loads import as_carry_of
from caesura_service.program.contacts import touched_at
from caesura_service.program.program_segment import (
    ARRIVES_M,
    GRIP_SLACK_S,
    ROUNDED_S,
    Context,
    ProgramSegment,
    direction,
    holds,
)


def with_drags(kept: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; drags are carries, with the weight that was held before.

    A rest in contact before a drag, in which its force rises, is its beginning. One after it is a hold.
    """
    read: list[ProgramSegment] = []
    for step in kept:
        if _is_held(step, context) and _is_moved(step, context):
            carried = _dragged(step, context)
            begins = bool(read) and _rests(read[-1], context) and step.t0 - read[-1].tn < ROUNDED_S
            read.append(carried.joined_to(read.pop()) if begins else carried)
        elif read and read[-1].is_dragged and _rests(step, context):
            read.append(_dragged(step, context))
        else:
            read.append(step)
    return read


def _rests(step: ProgramSegment, context: Context) -> bool:
    """Return whether a step is a rest in contact with a held object."""
    return step.segment.kind == "contact" and _is_held(step, context)


def _is_held(step: ProgramSegment, context: Context) -> bool:
    """Return whether the fingers hold something from a contact's start to its end."""
    segment = step.segment
    acts = any(segment.t0 < grip.t < segment.tn - GRIP_SLACK_S for grip in context.grips)
    return not segment.corrected and bool(holds(step, context.grips)) and not acts


def _is_moved(step: ProgramSegment, context: Context) -> bool:
    """Return whether what a step touches gives way by `ARRIVES_M` or more, counted from the touch."""
    if not step.arrives:
        return False
    way = np.subtract(step.segment.position_end, touched_at(step, context.moment_at))
    return float(way @ direction(step.force)) <= -ARRIVES_M


def _dragged(step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a contact as a carry of the weight that was held before it."""
    return replace(as_carry_of(step.base, step, context), is_dragged=True)

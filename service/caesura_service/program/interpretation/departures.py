"""The end of a contact: the decay of its force, and the movement out of it.

- A movement in the air after a contact is a movement; the decaying force of the contact is no segment.
- A movement far out of the pressed object is a movement in the air. One that stays inside it is part of the
  next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import takewhile

import numpy as np

from caesura_protocol.messages import Vector
from caesura_service.program.interpretation.joined_strokes import DECAY_REACH_M, is_directly_before
from caesura_service.program.interpretation.touches import pushes_back, touched_at
from caesura_service.program.program_segment import (
    ACROSS_M,
    ARRIVES_M,
    Context,
    ProgramSegment,
    direction,
    length,
    observed,
)

IN_AIR_M = 0.005  # a contact that lets go does not go on for longer than this without its force


def lets_go(
    before: ProgramSegment | None, kept: Sequence[ProgramSegment], step: ProgramSegment, context: Context
) -> bool:
    """Whether a movement is only the decay of the force of the contact before it.

    The arm hardly moves while the force decays. A step that continues without that force is a movement, once
    it has left the pressed object. kept: the steps kept so far.
    """
    if before is None or before.segment.kind != "contact" or step.segment.kind != "motion":
        return False
    segment = step.segment
    if step.moved_m >= DECAY_REACH_M or length(segment.force_end) >= length(segment.force_start):
        return False
    contact = list(takewhile(lambda one: one.touches, reversed(kept)))
    if not contact:
        return True
    normal = direction(contact[0].force)
    if np.subtract(segment.position_end, touched_at(contact[-1], context.moment_at)) @ normal <= 0.0:
        return True
    gone = _last_pushed(step, contact[0], context) or segment.position_start
    return math.dist(segment.position_end, gone) < IN_AIR_M


def leaving(last: ProgramSegment | None, step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a slide that leaves the pressed object as a movement in the air. last: the last step kept.

    It moves `ARRIVES_M` or more out of the object. Or it follows a contact whose force decays on its first
    `DECAY_REACH_M`, and nothing pushes back on `ARRIVES_M` or more then.
    """
    if step.segment.kind != "sliding":
        return step
    leaves = step.gives_way and -step.pushed_in >= ARRIVES_M
    departs = last is not None and last.touches and _is_departure(step, context)
    return step.read_as("free") if leaves or departs else step


def hitting(step: ProgramSegment, ahead: ProgramSegment | None, context: Context) -> ProgramSegment:
    """Return a slide that only hits a surface as a movement in the air. ahead: the next step, however short.

    One observation pushes back, and the next step is in the air: nothing was pressed.
    """
    if step.segment.kind != "sliding" or ahead is None or ahead.touches:
        return step
    times = observed(step.segment.t0, step.segment.tn)
    hits = sum(map(pushes_back(step, context.moment_at), times)) == 1
    return step.read_as("free") if hits else step


def _is_departure(step: ProgramSegment, context: Context) -> bool:
    gone = _last_pushed(step, step, context)
    if gone is None:
        return False
    start, end = step.segment.position_start, step.segment.position_end
    return math.dist(start, gone) < DECAY_REACH_M and math.dist(gone, end) >= ARRIVES_M


def _last_pushed(step: ProgramSegment, contact: ProgramSegment, context: Context) -> Vector | None:
    """Return the position (3,) [m] at which a contact last pushes back in a step; None if it never does."""
    times = observed(step.segment.t0, step.segment.tn)
    presses = list(filter(pushes_back(contact, context.moment_at), times))
    return context.moment_at(presses[-1]).position if presses else None


def with_departures(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; a movement that stays inside a pressed object is part of the movement after it."""
    joined: list[ProgramSegment] = []
    for step in steps:
        if joined and is_directly_before(joined[-1], step) and _is_inside(joined[-1], joined[:-1], context):
            joined[-1] = step.joined_to(joined[-1])
        else:
            joined.append(step)
    return joined


def _is_inside(movement: ProgramSegment, before: Sequence[ProgramSegment], context: Context) -> bool:
    """Whether a movement ends inside the object that gave way before it: below its surface, not beside it."""
    pressed = list(takewhile(lambda step: step.touches and step.gives_way, reversed(before)))
    if not pressed:
        return False
    normal = direction(pressed[0].force)
    out = np.subtract(movement.segment.position_end, touched_at(pressed[-1], context.moment_at))
    risen_m = float(out @ normal)
    return risen_m < 0.0 and length(out - risen_m * normal) < ACROSS_M

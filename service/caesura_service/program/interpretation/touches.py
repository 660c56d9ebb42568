"""Where and when a contact first pushes back: its segment may begin on the way down to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_service.program.program_segment import (
    PUSHES_BACK_N,
    Context,
    MomentAt,
    ProgramSegment,
    direction,
    observed,
)


def with_touches(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; a slide that follows a step in the air begins where it first pushes back.

    Its way to that place is the end of the movement before it, as in the program. An approach that ends in a
    press without a pause keeps its way.
    """
    return [
        _from_touch(step, context) if before is not None and not before.touches else step
        for before, step in zip([None, *steps], steps, strict=False)
    ]


def _from_touch(step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a slide that begins where it first pushes back; every other step as it is."""
    segment = step.segment
    if segment.kind != "sliding" or segment.corrected or step.arrives:
        return step
    begun = {"position_start": touched_at(step, context.moment_at)}
    return replace(step, segment=segment.model_copy(update=begun))


def touched_at(contact: ProgramSegment, moment_at: MomentAt) -> Vector:
    """Return the position (3,) [m] at which a contact first pushes back; the segment's start where none does.

    The segment may begin on the way down to the contact.
    """
    times = observed(contact.segment.t0, contact.segment.tn)
    t = next(filter(pushes_back(contact, moment_at), times), None)
    return contact.segment.position_start if t is None else moment_at(t).position


def pushes_back(contact: ProgramSegment, moment_at: MomentAt) -> Callable[[float], bool]:
    """Return a test for a time [s]: whether a contact pushes back then, along its force."""
    base, normal = contact.base, direction(contact.force)
    return lambda t: _along(moment_at(t).force, base, normal) >= PUSHES_BACK_N


def _along(force: Vector | None, base: Vector, normal: NDArray[np.float64]) -> float:
    """Return the component [N] of a force beyond a base along a normal; 0 where the force is None."""
    return 0.0 if force is None else float(np.subtract(force, base) @ normal)

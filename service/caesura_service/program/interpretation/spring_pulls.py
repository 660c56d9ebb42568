"""What is pulled against a spring, such as a handle pulled up: its force is no load.

The fingers carry a load with its whole weight as soon as it is lifted. A spring pulls harder along the whole
way, and less on the way back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_service.program.forces.sensor_bias import SPRUNG_SHARE
from caesura_service.program.interpretation.carried_loads import HANGING_N, as_carry_of, hangs
from caesura_service.program.interpretation.joined_strokes import NOWHERE_M
from caesura_service.program.program_segment import (
    ENDS,
    UNLIKE_N,
    Context,
    ProgramSegment,
    carried_weight,
    holds,
    length,
    way_and_forces,
)

Array = NDArray[np.float64]

LEAST_WAY_M = 2.0 * NOWHERE_M  # a load is lifted off its support on less than half of it


def pulled(last: ProgramSegment | None, step: ProgramSegment, context: Context) -> ProgramSegment | None:
    """Return a carry that pulls a spring as one of what the fingers held before; None for any other step.

    So are the rests after such a way, and the way back. last: the last step kept, None before the first.
    """
    segment = step.segment
    if segment.contact != "transport" or segment.corrected or not holds(step, context.grips):
        return None
    before = last if last is not None and last.segment.contact == "transport" else None
    weight = np.zeros(3) if before is None else carried_weight(before.segment, context)
    ends = _ends_of_spring(step, context)
    if before is not None and before.is_resisted:
        goes_on = segment.motion == "steady" or ends is not None
        return _weighing(weight, ends, step, context) if goes_on else None
    if ends is None or length(weight) >= HANGING_N or not hangs(_vector(ends[1] - ends[0]), context.up):
        return None
    return _weighing(ends[0], ends, step, context)


def _weighing(
    force: Array, ends: tuple[Array, Array] | None, step: ProgramSegment, context: Context
) -> ProgramSegment:
    """Return a carry of the load whose weight is a force (3,) [N]; ends: the forces at both ends of a way."""
    felt = {} if ends is None else {"force_held": _vector(max(ends, key=length))}
    return replace(as_carry_of(_vector(force), step, context, **felt), is_resisted=True)


def _vector(force: Array) -> Vector:
    x, y, z = force.tolist()
    return x, y, z


def _ends_of_spring(step: ProgramSegment, context: Context) -> tuple[Array, Array] | None:
    """Return the forces [N] at both ends of a way on which they change as a spring's; None for another way.

    Halfway, a share of the change from `SPRUNG_SHARE` on has been made, and as much is left.
    """
    if step.segment.motion != "motion":
        return None
    places, forces = way_and_forces(step, context)
    gone = np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))
    if len(forces) < 2 * ENDS or gone[-1] < LEAST_WAY_M:
        return None
    half = int(np.searchsorted(gone, 0.5 * gone[-1])) + 1
    first, middle, last = (
        context.median(some) for some in (forces[:ENDS], forces[half - 1 : half + 2], forces[-ENDS:])
    )
    change = last - first
    if length(change) < UNLIKE_N:
        return None
    made = float((middle - first) @ change) / float(change @ change)
    return (first, last) if SPRUNG_SHARE <= made <= 1.0 - SPRUNG_SHARE else None

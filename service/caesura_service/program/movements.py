"""Movements in the air that are one: where a hand neither slows down nor turns, no next movement begins.

A hand that only gets faster or slower, as on its way into a circle and out of it, is in one movement. Its
tempo differs on both sides, and the segmentation divides it there. But a corner is a place that turns and
slows, and everything else inside a movement is a via point of its path.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from caesura_service.program.program_segment import (
    ROUNDED_S,
    Context,
    MomentAt,
    ProgramSegment,
    joined_where,
    length,
    observed,
    slows_at,
)

NEAR_S = 0.7  # to either side of a boundary, where the neighbouring peaks of speed lie
CORNER_COSINE = 0.5**0.5  # of 45 degrees, from which on a path turns
SLOWS_SHARE = 0.9  # of the lesser of the peaks: the way in 0.1 s, 5 mm, is known to half a millimetre
MOVES = ("motion", "transport")  # kinds that may be one with another of their kind


def with_whole_movements(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """The same steps; a movement, or a carry, that goes on in the next one is one with it."""
    return joined_where(steps, lambda movement, step: _moves_on(movement, step, context.moment_at))


def _moves_on(movement: ProgramSegment, step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Does a movement in the air go on in a step of its kind, at once and without a corner?"""
    one, two = movement.segment, step.segment
    if one.corrected or two.corrected or one.kind != two.kind or one.kind not in MOVES:
        return False
    at_once = step.parts[0].index == movement.parts[-1].index + 1 and two.t0 - one.tn < ROUNDED_S
    return at_once and not turns_or_slows(two.t0, moment_at)


def turns_or_slows(t: float, moment_at: MomentAt) -> bool:
    """Is the hand slower at a boundary [s] than near it, or does it go on another way?

    It is slower where its speed is at most `SLOWS_SHARE` of the lesser of the peaks on both sides.
    """
    before, after = observed(t - NEAR_S, t), observed(t, t + NEAR_S)
    steps = np.diff(np.array([moment_at(one).position for one in (*before, *after)]), axis=0)
    place = len(before) - 1  # of the step across the boundary
    into, out_of = steps[place - 1], steps[place + 1]
    turns = float(into @ out_of) <= CORNER_COSINE * length(into) * length(out_of)
    return turns or slows_at(np.linalg.norm(steps, axis=1), place, SLOWS_SHARE)

"""Joins segments in the air that form one movement. Only a stop or a corner ends a movement; at a corner it
turns and slows.

Everything else inside a movement is a via point of its path. A change of speed, as on the way into a circle
and out of it, does not end a movement, although the segmentation may divide it there. A boundary set by an
operator stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from caesura_service.program.program_segment import (
    ROUNDED_S,
    STOPS_SHARE,
    Context,
    MomentAt,
    ProgramSegment,
    joined_where,
    length,
    observed,
    slows_at,
)

NEAR_S = 0.7  # to either side of a boundary, where the neighbouring peaks of speed lie
CORNER_COSINE, CORNER_SHARE = 0.5**0.5, 0.6  # of 45 degrees, and of the lesser peak: as in the corner weight
MOVES = ("motion", "transport")  # kinds that may be one with another of their kind


def with_whole_movements(steps: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; a movement, or a carry, is joined with the step into which it continues."""
    return joined_where(steps, lambda movement, step: _moves_on(movement, step, context.moment_at))


def _moves_on(movement: ProgramSegment, step: ProgramSegment, moment_at: MomentAt) -> bool:
    """Return whether a movement in the air continues at once in a step of its kind.

    That is, without a stop or a corner between them.
    """
    one, two = movement.segment, step.segment
    if one.corrected or two.corrected or step.parts[0].is_set_apart:
        return False
    if one.kind != two.kind or one.kind not in MOVES:
        return False
    at_once = step.parts[0].index == movement.parts[-1].index + 1 and two.t0 - one.tn < ROUNDED_S
    return at_once and not is_end_of_movement(two.t0, moment_at)


def is_end_of_movement(t: float, moment_at: MomentAt) -> bool:
    """Whether a movement ends at a boundary [s]: the hand stops there, or turns and slows.

    The slowest step about the boundary is compared with the lesser of the peaks on both sides. The hand turns
    where its displacements over `NEAR_S` before and after the boundary differ by 45 degrees or more.
    """
    before, after = observed(t - NEAR_S, t), observed(t, t + NEAR_S)
    places = np.array([moment_at(one).position for one in (*before, *after)])
    place = len(before) - 1  # of the step across the boundary
    into, out_of = places[place] - places[0], places[-1] - places[place + 1]
    turns = float(into @ out_of) <= CORNER_COSINE * length(into) * length(out_of)
    ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return slows_at(ways, place, CORNER_SHARE if turns else STOPS_SHARE)

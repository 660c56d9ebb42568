"""The part of a movement that retraces the path of its phase.

A path is cut into pieces of `PIECE_M`. A piece is retraced if an earlier piece of the phase is nearby and has
the same direction. The path between the two must be longer than APART times the distance that counts as
nearby. So a stroke does not retrace itself, and a way back does not retrace the way there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PIECE_M = 0.02
MOST_PIECES, MOST_EARLIER = 150, 300  # of a segment, its last ones; of those before it that are looked at
SAME_DIRECTION = math.cos(math.radians(45.0))
APART = 3.0  # times how near it comes to an earlier piece: how much longer the way between the two is


class Way(NamedTuple):
    """The pieces of a segment's path: their midpoints [m] and displacements [m] (n, 3)."""

    middles: Array
    steps: Array


class Retraced(NamedTuple):
    """The pieces that a segment retraces, as (memory,) by the number of segments its phase has with this one.

    again: number of pieces of the segment that retrace; astray: number of those that do not, although the
    phase has retraced its path before. first: number of the first piece of the phase that is retraced so far,
    infinite if none is. more_outside: increase, by this segment, of the number of pieces before `first`,
    which are not part of a cycle. pieces: number of pieces of the demonstration up to the end of the segment.
    """

    again: Array
    astray: Array
    first: Array
    more_outside: Array
    pieces: int


NO_WAY = Way(np.zeros((0, 3)), np.zeros((0, 3)))


def way_of(places: Array) -> Way:
    """Return the pieces of the path through places (m, 3) [m]; none if it is shorter than one."""
    ends = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    borders = PIECE_M * np.arange(int(ends[-1] / PIECE_M) + 1)[-MOST_PIECES - 1 :]
    at = np.stack([np.interp(borders, ends, axis) for axis in places.T], axis=1)
    return Way(0.5 * (at[1:] + at[:-1]), np.diff(at, axis=0))


def retraced(way: Way, before: Sequence[tuple[Way, Retraced]], near_m: float, memory: int) -> Retraced:
    """Return the pieces that a segment retraces of the segments before it and of itself.

    before: the last one last; near_m: [m] distance of a retraced piece; memory: length of the results.
    """
    pieces = before[-1][1].pieces if before else 0
    first_before = np.append(np.inf, before[-1][1].first[:-1] if before else np.full(memory - 1, np.inf))
    if not len(way.middles):
        return Retraced(np.zeros(memory), np.zeros(memory), first_before, np.zeros(memory), pieces)
    ways, begins = [way], [pieces]
    for other, _ in before[:-memory:-1]:
        if begins[0] - begins[-1] < MOST_EARLIER:
            ways.append(other)
            begins.append(begins[-1] - len(other.middles))
    numbers = np.concatenate(
        [np.arange(begin, begin + len(of.middles)) for begin, of in zip(begins, ways, strict=True)]
    )
    every = Way(*(np.concatenate(of_all) for of_all in zip(*ways, strict=True)))
    follows = _follows(way, every, np.arange(pieces, pieces + len(way.middles))[:, None] - numbers, near_m)
    of_ages = np.cumsum([len(of.middles) for of in ways]) - 1
    found = np.logical_or.accumulate(follows, axis=1)[:, of_ages]
    astray = (np.logical_or.accumulate(found, axis=0) | np.isfinite(first_before[: len(ways)])) & ~found
    first_now = np.minimum.accumulate(np.where(follows.any(axis=0), numbers, np.inf))[of_ages]
    again, astray, first_now, begins_at = (
        np.pad(each, (0, memory - len(ways)), "edge")
        for each in (found.sum(axis=0), astray.sum(axis=0), first_now, begins)
    )
    first = np.minimum(first_before, first_now)
    counted_from = np.where(np.isfinite(first_before), first_before, begins_at)
    more_outside = np.where(np.isfinite(first), first - counted_from, 0.0)
    more_outside[-1] = 0.0  # of a phase whose first segments are no longer looked at
    return Retraced(again, astray, first, more_outside, pieces + len(way.middles))


def _follows(way: Way, other: Way, pieces_between: NDArray[np.int64], near_m: float) -> NDArray[np.bool_]:
    """Return whether each piece retraces one of another path, (n, m).

    pieces_between: from that one to this.
    """
    apart = way.middles[:, None] - other.middles
    near = np.vecdot(apart, apart) < near_m**2
    lengths = np.linalg.norm(way.steps, axis=1)[:, None] * np.linalg.norm(other.steps, axis=1)
    along = way.steps @ other.steps.T > SAME_DIRECTION * lengths
    result: NDArray[np.bool_] = near & along & (PIECE_M * pieces_between > APART * near_m)
    return result

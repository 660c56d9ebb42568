"""Decimation to measured samples: the least and the greatest of each bin and column.

Bins begin at multiples of their width (`bins_of`). Every point is a sample, at its own time. Bins of a finer
grid combine exactly to those of a coarser one, so further decimation needs only the bins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import RecordedSamples

Array = NDArray[np.float64]
ROUNDING = 1e-6  # of a bin: a time that lies before the bin's beginning by less belongs to it


class Extremes(NamedTuple):
    """Bins with at least one sample, m of them; columns c.

    If several samples share an extreme value, the first of them counts. NaN is ignored.
    """

    number: NDArray[np.int64]  # (m,) of the bin, ascending
    t_low: Array  # (m, c) [s]
    low: Array  # (m, c)
    t_high: Array  # (m, c) [s]
    high: Array  # (m, c)

    @property
    def nbytes(self) -> int:
        """Size of all arrays [bytes]."""
        return int(sum(part.nbytes for part in self))


def nothing(columns: int) -> Extremes:
    """Return extremes without any bin. columns: number of columns."""
    none = np.zeros((0, columns))
    return Extremes(np.zeros(0, np.int64), none, none, none, none)


def bins_of(t: Array, bin_s: float) -> NDArray[np.int64]:
    """Return the number of the bin (n,) of each time [s]."""
    return np.floor(t / bin_s + ROUNDING).astype(np.int64)


def extremes_of(index: NDArray[np.int64], t: Array, values: Array) -> Extremes:
    """Return the extremes of samples. index, t: (n,) both ascending; values: (n, c)."""
    times = np.broadcast_to(t[:, None], values.shape)
    return _reduced(Extremes(index, times, values, times, values))


def joined(parts: Sequence[Extremes]) -> Extremes:
    """Return the bins of successive parts; a bin that two parts share is merged."""
    if len(parts) == 1:
        return parts[0]
    number = np.concatenate([part.number for part in parts])
    t_low, low, t_high, high = (np.concatenate([part[i] for part in parts]) for i in range(1, 5))
    return _reduced(Extremes(number, t_low, low, t_high, high))


def coarser(fine: Extremes, every: int) -> Extremes:
    """Return the extremes in bins that are `every` times as wide."""
    return fine if every == 1 else _reduced(fine._replace(number=fine.number // every))


def between(some: Extremes, first: int, last: int) -> Extremes:
    """Return the bins from number `first` to `last`, both included."""
    inside = slice(*np.searchsorted(some.number, (first, last + 1)))
    return _chosen(some, inside)


def of_columns(some: Extremes, columns: Sequence[int]) -> Extremes:
    """Return the bins of some columns; of all columns in their order, the bins as they are."""
    if list(columns) == list(range(some.low.shape[1])):
        return some
    return Extremes(some.number, *(part[:, columns] for part in some[1:]))


def _reduced(some: Extremes) -> Extremes:
    """Merge neighbouring bins with the same number."""
    index = some.number
    starts = np.flatnonzero(np.diff(index, prepend=index[0] - 1)) if index.size else np.zeros(0, np.int64)
    if starts.size == index.size:
        return _chosen(some, slice(None))
    group = np.repeat(np.arange(starts.size), np.diff(starts, append=index.size))
    low = np.fmin.reduceat(some.low, starts)
    high = np.fmax.reduceat(some.high, starts)
    t_low = np.minimum.reduceat(np.where(some.low == low[group], some.t_low, np.inf), starts)
    t_high = np.minimum.reduceat(np.where(some.high == high[group], some.t_high, np.inf), starts)
    return Extremes(index[starts], t_low, low, t_high, high)


def _chosen(some: Extremes, which: slice) -> Extremes:
    """Return a slice of the bins, with copied arrays."""
    t_low, low, t_high, high = (part[which].copy() for part in some[1:])
    return Extremes(some.number[which].copy(), t_low, low, t_high, high)


def points_of(some: Extremes, column: int) -> Array:
    """Return the points (n, 2) of one column: time [s] and value, in the order of time."""
    one = np.stack([some.t_low[:, column], some.low[:, column]], axis=1)
    other = np.stack([some.t_high[:, column], some.high[:, column]], axis=1)
    pairs = np.where(
        (one[:, :1] <= other[:, :1])[:, None], np.stack([one, other], 1), np.stack([other, one], 1)
    )
    is_point = np.isfinite(pairs[:, :, 1])
    is_point[:, 1] &= pairs[:, 0, 0] != pairs[:, 1, 0]
    found: Array = pairs[is_point]
    return found


def packed(points: Sequence[Array]) -> dict[str, Any]:
    """Return the fields `counts` and `points` of a message, from the points (n, 2) of each column."""
    return {
        "counts": tuple(len(one) for one in points),
        "points": b"".join(np.ascontiguousarray(one, dtype="<f8").tobytes() for one in points),
    }


def unpack_points(recorded: RecordedSamples) -> dict[str, Array]:
    """Return the points (n, 2) of each column: time [s] and value. Raises ProtocolError `malformed`."""
    size = 16 * sum(recorded.counts)
    if len(recorded.points) != size or len(recorded.counts) != len(recorded.columns):
        raise ProtocolError(
            "malformed", "points do not fit their counts", value=len(recorded.points), expected=size
        )
    flat = np.frombuffer(recorded.points, dtype="<f8").reshape(-1, 2)
    ends = np.cumsum(recorded.counts)
    return dict(zip(recorded.columns, np.split(flat, ends[:-1]), strict=True)) if recorded.columns else {}

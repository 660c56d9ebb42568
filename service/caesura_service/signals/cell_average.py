"""Means of a piecewise-linear interpolant over grid cells: exact, and bitwise reproducible for each cell.

Each cell's pieces are summed separately (`np.add.reduceat`), from the same knots in every call; a running
integral would round differently for every starting point.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cell_means(edges: Array, samples: Array) -> Array:
    """Mean over each cell of the interpolant through samples, (n, c).

    edges: (n + 1,) [s] cells' borders; samples: (m, 1 + c), ascending times first, spanning the edges.
    Exact for straight lines: the trapezium rule on the pieces between knots, which are edges and samples.
    """
    times = samples[:, 0]
    after = times.searchsorted(edges)  # times[after - 1] < edge <= times[after]
    first, stop = after[0], after[-1]
    order = np.concatenate([edges, times[first:stop]]).argsort(kind="stable")  # an edge before its equal
    knots = np.concatenate([_interpolated(edges, samples, after), samples[first:stop]]).take(order, axis=0)
    areas = knots[1:] + knots[:-1]
    areas *= knots[1:, :1] - knots[:-1, :1]
    sums = np.add.reduceat(areas, after[:-1] - first + np.arange(len(edges) - 1), axis=0)
    sums /= 2.0 * (edges[1:] - edges[:-1])[:, None]
    means: Array = sums[:, 1:]
    return means


def held_values(at: Array, samples: Array) -> Array:
    """Hold each sample (m, 1 + c) until the next: the last at or before each time, (n, c). times[0] <= at."""
    last = samples[:, 0].searchsorted(at, side="right") - 1
    return samples.take(last, axis=0)[:, 1:]


def _interpolated(at: Array, samples: Array, after: NDArray[np.intp]) -> Array:
    """Points (n, 1 + c) of the interpolant; `after` is the first sample at or after each."""
    left = np.maximum(after - 1, 0)
    before = samples.take(left, axis=0)
    points = samples.take(left + 1, axis=0)
    points -= before
    points *= ((at - before[:, 0]) / points[:, 0])[:, None]
    points += before
    points[:, 0] = at
    return points

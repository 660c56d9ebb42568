"""Means of a piecewise-linear interpolant over grid cells: exact, and the same bits for the same cell.

Each cell's pieces are added up by themselves (`np.add.reduceat`), from the same knots whatever else is
computed beside it; a running integral would round differently for every starting point.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def cell_means(edges: Array, times: Array, values: Array) -> Array:
    """Mean over each cell of the interpolant through samples, (n, c).

    edges: (n + 1,) [s] cells' borders; times: (m,) [s] ascending, spanning the edges; values: (m, c).
    Exact for straight lines: the trapezium rule on pieces between samples and edges.
    """
    left = np.maximum(np.searchsorted(times, edges) - 1, 0)  # times[left] < edge <= times[left + 1]
    inside = _strictly_inside(edges, times, left)
    inner = times[inside]
    place = np.searchsorted(inner, edges) + np.arange(len(edges))
    knots = _merged(place, edges, inner)
    heights = _merged(place, _interpolated(edges, times, values, left), values[inside])
    widths = np.diff(knots)
    areas = widths[:, None] * (heights[1:] + heights[:-1])
    sums = np.add.reduceat(areas, place[:-1], axis=0)
    means: Array = sums / (2.0 * np.add.reduceat(widths, place[:-1]))[:, None]
    return means


def held_values(at: Array, times: Array, values: Array) -> Array:
    """Hold each sample until the next: the last one at or before each time, (n, c). times[0] <= at."""
    held: Array = values[np.searchsorted(times, at, side="right") - 1]
    return held


def _interpolated(at: Array, times: Array, values: Array, left: NDArray[np.intp]) -> Array:
    t, v = times[left], values[left]
    fraction = (at - t) / (times[left + 1] - t)
    interpolated: Array = v + fraction[:, None] * (values[left + 1] - v)
    return interpolated


def _strictly_inside(edges: Array, times: Array, left: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mark samples between the edges that do not fall on one: there, the edge itself is the knot."""
    inside: NDArray[np.bool_] = (times > edges[0]) & (times < edges[-1])
    after = left + 1
    inside[after[times[after] == edges]] = False
    return inside


def _merged(place: NDArray[np.intp], at_edges: Array, between: Array) -> Array:
    """Edges' entries at their places, the samples' entries in order in between."""
    merged = np.empty((len(at_edges) + len(between), *at_edges.shape[1:]))
    is_edge = np.zeros(len(merged), dtype=np.bool_)
    is_edge[place] = True
    merged[is_edge], merged[~is_edge] = at_edges, between
    return merged

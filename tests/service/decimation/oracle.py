"""What decimation has to answer, computed sample by sample from what was sent."""

from __future__ import annotations

import math

import numpy as np

from caesura_protocol.derived_columns import DERIVED
from caesura_protocol.messages import RecordedSamples
from caesura_protocol.minmax_decimation import unpack_points


def check(recorded: RecordedSamples, matrix: np.ndarray, columns: tuple[str, ...]) -> int:
    """Every point is a sample, and of every bin both extremes are there; returns the number of points.

    matrix: (n, columns) all samples of the session whose time advances, time first.
    """
    points, counted = unpack_points(recorded), 0
    bins = np.floor(matrix[:, 0] / recorded.bin_s + 1e-6)
    first, last = (math.floor(t / recorded.bin_s + 1e-6) for t in (recorded.t0, recorded.tn))
    inside = matrix[(bins >= first) & (bins <= last)]
    bins = bins[(bins >= first) & (bins <= last)]
    row_at = {t: row for row, t in enumerate(inside[:, 0].tolist())}
    edges = np.flatnonzero(np.diff(bins, prepend=-1e18))
    for name, found in points.items():
        if name in DERIVED:
            continue
        values = inside[:, columns.index(name)]
        rows = [row_at.get(t) for t in found[:, 0].tolist()]
        assert None not in rows, f"{name}: a point is no sample"
        assert (values[rows] == found[:, 1]).all(), f"{name}: a point is no sample"
        assert (np.diff(found[:, 0]) > 0).all()
        wanted = {x for of_bin in np.split(values, edges[1:]) for x in _extremes(of_bin)}
        assert wanted == set(found[:, 1].tolist()), f"{name}: an extreme is missing"
        counted += len(found)
    return counted


def _extremes(values: np.ndarray) -> tuple[float, float]:
    return float(values.min()), float(values.max())

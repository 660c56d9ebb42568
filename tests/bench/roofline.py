"""What a step of the compiled filter costs at least on this machine: bytes and operations, at saxpy's rates.

A step reads and writes the row of every hypothesis, reads the tables' rows and the window, and does the
arithmetic counted in `work_of`. A saxpy loop (y += a x, compiled the same way, arrays of the same size) says
how many bytes and how many operations a second this machine does; a logarithm or exponential counts as
`ELEMENTARY` operations, which is what their polynomials have.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from machine import seconds
from numba import njit

from caesura_service.changepoint.kernels.describe import fields_of
from caesura_service.changepoint.lattice import Lattice
from caesura_service.changepoint.profiled import Profiled

ELEMENTARY = 25


class Work(NamedTuple):
    """Of one step."""

    bytes: float
    operations: float


def work_of(lattice: Lattice, hypotheses: int, window: int) -> Work:
    """Bytes touched and floating-point operations done by one step."""
    profiled = [model for model in lattice.channels.values() if isinstance(model, Profiled)]
    row = 2 * fields_of(lattice)
    tables = sum(4 * len(model.library) for model in profiled)
    smoothing = window * (window + 1) / 2
    numbers = hypotheses * (row + tables + 2 * len(lattice.kinds)) + 2 * smoothing
    operations = smoothing * (4 + ELEMENTARY)
    for model in profiled:
        count, axes = len(model.library), 3
        each = axes * count * (2 + 4)  # Σ w y φ, and what it explains
        if model.library.calm < 1.0:
            each += axes * count * 3  # Σ w y², by profile
        if model.choice == "mixture":
            each += (
                count * len(model.noise.shares) * (1 if model.noise.joint else axes) * (2 * ELEMENTARY + 4)
            )
        else:
            each += count * axes
        operations += hypotheses * each
    operations += hypotheses * (len(lattice.channels) * 3 * ELEMENTARY + len(lattice.kinds) * ELEMENTARY)
    return Work(8.0 * numbers, float(operations))


def saxpy_rates(size: int) -> Work:
    """Bytes and operations a second of a saxpy loop over arrays of so many bytes together."""
    n = max(size // 16, 64)
    x, y = np.ones(n), np.ones(n)
    times = max(1, 4_000_000 // n)
    _saxpy(x, y, 1e-9, 1)
    best = min(seconds(lambda: _saxpy(x, y, 1e-9, times)) for _ in range(9))
    return Work(24.0 * n * times / best, 2.0 * n * times / best)


def least_seconds(work: Work, rates: Work) -> float:
    """The larger of what the bytes take and what the operations take."""
    return max(work.bytes / rates.bytes, work.operations / rates.operations)


@njit(error_model="numpy")
def _saxpy(x, y, a, times):  # type: ignore[no-untyped-def]
    for _ in range(times):
        for i in range(x.size):
            y[i] += a * x[i]

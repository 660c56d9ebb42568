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

from caesura_service.changepoint.kernels.model_set_conversion import fields_of
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.segment_model_set import SegmentModelSet

ELEMENTARY = 25


class Work(NamedTuple):
    """Of one step."""

    bytes: float
    operations: float


def work_of(lattice: SegmentModelSet, hypotheses: int, window: int) -> Work:
    """Bytes touched and floating-point operations done by one step."""
    profiled = [model for model in lattice.channels.values() if isinstance(model, ProfileModel)]
    kinds, channels = len(lattice.kinds), len(lattice.channels)
    smoothing = window * (window + 1) / 2  # probabilities of where a segment began that ended in the window
    numbers = 2.0 * fields_of(lattice) + 2 * kinds  # of a hypothesis
    operations = float((3 * channels + kinds) * ELEMENTARY)
    for model in profiled:
        more, work = of_profile(model)
        numbers += len(model.library) * more
        operations += len(model.library) * work
    total = hypotheses * operations + 2 * smoothing + window * ELEMENTARY
    return Work(8.0 * (hypotheses * numbers + smoothing), total)


def of_profile(model: ProfileModel) -> tuple[int, float]:
    """Numbers read or written and operations done for a hypothesis and a profile."""
    axes, shares, groups = 3, len(model.noise.shares), 1 if model.noise.joint else 3
    uneven, mixture = model.library.rest_scale_ratio < 1.0, model.choice == "mixture"
    numbers = 2 * axes + 2 * groups * uneven  # Σwyφ, and Σwy² where it is one's own, read and written
    numbers += 2 + uneven + mixture  # φw, Σφ²w, w, Σ log scale
    operations = axes * (2 + 4) + axes * 3 * uneven  # Σwyφ, and what it explains; Σwy²
    weighing = groups * shares * (2 * ELEMENTARY + 4) if mixture else axes
    return numbers, float(operations + weighing)


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

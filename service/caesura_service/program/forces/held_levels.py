"""Divides a press where its force changes from one level that was held to another.

A hand that presses with 10 N, then with 6 N, and then with 10 N again teaches three presses. A level is held
if it keeps within a narrow band for a second, less an observation of the change. A force that rises or sways
all the time has no levels.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_service.program.forces.held_forces import (
    HELD_OBSERVATIONS,
    decimation,
    forces_felt,
    other_force_n,
)
from caesura_service.program.program_segment import (
    PUSHES_BACK_N,
    ROUNDED_S,
    TOUCHED_S,
    MomentAt,
    ProgramSegment,
    observed,
    parts_at,
)

BAND = 0.5  # of the least difference between two levels: within it a force is held
BAND_QUANTILES = 0.1, 0.9  # of the observations of a level that keep within it

Array = NDArray[np.float64]


class _Level(NamedTuple):
    """A force that was held from one observation to another, the last one left out."""

    first: int
    end: int
    newton: float


def divided_at_levels(
    steps: Sequence[ProgramSegment], base: Vector, begun: float, moment_at: MomentAt
) -> list[list[ProgramSegment]]:
    """Return the steps of a press, divided where another level of force begins; each part has its own force.

    base: the force [N] before the contact; begun: the time [s] from which on it is pressed. A press with a
    way, or one that an operator has set, is whole, as is one with forces that are not known.
    """
    times = [t for step in steps for t in observed(step.segment.t0, step.segment.tn) if t >= begun]
    times = times[:: decimation(len(times))]
    rests = all(step.segment.kind == "contact" and not step.segment.corrected for step in steps)
    felt = forces_felt(base, times, moment_at) if rests else np.empty((0, 3))
    newtons = np.linalg.norm(felt, axis=1)
    ranges = held_levels(newtons) if len(felt) == len(times) else []
    if len(ranges) < 2:
        return [[*steps]]
    cuts = [times[first] - TOUCHED_S for first, _ in ranges[1:]]
    forces = [_mean_held(felt[first:end], newtons[first:end]) + base for first, end in ranges]
    pieces = [piece for step in steps for piece in _pieces(step, cuts, moment_at)]
    parts = groupby(pieces, key=lambda piece: bisect(cuts, 0.5 * (piece.segment.t0 + piece.segment.tn)))
    return [[_pressing(piece, forces[level]) for piece in part] for level, part in parts]


def _pieces(step: ProgramSegment, cuts: Sequence[float], moment_at: MomentAt) -> Iterator[ProgramSegment]:
    """Yield the parts of a step between times [s]; what lies before and after it belongs to its ends."""
    inside = [t for t in cuts if step.segment.t0 + ROUNDED_S < t < step.segment.tn - ROUNDED_S]
    if not inside:
        yield step
        return
    first, *others = parts_at(step, inside, moment_at)
    yield replace(first, rests_after=())
    for piece in others:
        is_last = piece is others[-1]
        yield replace(piece, rests_before=(), approach=(), rests_after=step.rests_after if is_last else ())


def _mean_held(felt: Array, newtons: Array) -> Array:
    """Return the mean (3,) [N] of the forces (n, 3) near the median size: without touch and release."""
    middle = float(np.median(newtons))
    mean: Array = felt[np.abs(newtons - middle) <= BAND * other_force_n(middle)].mean(axis=0)
    return mean


def _pressing(step: ProgramSegment, force: Array) -> ProgramSegment:
    """Return a step with a force (3,) [N] as the one that was held."""
    held = tuple(force.tolist())
    return replace(step, segment=step.segment.model_copy(update={"force_held": held}))


def held_levels(newtons: Array) -> list[tuple[int, int]]:
    """Return the first and the end of each range of observations with one held level, in order.

    The ranges cover all observations; a single one where no other level was held. newtons: (n,) sizes [N].
    """
    levels = [level for level in _levels(newtons) if _is_held(level, newtons)]
    edges = [0, *(_cut(one, two, newtons) for one, two in pairwise(levels)), len(newtons)]
    return list(pairwise(edges))


def _levels(newtons: Array) -> list[_Level]:
    """Return the levels of the steady windows, in order: successive windows with one force are one level."""
    if len(newtons) < HELD_OBSERVATIONS:
        return []
    windows = np.sort(sliding_window_view(newtons, HELD_OBSERVATIONS), axis=1)
    middles = windows[:, HELD_OBSERVATIONS // 2]
    spread = windows[:, -2] - windows[:, 1]  # one observation beside a level belongs to the change
    steady = (spread <= BAND * other_force_n(middles)) & (windows[:, 1] >= PUSHES_BACK_N)
    levels: list[_Level] = []
    for first in np.flatnonzero(steady).tolist():
        newton, end = float(middles[first]), first + HELD_OBSERVATIONS
        last = levels[-1] if levels else None
        if last is None or abs(newton - last.newton) >= other_force_n(max(newton, last.newton)):
            levels.append(_Level(first, end, newton))
        else:
            whole = float(np.median(newtons[last.first : end]))
            levels[-1] = _Level(last.first, end, whole)
    return levels


def _is_held(level: _Level, newtons: Array) -> bool:
    inside = newtons[level.first + 1 : level.end - 1]  # either end may belong to the change
    low, high = np.quantile(inside, BAND_QUANTILES)
    return bool(high - low <= BAND * other_force_n(level.newton))


def _cut(one: _Level, two: _Level, newtons: Array) -> int:
    """Return the first observation between two levels that is nearer to the second."""
    begin = max(min(one.end, two.first) - 1, one.first + 1)
    between = newtons[begin : two.first + 2]  # a window may begin with one observation of the change
    nearer = np.flatnonzero(np.abs(between - two.newton) < np.abs(between - one.newton))
    return begin + int(nearer[0]) if len(nearer) else two.first

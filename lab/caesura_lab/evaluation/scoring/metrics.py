"""Measures of a segmentation, pure functions of times. Numbers per recording are in `score`.

A changepoint is right if it is within a true point's tolerance; each point is paired with at most one. Of all
such pairings the one with the most found points is chosen, then with the most optional points, then the
closest. So it does not depend on any order.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_lab.evaluation.scoring.linear_assignment import best_pairs

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
ROUNDING_S = 1e-9  # a point at its tolerance is within it


@dataclass(frozen=True)
class Matching:
    """Pairing: for each found changepoint the index of its true point, -1 for none.

    partner: (m,); optional: (p,) of the true points.
    """

    partner: Indices
    optional: NDArray[np.bool_]

    @property
    def hits(self) -> Indices:
        """The true points that must be found and were."""
        matched = self.partner[self.partner >= 0]
        return np.sort(matched[~self.optional[matched]])

    @property
    def misses(self) -> Indices:
        """The true points that must be found and were not."""
        return np.setdiff1d(np.flatnonzero(~self.optional), self.hits)

    @property
    def false_alarms(self) -> Indices:
        """The found changepoints without a true point."""
        return np.flatnonzero(self.partner < 0)

    @property
    def counted(self) -> Indices:
        """The found changepoints that count: all except those paired with an optional point."""
        excused = np.append(self.optional, False)[self.partner]
        return np.flatnonzero(~excused)


def match(
    points_s: ArrayLike,
    tolerances_s: ArrayLike,
    optional: ArrayLike,
    found_s: ArrayLike,
    alternatives_s: ArrayLike | None = None,
) -> Matching:
    """Pair found changepoints with true points one to one, by the rules of this module.

    points_s, tolerances_s: (p,) [s]; optional: (p,) bool; found_s: (m,) [s]; alternatives_s: (p,) [s] second
    accepted times, nan where there is none. The nearer of the two counts.
    """
    points, tolerances = np.asarray(points_s, dtype=float), np.asarray(tolerances_s, dtype=float)
    optional, found = np.asarray(optional, dtype=bool), np.asarray(found_s, dtype=float)
    distance = np.abs(found[:, None] - points)
    if alternatives_s is not None:
        distance = np.fmin(distance, np.abs(found[:, None] - np.asarray(alternatives_s, dtype=float)))
    within = distance <= tolerances + ROUNDING_S
    # Every weight exceeds what all that rank below it can add up to.
    closeness = distance / (tolerances + ROUNDING_S) / (2.0 * (found.size + 1))
    gain = np.where(within, np.where(optional, 1.0, found.size + 2.0) - closeness, 0.0)
    rows, columns = best_pairs(gain)
    partner = np.full(found.size, -1, dtype=np.intp)
    kept = within[rows, columns]
    partner[rows[kept]] = columns[kept]
    return Matching(partner, optional)


def f1(hits: float, false_alarms: float, misses: float) -> float:
    """Return the harmonic mean of precision and recall.

    1 if there was nothing to find and nothing was found.
    """
    total = 2 * hits + false_alarms + misses
    return 2 * hits / total if total else 1.0


def covering(truth_s: ArrayLike, found_s: ArrayLike, window: tuple[float, float]) -> float:
    """Return how well found segments cover the true ones: mean best Jaccard index, weighted by length.

    truth_s, found_s: boundaries inside of the window [s]. Arbeláez et al. 2011; van den Burg & Williams
    2020, (7).
    """
    truth, found = (_stretches(times, window) for times in (truth_s, found_s))
    common = np.minimum(truth[:, None, 1], found[:, 1]) - np.maximum(truth[:, None, 0], found[:, 0])
    length, other = np.diff(truth)[:, 0], np.diff(found)[:, 0]
    jaccard = np.maximum(common, 0.0) / (length[:, None] + other - common)
    return float(length @ jaccard.max(axis=1) / length.sum())


def segments_with_events(
    boundaries_s: ArrayLike, events_s: ArrayLike, window: tuple[float, float]
) -> tuple[int, int]:
    """Return the number of segments between boundaries that contain an event, and of all segments.

    With true boundaries and false alarms it measures over-segmentation; with found boundaries and misses,
    under-segmentation.
    """
    edges = _stretches(boundaries_s, window)
    events = np.asarray(events_s, dtype=float)
    inside = (edges[:, :1] <= events) & (events < edges[:, 1:])
    return int(inside.any(axis=1).sum()), len(edges)


class Labelled(NamedTuple):
    """A time interval [s] with a class."""

    t0: float
    t1: float
    kind: str


def confusion(truth: Iterable[Labelled], found: Sequence[Labelled]) -> Counter[tuple[str, str]]:
    """Return the seconds for each pair of true and found class; "none" where the method has no class."""
    seconds: Counter[tuple[str, str]] = Counter()
    for true in truth:
        left = true.t1 - true.t0
        for part in found:
            shared = overlap(true, part)
            if shared > 0.0:
                seconds[true.kind, part.kind] += shared  # type: ignore[assignment]
                left -= shared
        if left > ROUNDING_S:
            seconds[true.kind, "none"] += left  # type: ignore[assignment]
    return seconds


class Interval(Protocol):
    """An interval of time, from t0 to t1 [s]."""

    @property
    def t0(self) -> float:
        """The begin [s] of the interval."""

    @property
    def t1(self) -> float:
        """The end [s] of the interval."""


def overlap(one: Interval, other: Interval) -> float:
    """Return the common seconds of two intervals, negative if they are apart."""
    return min(one.t1, other.t1) - max(one.t0, other.t0)


class TimedEstimate(NamedTuple):
    """An estimate from samples up to t [s]: changepoints (m,) [s], and which of them were final."""

    t: float
    changepoints: Sequence[float]
    final: Sequence[bool]


def paired_since(
    timed_estimates: Iterable[TimedEstimate],
    points_s: ArrayLike,
    tolerances_s: ArrayLike,
    optional: ArrayLike,
    alternatives_s: ArrayLike | None = None,
    *,
    final: bool,
) -> list[float | None]:
    """Return for each true point the time [s] since which a changepoint is continuously paired with it.

    Every estimate is paired by `match`, with the same arguments, so that a changepoint stands for one point
    only. None for a point that the last estimate does not find. final: only those that were final count.
    """
    since: list[float | None] = [None] * np.asarray(points_s).size
    for estimate in timed_estimates:
        shown = [
            t for t, sure in zip(estimate.changepoints, estimate.final, strict=True) if sure or not final
        ]
        found = set(match(points_s, tolerances_s, optional, shown, alternatives_s).partner.tolist())
        since = [
            (estimate.t if begun is None else begun) if i in found else None for i, begun in enumerate(since)
        ]
    return since


def withdrawn(timed_estimates: Iterable[TimedEstimate], follow_s: float) -> tuple[list[float], list[float]]:
    """Return the last times [s] of shown changepoints that vanished again, and of those that stayed.

    A changepoint goes on as the one of the next estimate that `match` pairs with it within follow_s [s].
    """
    gone: list[float] = []
    stayed: list[float] = []
    for estimate in timed_estimates:
        shown, tolerances = list(estimate.changepoints), [follow_s] * len(stayed)
        followed = set(match(stayed, tolerances, [False] * len(stayed), shown).partner.tolist())
        gone += [t for i, t in enumerate(stayed) if i not in followed]
        stayed = shown
    return gone, stayed


def _stretches(boundaries_s: ArrayLike, window: tuple[float, float]) -> Array:
    """Return start and end of each interval between boundaries, (k, 2) [s]."""
    times = np.unique(np.asarray(boundaries_s, dtype=float))
    inside = times[(times > window[0]) & (times < window[1])]
    edges = np.concatenate([window[:1], inside, window[1:]])
    return np.column_stack([edges[:-1], edges[1:]])

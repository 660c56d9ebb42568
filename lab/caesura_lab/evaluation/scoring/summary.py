"""Summarises the scores of one method as numbers with intervals.

Counts are pooled over recordings, so a long recording weighs more than a short one. Intervals are percentile
bootstrap over subjects (Efron & Tibshirani 1993, chapter 13; Davison & Hinkley 1997, section 3.8). A subject
is a simulated person with all scenarios, or a real demonstration with everything that was made of it: both
arms, other sensors, other starts. Recordings of one subject are not independent. So intervals describe
another sample of persons, not of points, and of the same tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.scoring.score import Score

Array = NDArray[np.float64]
RESAMPLES = 1000
COVERAGE = 0.95


@dataclass(frozen=True)
class Estimate:
    """A value and its interval; n: number of cases. Value of nan: no cases; interval of nan: one subject."""

    value: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Measure:
    """A column of the tables: its name, unit, and whether a larger value is better."""

    name: str
    unit: str
    estimates_of: Callable[[Sequence[Score], Array], tuple[Array, int]]
    higher_is_better: bool = True


def summarise(
    scores: Sequence[Score],
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
    only: Collection[str] | None = None,
) -> dict[str, Estimate]:
    """Return every measure of one method's scores, with its interval; deterministic.

    only: names of measures, None for all.
    """
    subjects = list(map(_subject, scores))
    weights = _weights(subjects, resamples, seed)
    return {
        measure.name: _estimate(*measure.estimates_of(scores, weights), subjects)
        for measure in _measures(only)
    }


def margins(
    own: Sequence[Score],
    others: Sequence[Score],
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
    only: Collection[str] | None = None,
) -> dict[str, Estimate]:
    """Return the difference between two methods in every measure, on their common recordings.

    Both have the same resamples, so that a recording that is hard for both does not widen the interval. only:
    as for `summarise`.
    """
    own_by_recording, other_by_recording = (
        {score.recording: score for score in scores} for scores in (own, others)
    )
    names = sorted(set(own_by_recording) & set(other_by_recording))
    subjects = [_subject(own_by_recording[name]) for name in names]
    weights = _weights(subjects, resamples, seed)
    differences = {}
    for measure in _measures(only):
        (a, n), (b, m) = (
            measure.estimates_of([scores[name] for name in names], weights)
            for scores in (own_by_recording, other_by_recording)
        )
        differences[measure.name] = _estimate(a - b, min(n, m), subjects)
    return differences


def _measures(only: Collection[str] | None) -> list[Measure]:
    return [measure for measure in MEASURES if only is None or measure.name in only]


def _subject(score: Score) -> str:
    return score.subject or score.recording


def _weights(subjects: Sequence[str], resamples: int, seed: int) -> Array:
    """Return counts of each of n recordings, (1 + resamples, n): 1 each, then those of drawn subjects.

    subjects: (n,) of the recordings; they are drawn with replacement, with all their recordings.
    """
    number = {subject: i for i, subject in enumerate(dict.fromkeys(subjects))}
    n = len(number)
    draws = np.random.default_rng(seed).multinomial(n, np.full(n, 1.0 / n), size=resamples)
    return np.vstack([np.ones(len(subjects)), draws[:, [number[subject] for subject in subjects]]])


def _estimate(values: Array, n: int, subjects: Sequence[str]) -> Estimate:
    """Return an estimate: the first value is that of the recordings, all others are of resamples.

    One subject alone shows no scatter, so it has no interval.
    """
    sound = values[1:][np.isfinite(values[1:])]
    if n == 0 or not sound.size:
        return Estimate(float("nan"), float("nan"), float("nan"), n)
    if len(set(subjects)) == 1:
        return Estimate(float(values[0]), float("nan"), float("nan"), n)
    low, high = np.quantile(sound, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return Estimate(float(values[0]), float(low), float(high), n)


def _ratio(
    parts: Callable[[Score], tuple[float, float]],
) -> Callable[[Sequence[Score], Array], tuple[Array, int]]:
    """Return a function for the sum over recordings of the first part over the sum of the second."""

    def estimates_of(scores: Sequence[Score], weights: Array) -> tuple[Array, int]:
        counts = np.array([parts(score) for score in scores], dtype=float)  # (n, 2)
        above, below = (weights @ counts).T
        with np.errstate(invalid="ignore", divide="ignore"):
            return above / below, int(np.ceil(counts[:, 1].sum()))

    return estimates_of


def _quantile(
    values: Callable[[Score], Sequence[float]], share: float
) -> Callable[[Sequence[Score], Array], tuple[Array, int]]:
    """Return a function for the quantile at `share` of all values of all recordings."""

    def estimates_of(scores: Sequence[Score], weights: Array) -> tuple[Array, int]:
        pooled = [(value, i) for i, score in enumerate(scores) for value in values(score)]
        if not pooled:
            return np.full(len(weights), np.nan), 0
        pooled.sort()
        sorted_values = np.array([value for value, _ in pooled])
        mass = np.cumsum(weights[:, [i for _, i in pooled]], axis=1)  # (1 + resamples, values)
        reached = (mass >= share * mass[:, -1:]).argmax(axis=1)
        return np.where(mass[:, -1] > 0, sorted_values[reached], np.nan), len(pooled)

    return estimates_of


def _right(seconds: Mapping[tuple[str, str], float]) -> tuple[float, float]:
    return sum(s for (true, found), s in seconds.items() if true == found), sum(seconds.values())


def _found_f1(score: Score) -> tuple[float, float]:
    return 2.0 * score.hits, 2.0 * score.hits + score.false_alarms + score.misses


def _strict_f1(score: Score) -> tuple[float, float]:
    found, total = _found_f1(score)
    return found, total + score.excused


def _excused(score: Score) -> tuple[float, float]:
    return score.excused, score.excused + score.hits + score.false_alarms


def _phase_f1(score: Score) -> tuple[float, float]:
    return 2.0 * score.phase_hits, 2.0 * score.phase_hits + score.phase_false_alarms + score.phase_misses


MEASURES = (
    Measure("precision", "", _ratio(lambda s: (s.hits, s.hits + s.false_alarms))),
    Measure("recall", "", _ratio(lambda s: (s.hits, s.hits + s.misses))),
    Measure("f1", "", _ratio(_found_f1)),
    Measure("excused", "", _ratio(_excused), higher_is_better=False),
    Measure("strict_f1", "", _ratio(_strict_f1)),
    Measure("covering", "", _ratio(lambda s: (s.covering, 1.0))),
    Measure("over", "", _ratio(lambda s: s.cut), higher_is_better=False),
    Measure("under", "", _ratio(lambda s: s.merged), higher_is_better=False),
    Measure("class", "", _ratio(lambda s: _right(s.confusion))),
    Measure("class_inside", "", _ratio(lambda s: _right(s.confusion_inside))),
    Measure("provisional_median", "s", _quantile(lambda s: s.provisional_s, 0.5), higher_is_better=False),
    Measure("provisional_p90", "s", _quantile(lambda s: s.provisional_s, 0.9), higher_is_better=False),
    Measure("final_median", "s", _quantile(lambda s: s.final_s, 0.5), higher_is_better=False),
    Measure("final_p90", "s", _quantile(lambda s: s.final_s, 0.9), higher_is_better=False),
    Measure("withdrawn", "", _ratio(lambda s: s.withdrawn), higher_is_better=False),
    Measure(
        "interval_right", "", _ratio(lambda s: (sum(right for _, right in s.intervals), len(s.intervals)))
    ),
    Measure(
        "interval_median",
        "s",
        _quantile(lambda s: [length for length, _ in s.intervals], 0.5),
        higher_is_better=False,
    ),
    Measure(
        "load_error",
        "kg",
        _ratio(lambda s: (sum(s.load_errors_kg), len(s.load_errors_kg))),
        higher_is_better=False,
    ),
    Measure("loads_found", "", _ratio(lambda s: (len(s.load_errors_kg), s.loads))),
    Measure(
        "force_error",
        "N",
        _ratio(lambda s: (sum(s.force_errors_n), len(s.force_errors_n))),
        higher_is_better=False,
    ),
    Measure("forces_found", "", _ratio(lambda s: (len(s.force_errors_n), s.forces))),
    Measure("axis_error", "°", _quantile(lambda s: s.axis_errors_deg, 0.5), higher_is_better=False),
    Measure("axis_p90", "°", _quantile(lambda s: s.axis_errors_deg, 0.9), higher_is_better=False),
    Measure("pitch_error", "", _quantile(lambda s: s.pitch_errors, 0.5), higher_is_better=False),
    Measure("pitch_p90", "", _quantile(lambda s: s.pitch_errors, 0.9), higher_is_better=False),
    Measure("screws_found", "", _ratio(lambda s: (len(s.axis_errors_deg), s.screws))),
    Measure("phase_precision", "", _ratio(lambda s: (s.phase_hits, s.phase_hits + s.phase_false_alarms))),
    Measure("phase_recall", "", _ratio(lambda s: (s.phase_hits, s.phase_hits + s.phase_misses))),
    Measure("phase_f1", "", _ratio(_phase_f1)),
)

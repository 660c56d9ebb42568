"""Typical errors: what a method misses, where it cuts needlessly, and what it takes for what.

For whoever improves the models. Sorted by how often, so that the first line is what is worth most.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from caesura_service.judge.score import Score


@dataclass(frozen=True)
class Missed:
    """True points of one kind between two classes: how many were missed of all of that kind.

    near: for how many a changepoint lay within a second but out of tolerance; offset_s: their median, later
    is positive.
    """

    kind: str
    between: str
    missed: int
    of_kind: int
    near: int
    offset_s: float | None


@dataclass(frozen=True)
class Invented:
    """False alarms within one true class between two found ones."""

    within: str
    between: str
    times: int


@dataclass(frozen=True)
class Faults:
    """All typical errors of one method. confusion: (true, found) → seconds."""

    missed: tuple[Missed, ...]
    invented: tuple[Invented, ...]
    confusion: Counter[tuple[str, str]]


def faults(scores: Iterable[Score]) -> Faults:
    """The typical errors in the scores of one method."""
    scores = list(scores)
    seconds: Counter[tuple[str, str]] = Counter()
    for score in scores:
        seconds.update(score.confusion)
    return Faults(_missed(scores), _invented(scores), seconds)


def _missed(scores: Sequence[Score]) -> tuple[Missed, ...]:
    all_missed = [miss for score in scores for miss in score.missed]
    of_kind = Counter(miss.kind for miss in all_missed)
    for score in scores:
        of_kind.update(score.found_kinds)
    grouped = Counter((miss.kind, miss.between) for miss in all_missed)
    rows = []
    for (kind, between), times in grouped.most_common():
        group = [m for m in all_missed if (m.kind, m.between) == (kind, between)]
        offsets = [m.offset_s for m in group if m.offset_s is not None]
        middle = median(offsets) if offsets else None
        rows.append(Missed(kind, between, times, of_kind[kind], len(offsets), middle))
    return tuple(rows)


def _invented(scores: Sequence[Score]) -> tuple[Invented, ...]:
    counted = Counter(alarm for score in scores for alarm in score.alarms)
    return tuple(Invented(*alarm, times) for alarm, times in counted.most_common())

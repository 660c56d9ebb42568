"""Typical errors of a method: missed points, false alarms, and confused classes.

It is for developers of the models. Errors are sorted by frequency, the most frequent first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from caesura_lab.evaluation.scoring.score import Score
from caesura_lab.evaluation.scoring.summary import summarise


@dataclass(frozen=True)
class MissedGroup:
    """True points of one kind between two classes: how many were missed of all of that kind.

    near: number with a changepoint within a second and out of tolerance; offset_s: their median offset,
    positive if later.
    """

    kind: str
    between: str
    missed: int
    of_kind: int
    near: int
    offset_s: float | None


@dataclass(frozen=True)
class OffsetGroup:
    """The delay [s] of changepoints of one kind after the true ones: median, and ends of the middle 80 %."""

    kind: str
    times: int
    median_s: float
    low_s: float
    high_s: float


@dataclass(frozen=True)
class TagGroup:
    """The recordings with one common tag."""

    tag: str
    recordings: int
    precision: float
    recall: float
    class_accuracy: float


@dataclass(frozen=True)
class FalseAlarmGroup:
    """False alarms within one true class between two found ones."""

    within: str
    between: str
    times: int


@dataclass(frozen=True)
class ErrorSummary:
    """All typical errors of one method. confusion: (true, found) → seconds."""

    missed: tuple[MissedGroup, ...]
    invented: tuple[FalseAlarmGroup, ...]
    confusion: Counter[tuple[str, str]]
    timings: tuple[OffsetGroup, ...]
    groups: tuple[TagGroup, ...]


def error_summary(scores: Iterable[Score]) -> ErrorSummary:
    """Return the typical errors in the scores of one method."""
    scores = list(scores)
    seconds: Counter[tuple[str, str]] = Counter()
    for score in scores:
        seconds.update(score.confusion)
    return ErrorSummary(_missed(scores), _false_alarms(scores), seconds, _timings(scores), _groups(scores))


def _missed(scores: Sequence[Score]) -> tuple[MissedGroup, ...]:
    all_missed = [miss for score in scores for miss in score.missed]
    of_kind = Counter(miss.kind for miss in all_missed)
    for score in scores:
        of_kind.update(hit.kind for hit in score.found)
    grouped = Counter((miss.kind, miss.between) for miss in all_missed)
    rows = []
    for (kind, between), times in grouped.most_common():
        group = [m for m in all_missed if (m.kind, m.between) == (kind, between)]
        offsets = [m.offset_s for m in group if m.offset_s is not None]
        middle = median(offsets) if offsets else None
        rows.append(MissedGroup(kind, between, times, of_kind[kind], len(offsets), middle))
    return tuple(rows)


def _false_alarms(scores: Sequence[Score]) -> tuple[FalseAlarmGroup, ...]:
    counted = Counter(alarm for score in scores for alarm in score.alarms)
    return tuple(FalseAlarmGroup(*alarm, times) for alarm, times in counted.most_common())


def _timings(scores: Sequence[Score]) -> tuple[OffsetGroup, ...]:
    hits = [hit for score in scores for hit in score.found]
    rows = []
    for kind, times in Counter(hit.kind for hit in hits).most_common():
        low, middle, high = np.quantile([hit.offset_s for hit in hits if hit.kind == kind], (0.1, 0.5, 0.9))
        rows.append(OffsetGroup(kind, times, float(middle), float(low), float(high)))
    return tuple(rows)


def _groups(scores: Sequence[Score]) -> tuple[TagGroup, ...]:
    tags = sorted({place_and_tag for score in scores for place_and_tag in enumerate(score.tags)})
    return tuple(_group(tag, [score for score in scores if tag in score.tags]) for _, tag in tags)


def _group(tag: str, scores: Sequence[Score]) -> TagGroup:
    numbers = {name: summarise(scores, resamples=1)[name].value for name in ("precision", "recall", "class")}
    return TagGroup(tag, len(scores), numbers["precision"], numbers["recall"], numbers["class"])

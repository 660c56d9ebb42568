"""The report of the judge: all verdicts by method, and the columns of the tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from caesura_lab.evaluation.reports.error_analysis import ErrorSummary, error_summary
from caesura_lab.evaluation.runner import NotApplicable, Verdict
from caesura_lab.evaluation.scoring.score import PHASE_S, Score
from caesura_lab.evaluation.scoring.summary import MEASURES, Estimate, margins, summarise

UNITS = {measure.name: measure.unit for measure in MEASURES}


@dataclass(frozen=True)
class Column:
    """A column: its heading, its measure, and its number of digits."""

    heading: str
    measure: str
    digits: int = 2


BOUNDARIES = (
    Column("precision", "precision"),
    Column("recall", "recall"),
    Column("F1", "f1"),
    Column("covering", "covering"),
    Column("over", "over"),
    Column("under", "under"),
)
EXCUSED = (
    Column("excused", "excused"),
    Column("strict F1", "strict_f1"),
)
CLASSES = (
    Column("class", "class"),
    Column("inside", "class_inside"),
    Column("load [kg]", "load_error", 3),
    Column("weighed", "loads_found"),
    Column("force [N]", "force_error"),
    Column("felt", "forces_found"),
)
DELAYS = (
    Column("shown [s]", "provisional_median"),
    Column("shown p90", "provisional_p90"),
    Column("final [s]", "final_median"),
    Column("final p90", "final_p90"),
    Column("withdrawn", "withdrawn"),
    Column("90 % [s]", "interval_median"),
    Column("right", "interval_right"),
)
PHASES = (
    Column("precision", "phase_precision"),
    Column("recall", "phase_recall"),
    Column("F1", "phase_f1"),
)
SCREWS = (
    Column("axis [°]", "axis_error", 1),
    Column("axis p90", "axis_p90", 1),
    Column("pitch", "pitch_error", 3),
    Column("pitch p90", "pitch_p90", 3),
    Column("found", "screws_found"),
)
MARGINS = (
    Column("F1", "f1"),
    Column("strict F1", "strict_f1"),
    Column("covering", "covering"),
    Column("class", "class"),
)
IN_SETS = (
    Column("precision", "precision"),
    Column("recall", "recall"),
    Column("F1", "f1"),
    Column("class", "class"),
)
SET_MARGINS = (Column("F1 over", "f1"), Column("class over", "class"))
TABLES = (
    ("boundaries", BOUNDARIES),
    ("changepoints that optional points excuse; F1 if they count as false alarms", EXCUSED),
    ("classes, load and force", CLASSES),
    ("delays, and intervals of 90 %", DELAYS),
    (f"boundaries between phases, within {PHASE_S:g} s", PHASES),
    ("screws that are driven: error of their axis, relative error of their pitch", SCREWS),
)


@dataclass(frozen=True)
class MethodReport:
    """One method: its numbers, the number of recordings, and its typical errors."""

    method: str
    recordings: int
    estimates: dict[str, Estimate]
    faults: ErrorSummary
    scores: tuple[Score, ...]
    behind: dict[str, Estimate] = field(default_factory=dict)  # by how much the first method exceeds it


@dataclass(frozen=True)
class MethodComparison:
    """One method on the recordings of one set: its numbers, and the first method's margins over it."""

    method: str
    recordings: int
    estimates: dict[str, Estimate]
    behind: dict[str, Estimate]


@dataclass(frozen=True)
class SlackSection:
    """Everything under one slack [s]: all recordings pooled, and set by set where they form sets."""

    slack_s: float
    methods: tuple[MethodReport, ...]
    sets: Mapping[str, tuple[MethodComparison, ...]]


@dataclass(frozen=True)
class Report:
    """All results, in the order of the methods; the first is compared with all others.

    sections: one a slack, the least first; missing: notes on recordings that were not there.
    """

    title: str
    sections: tuple[SlackSection, ...]
    unfit: tuple[NotApplicable, ...]
    missing: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[MethodReport, ...]:
        """Return the pooled results under the least slack."""
        return self.sections[0].methods if self.sections else ()


def report(
    title: str, methods: Sequence[str], verdicts: Iterable[Verdict], missing: Sequence[str] = ()
) -> Report:
    """Make a report of verdicts in any order."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.recording)
    unfit = tuple(verdict for verdict in ordered if isinstance(verdict, NotApplicable))
    scores = [verdict for verdict in ordered if isinstance(verdict, Score)]
    slacks = sorted({score.slack_s for score in scores})
    sections = tuple(_section(slack, methods, [s for s in scores if s.slack_s == slack]) for slack in slacks)
    return Report(title, sections, unfit, tuple(missing))


def _section(slack_s: float, methods: Sequence[str], scores: Sequence[Score]) -> SlackSection:
    judged: list[MethodReport] = []
    for name, own in _by_method(methods, scores).items():
        behind = _margins(judged[0].scores, own) if judged else {}
        judged.append(MethodReport(name, len(own), summarise(own), error_summary(own), own, behind))
    return SlackSection(slack_s, tuple(judged), _sets(methods, scores))


def _sets(methods: Sequence[str], scores: Sequence[Score]) -> dict[str, tuple[MethodComparison, ...]]:
    """Compare robot by robot and set by set.

    A set of all recordings, a repeated set, and all sets if each has one recording, are left out.
    """
    everything = frozenset(one.recording for one in scores)
    members: dict[str, frozenset[str]] = {}
    for name in _names(scores):
        of = frozenset(one.recording for one in scores if name in one.groups)
        if of not in (everything, *members.values()):
            members[name] = of
    if all(len(of) == 1 for of in members.values()):
        return {}
    return {name: _compared(methods, [s for s in scores if name in s.groups]) for name in members}


def _names(scores: Sequence[Score]) -> list[str]:
    """Return the names of all robots, then of all sets."""
    first = sorted({name for one in scores for name in one.groups[:1]})
    return [*first, *sorted({name for one in scores for name in one.groups[1:]} - set(first))]


def _compared(methods: Sequence[str], scores: Sequence[Score]) -> tuple[MethodComparison, ...]:
    """Compare the first method with the others on one set."""
    by_method = _by_method(methods, scores)
    first = by_method.get(methods[0], ())
    only = [column.measure for column in IN_SETS]
    return tuple(
        MethodComparison(
            name,
            len(own),
            summarise(own, only=only),
            {} if name == methods[0] else _margins(first, own, only),
        )
        for name, own in by_method.items()
    )


def _by_method(methods: Sequence[str], scores: Sequence[Score]) -> dict[str, tuple[Score, ...]]:
    of = {name: tuple(score for score in scores if score.method == name) for name in methods}
    return {name: own for name, own in of.items() if own}


def _margins(
    first: Sequence[Score], scores: Sequence[Score], only: Sequence[str] | None = None
) -> dict[str, Estimate]:
    common = {score.recording for score in first} & {score.recording for score in scores}
    return margins(first, scores, only=only) if common else {}


def format_estimate(estimate: Estimate, digits: int) -> tuple[str, str]:
    """Return a value and its interval as text; a dash without a value, nothing without an interval."""
    if math.isnan(estimate.value):
        return "–", ""
    if math.isnan(estimate.low):
        return f"{estimate.value:.{digits}f}", ""
    return f"{estimate.value:.{digits}f}", f"{estimate.low:.{digits}f}…{estimate.high:.{digits}f}"


def as_json(report: Report) -> dict[str, Any]:
    """Return the report as plain values; null for a missing number."""
    return {
        "title": report.title,
        "units": UNITS,
        **(_plain_section(report.sections[0]) if report.sections else {"methods": [], "sets": {}}),
        "with_slack": [_plain_section(section) for section in report.sections[1:]],
        "unfit": [asdict(unfit) for unfit in report.unfit],
        "missing": list(report.missing),
    }


def _plain_section(section: SlackSection) -> dict[str, Any]:
    return {
        "slack_s": section.slack_s,
        "methods": [_method(judged) for judged in section.methods],
        "sets": {name: [_plain_compared(one) for one in some] for name, some in section.sets.items()},
    }


def _plain_compared(one: MethodComparison) -> dict[str, Any]:
    return {
        "method": one.method,
        "recordings": one.recordings,
        "measures": {name: _estimate(estimate) for name, estimate in one.estimates.items()},
        "first_exceeds_it_by": {name: _estimate(estimate) for name, estimate in one.behind.items()},
    }


def _method(judged: MethodReport) -> dict[str, Any]:
    return {
        "method": judged.method,
        "recordings": judged.recordings,
        "measures": {name: _estimate(estimate) for name, estimate in judged.estimates.items()},
        "first_exceeds_it_by": {name: _estimate(estimate) for name, estimate in judged.behind.items()},
        "confusion_s": _pairs(judged.faults.confusion),
        "missed": [asdict(missed) for missed in judged.faults.missed],
        "false_alarms": [asdict(invented) for invented in judged.faults.invented],
        "timing": [asdict(timing) for timing in judged.faults.timings],
        "groups": [_plain(asdict(group)) for group in judged.faults.groups],
        "per_recording": [_score(score) for score in judged.scores],
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return _plain(asdict(estimate))


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values with nan replaced by None, because JSON has no nan."""
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in values.items()}


def _score(score: Score) -> dict[str, Any]:
    return {
        "recording": score.recording,
        "tags": score.tags,
        "sets": score.groups,
        "subject": score.subject or score.recording,
        "hits": score.hits,
        "false_alarms": score.false_alarms,
        "misses": score.misses,
        "excused": score.excused,
        "phase_hits": score.phase_hits,
        "phase_false_alarms": score.phase_false_alarms,
        "phase_misses": score.phase_misses,
        "covering": score.covering,
        "confusion_s": _pairs(score.confusion),
        "load_errors_kg": score.load_errors_kg,
        "force_errors_n": score.force_errors_n,
        "provisional_s": score.provisional_s,
        "final_s": score.final_s,
        "withdrawn": score.withdrawn,
        "intervals": score.intervals,
    }


def _pairs(confusion: dict[tuple[str, str], int]) -> list[dict[str, Any]]:
    return [
        {"true": true, "found": found, "s": round(s, 3)} for (true, found), s in sorted(confusion.items())
    ]

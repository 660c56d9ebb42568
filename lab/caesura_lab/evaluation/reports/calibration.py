"""Calibration of stated probabilities: reliability by bins, Brier score, expected calibration error.

Changepoints: a hit is right, a false alarm is wrong. One that an optional point or the window's edge
excuses is left out. Classes: the share of a segment's scored time that has its class, weighted by that
time. Intervals of shares are Wilson's (Brown, Cai & DasGupta 2001); weighted cases count as (Σw)²/Σw²
(Kish 1965).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from statistics import median
from typing import Any

from rich.console import RenderableType

from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.evaluation.reports.tables import with_slack
from caesura_lab.evaluation.runner import NotApplicable, Verdict
from caesura_lab.evaluation.scoring.score import Score, StatedProbability

EDGES = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
LIKELY, FEW = 0.5, 30  # bins below, or with fewer cases, are no ground for a verdict
NORMAL_975 = 1.959963984540054  # 97.5 % quantile of the normal distribution


@dataclass(frozen=True)
class RightShare:
    """Share of n cases that was right, with its 95 % interval; nan without cases."""

    n: int
    right: float
    low: float
    high: float


@dataclass(frozen=True)
class ProbabilityBin:
    """Cases whose stated probability lies from `low` to below `high`; weight: in changepoints or seconds."""

    low: float
    high: float
    weight: float
    stated: float  # mean
    share: RightShare

    @property
    def distance(self) -> float:
        """Return the distance between the mean stated probability and the share that was right."""
        return abs(self.stated - self.share.right)


@dataclass(frozen=True)
class ReliabilityCurve:
    """Reliability of one kind of statement.

    n: statements; weight: changepoints or seconds; brier: mean squared error; ece: expected calibration
    error, the bins' mean distance between stated and right, weighted.
    """

    n: int
    weight: float
    brier: float
    ece: float
    bins: tuple[ProbabilityBin, ...]

    @property
    def furthest(self) -> ProbabilityBin | None:
        """Return the bin from `LIKELY` up, with `FEW` cases or more, that is furthest from calibrated."""
        known = [one for one in self.bins if one.low >= LIKELY and one.share.n >= FEW]
        return max(known, key=lambda one: one.distance, default=None)


@dataclass(frozen=True)
class Calibration:
    """One method under one slack [s].

    within: the share of 90 % intervals that hold the true time; interval_s: their median length [s].
    """

    method: str
    slack_s: float
    changepoints: ReliabilityCurve
    classes: ReliabilityCurve
    within: RightShare
    interval_s: float


@dataclass(frozen=True)
class CalibrationReport:
    """Every method under every slack; notes: on recordings that were not judged."""

    title: str
    calibrations: tuple[Calibration, ...]
    notes: tuple[str, ...] = ()


def calibrate(
    title: str, methods: Sequence[str], verdicts: Iterable[Verdict], notes: Sequence[str] = ()
) -> CalibrationReport:
    """Compare the probabilities that methods stated with the outcomes; verdicts in any order."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.recording)
    scores = [verdict for verdict in ordered if isinstance(verdict, Score)]
    unfit = [
        f"{u.method} is not applicable to {u.recording}: {u.reason}"
        for u in ordered
        if isinstance(u, NotApplicable)
    ]
    slacks = sorted({score.slack_s for score in scores})
    found = [
        _calibration(name, slack, [s for s in scores if (s.method, s.slack_s) == (name, slack)])
        for name in methods
        for slack in slacks
    ]
    return CalibrationReport(title, tuple(found), (*unfit, *notes))


def _calibration(method: str, slack_s: float, scores: Sequence[Score]) -> Calibration:
    intervals = [interval for score in scores for interval in score.intervals]
    return Calibration(
        method,
        slack_s,
        curve([stated for score in scores for stated in score.stated_points]),
        curve([stated for score in scores for stated in score.stated_classes]),
        share(sum(right for _, right in intervals), len(intervals), len(intervals)),
        median(length for length, _ in intervals) if intervals else math.nan,
    )


def curve(statements: Sequence[StatedProbability]) -> ReliabilityCurve:
    """Sort statements into bins, and compare each bin's mean with the share that was right."""
    bins = tuple(_bin(low, high, statements) for low, high in pairwise(EDGES))
    weight = sum(one.of for one in statements)
    if not weight:
        return ReliabilityCurve(0, 0.0, math.nan, math.nan, bins)
    # A statement errs by (1 − p)² where it is right and by p² where it is wrong, second by second.
    error = sum(s.right * (1 - s.probability) ** 2 + (s.of - s.right) * s.probability**2 for s in statements)
    distance = sum(one.weight * one.distance for one in bins if one.weight)
    return ReliabilityCurve(len(statements), weight, error / weight, distance / weight, bins)


def _bin(low: float, high: float, statements: Sequence[StatedProbability]) -> ProbabilityBin:
    last = high == EDGES[-1]
    inside = [s for s in statements if low <= s.probability < high or (last and s.probability >= high)]
    weight = sum(one.of for one in inside)
    if not weight:
        return ProbabilityBin(low, high, 0.0, math.nan, share(0.0, 0.0, 0))
    stated = sum(one.probability * one.of for one in inside) / weight
    cases = weight**2 / sum(one.of**2 for one in inside)
    right = sum(one.right for one in inside) / weight
    return ProbabilityBin(low, high, weight, stated, share(right * cases, cases, len(inside)))


def share(right: float, of: float, n: int) -> RightShare:
    """Return right / of with Wilson's interval; n: of how many cases, as it is shown."""
    if not of:
        return RightShare(n, math.nan, math.nan, math.nan)
    p, z = right / of, NORMAL_975
    middle = (p + z**2 / (2 * of)) / (1 + z**2 / of)
    half = z / (1 + z**2 / of) * math.sqrt(p * (1 - p) / of + z**2 / (4 * of**2))
    return RightShare(n, p, max(middle - half, 0.0), min(middle + half, 1.0))


def grids(result: CalibrationReport, layout: str) -> list[Grid]:
    """One table of changepoints a method and slack, one of classes a method, and a summary."""
    found = []
    for one in result.calibrations:
        title = f"{one.method}: changepoints by stated probability; {with_slack(one.slack_s)}"
        found.append(_reliability(title, "n", one.changepoints, layout, lambda b: str(b.share.n)))
    for one in once(result.calibrations):
        title = f"{one.method}: time in segments by stated probability of their class"
        found.append(
            _reliability(title, "n, time", one.classes, layout, lambda b: f"{b.share.n}, {b.weight:.0f} s")
        )
    return [*found, _furthest(result), _summary(result, layout)]


def once(calibrations: Sequence[Calibration]) -> list[Calibration]:
    """Return one calibration per method: classes do not depend on slack."""
    return list({one.method: one for one in reversed(calibrations)}.values())[::-1]


def _reliability(
    title: str, heading: str, one: ReliabilityCurve, layout: str, count: Callable[[ProbabilityBin], str]
) -> Grid:
    rows = tuple(
        (f"{b.low:g}–{b.high:g}", count(b), f"{b.stated:.3f}", _shown(b.share, layout))
        for b in one.bins
        if b.share.n
    )
    return Grid(title, ("stated", heading, "mean stated", "right"), rows)


def _shown(one: RightShare, layout: str) -> str:
    return layout.format(f"{one.right:.2f}", f"{one.low:.2f}…{one.high:.2f}") if one.n else "–"


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _furthest(result: CalibrationReport) -> Grid:
    def cells(one: ReliabilityCurve) -> tuple[str, str]:
        worst = one.furthest
        return ("–", "–") if worst is None else (f"{worst.low:g}–{worst.high:g}", f"{worst.distance:.3f}")

    rows = tuple(
        (one.method, f"{one.slack_s:g}", *cells(one.changepoints), *cells(one.classes))
        for one in result.calibrations
    )
    headings = ("method", "slack [s]", "changepoints", "by", "classes", "by")
    title = f"Bin furthest from calibrated, of those from {LIKELY:g} up with at least {FEW} cases"
    return Grid(title, headings, rows)


def _summary(result: CalibrationReport, layout: str) -> Grid:
    headings = ("method", "slack [s]", "Brier", "ECE", "class Brier", "class ECE", "90 % [s]", "within")
    rows = tuple(
        (
            one.method,
            f"{one.slack_s:g}",
            _number(one.changepoints.brier, 3),
            _number(one.changepoints.ece, 3),
            _number(one.classes.brier, 3),
            _number(one.classes.ece, 3),
            _number(one.interval_s, 2),
            _shown(one.within, layout),
        )
        for one in result.calibrations
    )
    return Grid("Brier score, expected calibration error, intervals of 90 %", headings, rows)


def as_text(result: CalibrationReport) -> RenderableType:
    """Render the results for a terminal."""
    return GridPage(result.title, grids(result, "{} {}"), result.notes).as_text()


def as_markdown(result: CalibrationReport) -> str:
    """Render the results as Markdown for a page."""
    return GridPage(result.title, grids(result, "{} ({})"), result.notes).as_markdown()


def as_json(result: CalibrationReport) -> dict[str, Any]:
    """Return the results as plain values; null for a missing number."""
    return {
        "title": result.title,
        "methods": [_without_nan(asdict(one)) for one in result.calibrations],
        "notes": list(result.notes),
    }


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value

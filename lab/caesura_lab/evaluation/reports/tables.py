"""A report as tables for a terminal and for markdown: 95 % intervals beside every value.

Grids are made once, as rows of text, and shown in two ways.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from rich.console import RenderableType

from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.evaluation.reports.report import (
    IN_SETS,
    MARGINS,
    SET_MARGINS,
    TABLES,
    Column,
    MethodReport,
    Report,
    SlackSection,
    format_estimate,
)
from caesura_lab.evaluation.scoring.metrics import f1
from caesura_lab.evaluation.scoring.score import Score, class_accuracy
from caesura_lab.evaluation.scoring.summary import Estimate
from caesura_lab.ground_truth import KINDS
from caesura_protocol.number_words import counted

TYPICAL = 8  # so many lines of each list of errors


def as_text(report: Report, *, detailed: Sequence[str] = ()) -> RenderableType:
    """Render the report for a terminal of 80 columns, with intervals below their values.

    detailed: methods whose confusion and typical errors are shown.
    """
    return GridPage(report.title, list(_grids(report, "{}\n{}", detailed)), _notes(report)).as_text()


def as_markdown(report: Report, *, detailed: Sequence[str] = ()) -> str:
    """Render the report as Markdown, with intervals beside their values. detailed: as in `as_text`."""
    return GridPage(report.title, list(_grids(report, "{} ({})", detailed)), _notes(report)).as_markdown()


def _grids(report: Report, layout: str, detailed: Sequence[str]) -> Iterator[Grid]:
    for section in report.sections:
        yield from _pooled(section, layout)
        yield from _sets(section, layout)
    for one in report.methods:
        if one.method in detailed:
            yield from _errors(one)


def _pooled(section: SlackSection, layout: str) -> Iterator[Grid]:
    slack = with_slack(section.slack_s)
    for title, columns in TABLES:
        judged = [one for one in section.methods if any(one.estimates[c.measure].n for c in columns)]
        if judged:
            rows = tuple((one.method, *_cells(one.estimates, columns, layout)) for one in judged)
            yield Grid(f"{title}; {slack}", ("method", *(c.heading for c in columns)), rows)
    yield from _by_kind(section, slack)
    compared = [one for one in section.methods if one.behind]
    if compared:
        rows = tuple((one.method, *_cells(one.behind, MARGINS, layout)) for one in compared)
        headings = ("over", *(c.heading for c in MARGINS))
        title = f"margins of {section.methods[0].method} over the others, paired by recording; {slack}"
        yield Grid(title, headings, rows)


def _by_kind(section: SlackSection, slack: str) -> Iterator[Grid]:
    """Yield the share of true points that each method finds, for every kind of point."""
    numbers = _points(section.methods[0])
    kinds = [kind for kind, _ in numbers.most_common()]
    if not kinds:
        return
    rows = []
    for one in section.methods:
        found, all_of = _found(one), _points(one)
        shares = (f"{found[kind] / all_of[kind]:.2f}" if all_of[kind] else "–" for kind in kinds)
        rows.append((one.method, *shares))
    headings = ("method", *(f"{kind or 'unnamed'} ({numbers[kind]})" for kind in kinds))
    yield Grid(f"share of points that are found, by kind (and number); {slack}", headings, tuple(rows))


def _found(judged: MethodReport) -> Counter[str]:
    """Return the number of counted true points of each kind that are found."""
    return Counter(hit.kind for score in judged.scores for hit in score.found)


def _points(judged: MethodReport) -> Counter[str]:
    """Return the number of counted true points of each kind."""
    return _found(judged) + Counter(miss.kind for score in judged.scores for miss in score.missed)


def _sets(section: SlackSection, layout: str) -> Iterator[Grid]:
    """Yield one table per set; its last columns are the margins over each other method."""
    headings = ("method", *(c.heading for c in (*IN_SETS, *SET_MARGINS)))
    for name, compared in section.sets.items():
        rows = tuple(
            (
                one.method,
                *_cells(one.estimates, IN_SETS, layout),
                *(_cells(one.behind, SET_MARGINS, layout) if one.behind else [""] * len(SET_MARGINS)),
            )
            for one in compared
        )
        title = f"set {name}: {counted(compared[0].recordings, 'recording')}; {with_slack(section.slack_s)}"
        yield Grid(title, headings, rows)


def with_slack(slack_s: float) -> str:
    """Return the slack of tolerances as text for a title: `no slack` or `0.2 s of slack`."""
    return f"{slack_s:g} s of slack" if slack_s else "no slack"


def _cells(estimates: Mapping[str, Estimate], columns: Sequence[Column], layout: str) -> list[str]:
    pairs = (format_estimate(estimates[column.measure], column.digits) for column in columns)
    return [layout.format(value, interval) if interval else value for value, interval in pairs]


def _errors(judged: MethodReport) -> Iterator[Grid]:
    found = judged.faults
    if found.confusion:
        yield _confusion(judged)
    if found.missed:
        rows = tuple(
            (
                m.kind,
                m.between,
                f"{m.missed} of {m.of_kind}",
                str(m.near),
                "–" if m.offset_s is None else f"{m.offset_s:+.2f}",
            )
            for m in found.missed[:TYPICAL]
        )
        headings = ("missed", "true classes", "times", "one near", "by [s]")
        yield Grid(f"{judged.method}: missed changepoints", headings, rows)
    if found.invented:
        alarms = tuple((i.within, i.between, str(i.times)) for i in found.invented[:TYPICAL])
        yield Grid(f"{judged.method}: false alarms", ("within true", "found classes", "times"), alarms)
    if found.timings:
        yield _timings(judged)
    if found.groups:
        yield _groups(judged)
    yield _worst(judged)


def _timings(judged: MethodReport) -> Grid:
    rows = tuple(
        (one.kind, str(one.times), f"{one.median_s:+.2f}", f"{one.low_s:+.2f}…{one.high_s:+.2f}")
        for one in judged.faults.timings
    )
    headings = ("found", "times", "later by [s]", "80 % of them")
    return Grid(f"{judged.method}: delay of found changepoints after the true ones", headings, rows)


def _groups(judged: MethodReport) -> Grid:
    rows = tuple(
        (
            one.tag,
            str(one.recordings),
            f"{one.precision:.2f}",
            f"{one.recall:.2f}",
            f"{one.class_accuracy:.2f}",
        )
        for one in judged.faults.groups
    )
    headings = ("recordings", "n", "precision", "recall", "class")
    return Grid(f"{judged.method}: by kind of recording", headings, rows)


def _worst(judged: MethodReport) -> Grid:
    """Return a table of the recordings with the worst scores."""

    def rank(score: Score) -> tuple[float, str]:
        return f1(score.hits, score.false_alarms, score.misses), score.recording

    rows = tuple(
        (
            score.recording,
            f"{rank(score)[0]:.2f}",
            str(score.misses),
            str(score.false_alarms),
            f"{class_accuracy(score):.2f}",
        )
        for score in sorted(judged.scores, key=rank)[:TYPICAL]
    )
    return Grid(f"{judged.method}: worst recordings", ("recording", "F1", "missed", "false", "class"), rows)


def _confusion(judged: MethodReport) -> Grid:
    """Return a table with the share of time of each row's class that was given the column's class."""
    seconds = judged.faults.confusion
    columns = [kind for kind in (*KINDS, "none") if any(found == kind for _, found in seconds)]
    rows = []
    for true in KINDS:
        total = sum(s for (kind, _), s in seconds.items() if kind == true)
        if total:
            shares = [f"{seconds[true, found] / total:.0%}" for found in columns]
            rows.append((true, f"{total:.0f}", *(share if share != "0%" else "·" for share in shares)))
    return Grid(
        f"{judged.method}: share of the time of each true class, by found class",
        ("true", "s", *columns),
        tuple(rows),
    )


def _notes(report: Report) -> list[str]:
    reasons = Counter((unfit.method, unfit.reason) for unfit in report.unfit)
    unfit = [
        f"{method} is not applicable to {counted(times, 'recording')}: {reason}"
        for (method, reason), times in sorted(reasons.items())
    ]
    return [*unfit, *report.missing]

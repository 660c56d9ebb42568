"""The thesis suite as tables for a terminal, a page and a script."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType

from caesura_lab.evaluation.reports.grids import Grid, GridPage
from caesura_lab.evaluation.thesis.reference_segments import ROWS, ExpectedValue, ThesisRow
from caesura_lab.evaluation.thesis.suite import OPEN
from caesura_lab.evaluation.thesis.summary import PASSES, Report, Summary, main_settings
from caesura_lab.evaluation.thesis.table_row_comparison import TOLERANCE_S

FAULTS = 3  # so many of a row's differences are shown
UNITS = {"force_n": "N", "load_kg": "kg"}
NOTES = (
    "What the thesis leaves open, and what was chosen:",
    "* Expected length of a segment online: 2 s, geometric (its tables: 1.7 s).",
    "* Neighbours above the threshold of 0.2 are one changepoint, at the highest.",
    "* Pruning: none offline; online below 1e-6 of the best, never the 20 youngest.",
    "* Filter: Savitzky-Golay of order 2 over 0.11 s at 100 Hz.",
    "* Minimum time: none, as the thesis' tables stand before its filter too.",
    "* Λ = 1, which keeps every pair of K and D overdamped.",
    "* Length unit of the constant velocity model: 1 cm.",
    "* Wrench: a sensor below the hand, base frame, tared over the first 0.4 s.",
    "* ν0 of a press: 10 of Tab. 4.3; integrated_tab_4_5 has the 1 of Tab. 4.5.",
    "* R10's table is not printed: times of R7, and 6.4 s as the hand has it.",
    "* A boundary is right near the thesis' time or the simulated hand's own event.",
)


def as_text(report: Report, title: str) -> RenderableType:
    """Render the results for a terminal of 80 columns."""
    return GridPage(title, list(_grids(report)), ["", *NOTES]).as_text()


def as_markdown(report: Report, title: str) -> str:
    """Render the results as Markdown for a page."""
    return GridPage(title, list(_grids(report)), ["\n".join(NOTES)]).as_markdown()


def title(seeds: range) -> str:
    """Return the title: what was measured, and within which limits."""
    return (
        f"suite thesis: seeds {seeds[0]} to {seeds[-1]}; boundaries within {TOLERANCE_S:g} s; "
        f"a row passes if {PASSES:.0%} of them reproduce it, an online row also within its delays"
    )


def _grids(report: Report) -> Iterator[Grid]:
    columns = main_settings(report)
    rows = [row for row in ROWS if all(row.name in report[column] for column in columns)]
    yield Grid(
        "rows: share of the seeds, and the median number of segments",
        ("row", "scenario", "preset", "thesis", *columns),
        tuple(_row(row, [report[c][row.name] for c in columns]) for row in rows),
    )
    for column in columns:
        yield _differences(column, report)
    yield _values(columns, report, rows)
    yield _online(columns, report, rows)
    yield from _open(report)


def _row(row: ThesisRow, summaries: list[Summary]) -> tuple[str, ...]:
    results = (f"{'pass' if one.passes else 'miss'} {_share(one)}" for one in summaries)
    return (row.name, row.scenario, row.preset, str(row.segments), *results)


def _share(one: Summary) -> str:
    return f"{one.share:.0%} ({one.segments:g})"


def _differences(column: str, report: Report) -> Grid:
    rows = tuple(
        (name, "; ".join(f"{fault}: {times}" for fault, times in one.faults[:FAULTS]))
        for name, one in report[column].items()
        if one.faults
    )
    return Grid(f"{column}: what differs, in how many seeds", ("row", "boundary [s] or state"), rows)


def _values(columns: list[str], report: Report, of: list[ThesisRow]) -> Grid:
    rows = tuple(
        (row.name, str(value.segment + 1), *_value(value, i, [report[c][row.name] for c in columns]))
        for row in of
        for i, value in enumerate(row.values)
    )
    return Grid(
        "force at the end of a segment, load in it: medians of the seeds with all boundaries right",
        ("row", "segment", "thesis", *columns),
        rows,
    )


def _value(value: ExpectedValue, index: int, summaries: list[Summary]) -> list[str]:
    digits, unit = (3 if value.what == "load_kg" else 1), UNITS[value.what]
    medians = [f"{one.values[index]:.{digits}f}" if one.values else "–" for one in summaries]
    return [f"{value.thesis:.{digits}f} {unit}", *medians]


def _online(columns: list[str], report: Report, of: list[ThesisRow]) -> Grid:
    rows: list[tuple[str, ...]] = []
    for row in of:
        if row.online:
            summaries = [report[c][row.name] for c in columns]
            rows += [
                (row.name, f"{b.t:.1f} s", _seconds(b.seen_after_s, "never"), *_delays(summaries, i))
                for i, b in enumerate(row.inner)
            ]
            rows += [
                (row.name, "contact", "", *(_seconds(one.contact_s, "–") for one in summaries)),
                (row.name, "others", "", *(_seconds(one.others_s, "–") for one in summaries)),
            ]
            cycles = (f"{one.cycle_ms:.1f} ms" for one in summaries)
            rows.append((row.name, "a cycle", f"{row.cycle_ms} ms", *cycles))
    return Grid(
        "online: median delay until a boundary is shown permanently, share of the seeds that show it",
        ("row", "boundary", "thesis", *columns),
        tuple(rows),
    )


def _delays(summaries: list[Summary], index: int) -> list[str]:
    delays = [one.delays[index] for one in summaries]
    return [f"{_seconds(delay.median_s, 'never')} ({delay.shown:.0%})" for delay in delays]


def _seconds(value: float | None, none: str) -> str:
    return none if value is None else f"{value:.2f} s"


def _open(report: Report) -> Iterator[Grid]:
    for unit, wanted in (("", False), (", another length unit", True)):
        settings = [s for s in OPEN if s.name in report and (s.length_unit_m is not None) is wanted]
        shown = [row.name for row in ROWS if any(row.name in report[s.name] for s in settings)]
        if settings:
            rows = tuple((name, *(_cell(report[s.name].get(name)) for s in settings)) for name in shown)
            headings = ("row", *(s.name for s in settings))
            yield Grid(f"what the thesis leaves open, overdamped people{unit}", headings, rows)


def _cell(one: Summary | None) -> str:
    return "–" if one is None else _share(one)

"""The tables of a report as strings, the same on paper and on a screen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from caesura_clients.cli.result_tables import measures_force
from caesura_lab.program_findings import program_findings
from caesura_protocol.app_force_limit import force_in_words
from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.messages import App, Segment, Vector
from caesura_protocol.reproduced_path import path_in_words
from caesura_protocol.screw_torque_and_text import screw_in_words
from caesura_service.segmentation.pipeline_interface import PipelineView, notes_beside_tables


@dataclass(frozen=True)
class TableColumn:
    """A heading, and the unit of what is below it."""

    name: str
    unit: str = ""
    words: bool = False  # words are set flush left, numbers flush right


@dataclass(frozen=True)
class Table:
    """Rows of cells; `kinds` has the kind of segment of each row, if any."""

    title: str
    columns: tuple[TableColumn, ...]
    rows: tuple[tuple[str, ...], ...]
    kinds: tuple[str | None, ...]
    note: str = ""


TARGET = tuple(TableColumn(name, "mm") for name in ("x", "y", "z"))
FORCE = tuple(TableColumn(name, "N") for name in ("Fx", "Fy", "Fz"))
SEGMENT_COLUMNS = (
    TableColumn("#"),
    TableColumn("kind", words=True),
    TableColumn("from", "s"),
    TableColumn("to", "s"),
    TableColumn("lasts", "s"),
    *TARGET,
    *FORCE,
    TableColumn("load", "kg"),
    TableColumn("P(start)"),
    TableColumn("P(kind)"),
    TableColumn("runner-up", words=True),
    TableColumn("log odds", "nat"),
)
APP_COLUMNS = (
    TableColumn("#"),
    TableColumn("app", words=True),
    TableColumn("from", "s"),
    TableColumn("to", "s"),
    *TARGET,
    TableColumn("path", "mm", words=True),
    *FORCE,
    TableColumn("size", "N", words=True),
    TableColumn("load", "kg"),
    TableColumn("opening", "mm"),
    TableColumn("confidence"),
    TableColumn("of segments", words=True),
)
SEGMENT_NOTE = (
    "Base frame. x y z: flange at the segment's end. Fx Fy Fz: the force on the robot there; below stands "
    "whether it is tared, and whether the hand may be in it. Load: ± its standard deviation. P(start): that "
    "the segment starts there, give or take a sample. P(kind): of this kind, given the boundaries. Log odds: "
    "of the kind over the runner-up, natural logarithm; below 0 the runner-up fits this part better, and the "
    "best segmentation as a whole has the kind shown. ~ what may still change."
)
NOTHING = ("", "", "")
APP_NOTE = (
    "Base frame. x y z: where to. Path: its length, by how much it turns, and how many via points it has. "
    "Fx Fy Fz: what the robot exerts, after the limit; size: of that force. Load: ± its standard deviation. "
    "Opening: of the fingers. Confidence: P(kind) times the P(start) of the less certain boundary, times the "
    "share of the time that was observed."
)


def segments_table(view: PipelineView) -> Table:
    """Return a table of segments, one per row."""
    starts = [None, *(one.probability for one in view.changepoints)]
    measured = measures_force(view.wrench)
    rows = [_segment(i, one, starts[i], measured=measured) for i, one in enumerate(view.segments)]
    return Table(
        "Segments", SEGMENT_COLUMNS, tuple(rows), tuple(one.kind for one in view.segments), SEGMENT_NOTE
    )


def program_table(view: PipelineView) -> Table:
    """Return a table of apps, one per row, in the colour of its first segment."""
    rows = tuple(_app(i, app) for i, app in enumerate(view.apps))
    kinds = tuple(view.segments[app.segments[0]].kind if app.segments else None for app in view.apps)
    return Table("Task program", APP_COLUMNS, rows, kinds, APP_NOTE)


def notes(view: PipelineView, of_recording: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the notes for the reader beside the numbers; of_recording: on the recording and its preset."""
    gaps = (f"No samples between {gap.t0:.2f} s and {gap.tn:.2f} s." for gap in view.gaps)
    turns = (
        f"Segment {app_number(index)} turns by {screw_in_words(one.screw)}."
        for index, one in enumerate(view.segments)
        if one.screw is not None
    )
    beside = notes_beside_tables(view)
    return (view.wrench.note, *of_recording, *beside, *gaps, *turns, *program_findings(view))


def _segment(index: int, one: Segment, start_probability: float | None, *, measured: bool) -> tuple[str, ...]:
    mark = "" if one.certainty == "final" else "~"
    return (
        app_number(index),
        f"{mark}{one.kind}",
        f"{one.t0:.2f}",
        f"{mark}{one.tn:.2f}",
        f"{one.tn - one.t0:.2f}",
        *_millimetres(one.position_end),
        *(_newtons(one.force) if measured else NOTHING),
        _load(one.load_kg, one.load_sd_kg),
        "" if start_probability is None else f"{start_probability:.2f}",
        f"{one.probability:.2f}",
        one.runner_up or "",
        "" if one.runner_up is None else _signed(one.log_odds, 1),
    )


def _app(index: int, app: App) -> tuple[str, ...]:
    return (
        app_number(index),
        app_title(app.kind),
        f"{app.t0:.2f}",
        f"{app.tn:.2f}",
        *(NOTHING if app.target is None else _millimetres(app.target)),
        path_in_words(app).replace(" mm", ""),
        *(NOTHING if app.force is None else _newtons(app.force)),
        force_in_words(app).replace(" N", ""),
        _load(app.load_kg, app.load_sd_kg),
        "" if app.gripper_width is None else f"{1000.0 * app.gripper_width:.0f}",
        f"{app.confidence:.2f}",
        ranges([index + 1 for index in app.segments]),
    )


def _millimetres(position: Vector) -> tuple[str, ...]:
    return tuple(_signed(1000.0 * x, 0) for x in position)


def _newtons(force: Vector) -> tuple[str, ...]:
    return tuple(_signed(x, 1) for x in force)


def _signed(value: float, digits: int) -> str:
    """Return a number with a typographic minus, and without one before a zero."""
    return f"{np.round(value, digits) + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _load(kg: float | None, sd_kg: float | None) -> str:
    if kg is None:
        return ""
    return f"{kg:.2f}" if sd_kg is None else f"{kg:.2f} ± {sd_kg:.2f}"


def ranges(numbers: Sequence[int]) -> str:
    """Return rising numbers as text, with consecutive ones joined: [1, 2, 3, 7] is `1–3, 7`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}–{run[-1]}" for run in runs)

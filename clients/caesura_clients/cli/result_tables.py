"""Sessions, segments and programs as text in a terminal, with a mark for provisional ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from caesura_clients.program_editing import FIELD_WORDS
from caesura_clients.station_budget_texts import budgets_in_words
from caesura_protocol.app_force_limit import force_in_words
from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.messages import (
    App,
    Description,
    Hint,
    Phase,
    Program,
    Refusal,
    Segment,
    SessionStatus,
    WrenchReport,
)
from caesura_protocol.number_words import counted, fixed, reads_above
from caesura_protocol.programs.app_time_shifts import speed_in_words
from caesura_protocol.programs.apps_by_phase import Group as AppGroup
from caesura_protocol.programs.apps_by_phase import groups_by_first
from caesura_protocol.programs.checks import findings_beside_notes
from caesura_protocol.programs.document import document
from caesura_protocol.recording import Recording, did_you_mean
from caesura_protocol.reproduced_path import path_in_words
from caesura_protocol.screw_torque_and_text import torque_about_axis
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

STYLE_OF_CERTAINTY = {"final": "", "provisional": "dim italic"}
DOUBTFUL = 0.5  # p of an app, below which it is named; `caesura check` has the same
PLAIN: dict[str, Any] = {"box": SIMPLE_HEAD, "padding": (0, 1, 0, 0), "pad_edge": False}  # fits 80 columns
MARK_OF_CERTAINTY = {"final": "", "provisional": "~"}
RESULTS = {True: "yes", False: "no", None: "–"}  # of demonstrations


def segments_view(
    status: SessionStatus,
    segments: Sequence[Segment],
    clock: SessionClock = NO_OFFSET,
    *,
    newest: int | None = None,
    hints: Sequence[Hint] = (),
) -> RenderableType:
    """Return the table of one session's segments or its newest ones, with active hints and a status line."""
    hidden = 0 if newest is None else max(0, len(segments) - newest)
    measured = measures_force(status.wrench)
    table = segments_table(segments[hidden:], _title(status), clock, first=hidden, measured=measured)
    said = Text(f"{hidden} earlier ones hidden · ", style="dim") if hidden else Text()
    active = [
        Text(clock.text(f"! {at_command_line(hint.text)} {hint.advice}"), style="bold yellow")
        for hint in hints
        if hint.until is None
    ]
    return Group(table, *active, said + status_line(status, clock))


def clock_lines(clock: SessionClock) -> list[Text]:
    """Return a line with the time from which tables count; empty if it is 0 of the session's clock."""
    return [Text(clock.words, style="dim")] if clock.words else []


def segments_table(
    segments: Sequence[Segment],
    title: str,
    clock: SessionClock = NO_OFFSET,
    *,
    measured: bool,
    first: int = 0,
) -> Table:
    """Return a table of segments, one per row.

    measured: whether forces are measured; first: the index of the first segment, from 0.
    """
    table = Table("#", "from \\[s]", "to \\[s]", "kind", "force, load", "p", "or else", title=title, **PLAIN)
    for index, segment in enumerate(segments, start=first):
        mark = MARK_OF_CERTAINTY[segment.certainty]
        table.add_row(
            app_number(index),
            clock.shown(segment.t0),
            f"{mark}{clock.shown(segment.tn)}",
            f"{mark}{segment.kind}",
            _effort(segment, measured=measured),
            f"{segment.probability:.2f}",
            segment.runner_up or "",
            style=STYLE_OF_CERTAINTY[segment.certainty],
        )
    return table


def measures_force(wrench: WrenchReport) -> bool:
    """Return whether forces of segments are measured; without a wrench in use they are all 0."""
    return wrench.source != "none"


def segment_line(index: int, segment: Segment, *, measured: bool) -> str:
    """Return one segment as a line: number, start and end [s], kind, force or load, p."""
    effort = _effort(segment, measured=measured)
    span = f"{segment.t0:.2f} {segment.tn:.2f}"
    return f"{app_number(index)} {span} {segment.kind} {segment.probability:.2f} {effort}"


def phases_table(phases: Sequence[Phase], title: str, clock: SessionClock = NO_OFFSET) -> Table:
    """Return a table of phases, one per row."""
    table = Table("#", "from \\[s]", "to \\[s]", "phase", "segments", "p", title=title, **PLAIN)
    for index, phase in enumerate(phases):
        mark = MARK_OF_CERTAINTY[phase.certainty]
        table.add_row(
            app_number(index),
            clock.shown(phase.t0),
            f"{mark}{clock.shown(phase.tn)}",
            Text(f"{mark}{phase_name(phase)}"),  # what an operator typed is no markup
            _numbers(phase.first_segment, phase.last_segment),
            f"{phase.probability:.2f}",
            style=STYLE_OF_CERTAINTY[phase.certainty],
        )
    return table


def phase_name(phase: Phase) -> str:
    """Return the name and kind of a phase as text, with its number of strokes if it has more than one."""
    kind = phase.kind if phase.strokes == 1 else f"{phase.kind} × {phase.strokes}"
    return kind if phase.name is None else f"{phase.name} ({kind})"


def _numbers(first: int, last: int) -> str:
    return app_number(first) + ("" if first == last else f"–{app_number(last)}")


def status_line(status: SessionStatus, clock: SessionClock = NO_OFFSET) -> Text:
    """Return a line of status: time reached, missing batches, use of the wrench."""
    parts = [
        status.state,
        f"t {clock.shown(status.t)} s",
        f"{counted(status.samples, 'sample')} in {counted(status.batches, 'batch')}",
        at_command_line(status.wrench.note) or f"wrench {status.wrench.source}",
    ]
    if status.waiting_for is not None:
        parts.append(f"waiting for batch {status.waiting_for}")
    if status.overloaded:
        parts.append("the service is overloaded")
    if status.dropped:
        parts.append(f"{counted(status.dropped, 'message')} dropped, and batches among them requested again")
    if status.gaps:
        parts.append(_gaps(status, clock))
    parts += budgets_in_words(status.budgets)
    if status.last_refusal is not None:
        parts.append(_refusals(status))
    return Text(" · ".join(parts), style="dim")


def outcome_line(status: SessionStatus, clock: SessionClock = NO_OFFSET) -> str:
    """Return text on refused messages, repeated samples and gaps of a session; empty without any."""
    parts = []
    if status.refused:
        parts.append(_refusals(status))
    if status.repeats:
        parts.append(f"{status.repeats} of {status.samples} samples dropped: their time did not advance")
    if status.gaps:
        parts.append(_gaps(status, clock))
    return " · ".join(parts)


def stored_whole(status: SessionStatus) -> bool:
    """Return whether no batch of a session is lost. A refused batch may have been sent again since."""
    return status.lost == 0 and status.waiting_for is None


def _refusals(status: SessionStatus) -> str:
    """Return text with the number of refusals and the last one.

    For a closed session that has every batch, it adds that nothing is lost.
    """
    last = "" if status.last_refusal is None else f" (last: {_why(status.last_refusal)})"
    said = f"{sum(status.refused.values())} refused{last}"
    return f"{said}, and nothing is lost" if status.state == "closed" and stored_whole(status) else said


def ignored_line(recording: Recording) -> str:
    """Return a line on the names in a file that were not read, with likely intended ones; empty if none."""
    if not recording.ignored:
        return ""
    meant = {name: did_you_mean(name) for name in recording.ignored}
    names = [
        (name or "a column without a name") if said is None else f"{name} (did you mean {said}?)"
        for name, said in meant.items()
    ]
    grade = "warning" if any(meant.values()) else "note"
    return f"{grade}: {recording.name}: ignored {', '.join(names)}"


def program_view(
    program: Program, clock: SessionClock = NO_OFFSET, phases: Sequence[Phase] = ()
) -> RenderableType:
    """Return the apps of a task program as a table, with its notes and the findings of a check.

    phases: of its session; the apps of each have a heading.
    """
    made = document(program, phases=phases)
    state = "complete" if program.complete else "being taught"
    name = f"{escape(program.name)}: " if program.name else ""
    title = f"{name}{program.station} / {program.session}, version {program.version}, {state}"
    notes = (*map(clock.text, map(at_command_line, made.notes)), *doubtful_apps(program.apps))
    findings = map(clock.text, map(str, findings_beside_notes(made)))
    dim = (Text(note, style="dim") for note in notes)
    return Group(apps_table(program.apps, title, clock, made.groups), *dim, *map(Text, findings))


def doubtful_apps(apps: Sequence[App]) -> tuple[str, ...]:
    """Return a sentence that explains low values of p and names these apps; no sentence without such apps."""
    doubtful = [
        app_number(index) for index, app in enumerate(apps) if reads_above(DOUBTFUL, app.confidence, 2)
    ]
    if not doubtful:
        return ()
    which = f"app{'s' if len(doubtful) > 1 else ''} {', '.join(doubtful)}"
    return (f"p of an app is that of its kind times that of its less certain boundary; low: {which}.",)


def apps_table(
    apps: Sequence[App], title: str, clock: SessionClock = NO_OFFSET, groups: Sequence[AppGroup] = ()
) -> Table:
    """Return a table of apps, one per row, with a heading above those of each group."""
    headings = groups_by_first(groups, len(apps))
    table = Table(
        "#", "app", "target \\[mm]", "path, via", "force, load", "time \\[s]", "p", title=title, **PLAIN
    )
    for index, app in enumerate(apps):
        if (group := headings.get(index)) is not None:
            name = Text(group.name)  # what an operator typed is no markup
            table.add_row("", name, group.apps_in_words, group.strokes_in_words, style="bold")
        table.add_row(
            app_number(index),
            _title_of(app),
            _target_of(app),
            path_in_words(app, unit=""),
            _effort_of_app(app),
            clock.interval(app.t0, app.tn),
            f"{app.confidence:.2f}",
        )
    return table


def _target_of(app: App) -> Text:
    """Return the target [mm] of an app, and the name that an operator gave it."""
    place = "" if app.target is None else " ".join(fixed(1000 * x, 0) for x in app.target)
    return Text(f"{place}\n{app.target_name}" if app.target_name else place)


def _title_of(app: App) -> Text:
    """Return the name or kind of an app, with the edits of operators and their authors."""
    text = Text(f"{app.name} ({app_title(app.kind)})" if app.name else app_title(app.kind))
    if app.changes:
        changes = ", ".join(FIELD_WORDS[change.field] for change in app.changes)
        authors = " and ".join(dict.fromkeys(change.author for change in app.changes))
        text.append(f"\n{changes}: {authors}", style="dim")
    if speed := speed_in_words(app):
        text.append(f"\nspeed {speed}")
    if app.note:
        text.append(f"\n{app.note}", style="italic")
    return text


def _why(refusal: Refusal) -> str:
    """Return the reason of a refusal without its error code."""
    return refusal.message.removeprefix(f"{refusal.code}: ")


def _gaps(status: SessionStatus, clock: SessionClock) -> str:
    """Return text with the number of gaps, their length [s], the newest ones, and the lost batches."""
    lost = f", {counted(status.lost, 'batch')} lost" if status.lost else ""
    at_end = any(
        gap.t0 == gap.tn for gap in status.gaps
    )  # nothing came behind it, so its length is not known
    least = "at least " if status.gaps_before or at_end else ""
    count = status.gaps_before + len(status.gaps)
    lasted_s = sum(gap.tn - gap.t0 for gap in status.gaps)
    stretches = [(gap.t0, gap.tn) for gap in status.gaps]
    named = f" ({clock.newest(stretches, count)})" if stretches else ""
    return f"{counted(count, 'gap')}, {least}{lasted_s:.2f} s{named}{lost}"


def description_line(description: Description) -> str:
    """Return a session's description as one line; empty if nothing is stated."""
    stated = (
        ("task", description.task),
        ("operator", description.operator),
        ("success", None if description.success is None else RESULTS[description.success]),
        ("tags", ", ".join(description.tags)),
        ("note", description.note),
        ("deleted", "yes" if description.deleted else None),
    )
    return " · ".join(f"{name} {value}" for name, value in stated if value)


def _title(status: SessionStatus) -> str:
    return f"{status.station} / {status.session} ({status.preset})"


def _turned(segment: Segment) -> str:
    """Return a turning's angle [°], and its torque [Nm] in contact, as text; empty for every other kind."""
    if segment.kind != "turning" or segment.turn is None:
        return ""
    torque = None if segment.screw is None else torque_about_axis(segment.screw)
    held = "" if torque is None or segment.contact != "contact" else f", {abs(torque):.1f} Nm"
    return f"{math.degrees(math.hypot(*segment.turn)):.0f}°{held}"


def _effort(segment: Segment, *, measured: bool) -> str:
    """Return the turn, or else the load, or else the force of a segment as text."""
    if turned := _turned(segment):
        return turned
    if segment.load_kg is not None:
        spread = "" if segment.load_sd_kg is None else f" ± {fixed(segment.load_sd_kg, 2)}"
        return f"{fixed(segment.load_kg, 2)} kg{spread}"
    return f"{fixed(math.hypot(*segment.force), 1)} N" if measured else "–"


def _effort_of_app(app: App) -> str:
    if app.gripper_width is not None and app.force is None:
        return f"{fixed(1000 * app.gripper_width, 0)} mm"
    if app.load_kg is None:
        return force_in_words(app)
    return fixed(app.load_kg, 2) + (" kg" if app.load_sd_kg is None else f"±{fixed(app.load_sd_kg, 2)} kg")

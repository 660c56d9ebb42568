"""`caesura segment`: segments a recording, without a network."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Answers
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console, Group
from rich.markup import escape
from rich.progress import Progress
from rich.text import Text

from caesura_clients.cli.options import ProgramOptions, Reading, grouped, reported
from caesura_clients.cli.recording_questions import Answered, ask_about
from caesura_clients.cli.result_tables import (
    apps_table,
    clock_lines,
    doubtful_apps,
    ignored_line,
    measures_force,
    phases_table,
    segments_table,
)
from caesura_lab.commands.options import Mapping, PresetName, RecordingFile
from caesura_lab.recording_warnings import recording_warnings, without_confirmed
from caesura_protocol.errors import ProtocolError, SourceError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_protocol.sample_limits import HOLE_S
from caesura_protocol.session_clock import SessionClock, clock_of
from caesura_service.config import DEFAULT_PRESET
from caesura_service.numba_support import has_kernels, is_compiled
from caesura_service.offline_segmentation import as_json, segment_recording
from caesura_service.segmentation.view import PipelineView, notes_beside_tables

SHOWN_GAPS = 5


@grouped
def segment(
    file: RecordingFile,
    *,
    preset: PresetName = DEFAULT_PRESET,
    threshold: Annotated[
        float | None,
        typer.Option(help="Changepoints where their probability is above this, as in the thesis (0.2)."),
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the results here.")
    ] = None,
    reading: Reading,
    asked: ProgramOptions,
    mapping: Mapping = None,
    ask: Annotated[
        bool,
        typer.Option("--ask", help="Ask for columns, units, wrench source, hand, robot; keep the answers."),
    ] = False,
) -> None:
    """Divide a recording into segments and show them with the task program."""
    with reported():
        if json_out is not None and not json_out.resolve().parent.is_dir():
            raise SourceError(f"cannot write {json_out}: no such directory")
        if threshold is not None and not 0.0 <= threshold <= 1.0:
            raise SourceError(f"--threshold is {threshold}, expected a probability between 0 and 1")
        if ask:
            answered = ask_about(file)
            mapping = answered.mapping or mapping
            reading, asked = _with_answers(reading, asked, answered.options)
            typer.echo(f"next time: caesura segment {file} {_as_options(answered)}", err=True)
        recording = load_recording(file, **reading._asdict(), mapping=mapping)
        recording = replace(recording, setting=asked.setting().completed_by(recording.setting))
        view = segmented(without_confirmed(recording), preset, threshold)
        warnings = recording_warnings(recording, preset)
        if json_out is not None:
            _write(json_out, view, warnings)
    Console().print(_shown(recording, preset, view, warnings))


def _with_answers(
    reading: Reading, asked: ProgramOptions, answers: Answers[str, str]
) -> tuple[Reading, ProgramOptions]:
    """The options with what was answered; an option that was typed goes before it."""
    own = {
        key: value for key, value in answers.items() if key in Reading._fields and not getattr(reading, key)
    }
    return reading._replace(**own), asked._replace(robot=asked.robot or answers.get("robot"))


def _as_options(answered: Answered) -> str:
    options = dict(answered.options) | ({"mapping": str(answered.mapping)} if answered.mapping else {})
    return " ".join(f"--{key.replace('_', '-')} {value}" for key, value in options.items())


def segmented(recording: Recording, preset: str, threshold: float | None = None) -> PipelineView:
    """Its segments, with a bar on the way. Raises SourceError where there is nothing to segment."""
    announce_compilation()
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(escape(recording.name), total=recording.t.size)
        try:
            view = segment_recording(
                recording,
                preset,
                threshold=threshold,
                progress=lambda samples: progress.update(task, completed=samples),
            )
        except (ProtocolError, ValueError) as error:
            why = "; ".join([str(error).removeprefix("malformed: "), *recording.doubts])
            robot = recording.setting.robot
            named = f"{recording.name} as of robot {robot}" if why.startswith("robot ") else recording.name
            raise SourceError(f"{named}: {why}") from error
    if not view.segments:
        raise SourceError(
            f"{recording.name}: nothing to segment in {view.samples} samples over "
            f"{float(np.ptp(recording.t)):.3g} s, of which {view.repeats} do not "
            f"advance in time, {len(view.gaps)} gaps between them; expected t in seconds, more than 0.2 s, "
            f"and pauses of at most {HOLE_S:g} s"
        )
    return view


def announce_compilation() -> None:
    """Compile the filter where no compiled code is kept yet, and say so on stderr."""
    if has_kernels() and not is_compiled():
        typer.echo("compiling the filter (once, about a minute)", err=True)
        from caesura_service.prepare import prepare  # noqa: PLC0415

        prepare()


def _write(path: Path, view: PipelineView, warnings: Sequence[str]) -> None:
    written = as_json(view) | ({"warnings": list(warnings)} if warnings else {})
    try:
        path.write_text(json.dumps(written, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise SourceError(f"cannot write {path}: {error.strerror}") from error


def _shown(recording: Recording, preset: str, view: PipelineView, warnings: Sequence[str]) -> Group:
    clock = clock_of(view.segments)
    lines = (
        *doubtful_apps(view.apps),
        view.wrench.note,
        *map(clock.text, warnings),
        *_warnings(recording, view, clock),
    )
    return Group(
        *clock_lines(clock),
        segments_table(
            view.segments,
            f"{escape(recording.name)} ({preset})",
            clock,
            measured=measures_force(view.wrench),
        ),
        *([phases_table(view.phases, "phases", clock)] if len(view.phases) > 1 else []),
        apps_table(view.apps, "task program", clock),
        *map(Text, lines),
    )


def _warnings(recording: Recording, view: PipelineView, clock: SessionClock) -> Iterator[str]:
    """What a reader must know of what is not in the tables."""
    yield from map(clock.text, notes_beside_tables(view))
    if ignored := ignored_line(recording):
        yield ignored
    if view.repeats:
        verb, whose = ("was", "its") if view.repeats == 1 else ("were", "their")
        yield f"{view.repeats} of {view.samples} samples {verb} dropped: {whose} time did not advance"
    for gap in view.gaps[:SHOWN_GAPS]:
        yield f"nothing is known between {clock.shown(gap.t0)} s and {clock.shown(gap.tn)} s"
    if len(view.gaps) > SHOWN_GAPS:
        yield f"and {len(view.gaps) - SHOWN_GAPS} more gaps; is t in seconds?"

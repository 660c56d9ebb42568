"""`caesura segment`: segments recordings, without a network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from collections.abc import Mapping as Answers
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.console import Console, Group
from rich.markup import escape
from rich.progress import Progress
from rich.text import Text

from caesura_clients.cli.options import ProgramOptions, Reading, grouped, reported
from caesura_clients.cli.recording_file_prompts import Answered, ask_about
from caesura_clients.cli.result_tables import (
    apps_table,
    clock_lines,
    doubtful_apps,
    ignored_line,
    measures_force,
    phases_table,
    segments_table,
)
from caesura_lab.commands.options import Mapping, PresetName, RecordingFiles, stated_recording
from caesura_lab.commands.segment_output import STDOUT, check_output, outputs_of, write_line, write_result
from caesura_lab.program_findings import program_findings
from caesura_lab.recording_warnings import recording_warnings, without_confirmed
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError
from caesura_protocol.formats.read import recordings_of
from caesura_protocol.number_words import counted
from caesura_protocol.programs.apps_by_phase import groups_of
from caesura_protocol.recording import Recording
from caesura_protocol.sample_limits import HOLE_S
from caesura_protocol.session_time_display import SessionClock, clock_of
from caesura_service.config import DEFAULT_PRESET
from caesura_service.numba_support import has_kernels, is_compiled
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.pipeline_interface import PipelineView, notes_beside_tables

SHOWN_GAPS = 5


class _Job(NamedTuple):
    """The options with which each recording is read and segmented."""

    reading: Reading
    asked: ProgramOptions
    mapping: Path | None
    preset: str
    threshold: float | None

    def segmented(self, file: Path) -> _Segmented:
        """Read and segment a file. Raises CaesuraError, ProtocolError."""
        recording = stated_recording(file, self.reading, self.asked, self.mapping)
        view = segmented(without_confirmed(recording), self.preset, self.threshold)
        return _Segmented(file, recording, view, recording_warnings(recording, self.preset))

    @property
    def method(self) -> dict[str, Any]:
        """The preset and the stated options, which determine the results of a recording."""
        options = {
            **self.reading._asdict(),
            **self.asked._asdict(),
            "mapping": self.mapping,
            "threshold": self.threshold,
        }
        stated = {
            key: value if isinstance(value, float) else str(value)
            for key, value in options.items()
            if value is not None
        }
        return {"preset": self.preset, "options": stated}


class _Segmented(NamedTuple):
    """A recording with its results."""

    file: Path
    recording: Recording
    view: PipelineView
    warnings: tuple[str, ...]

    @property
    def findings(self) -> dict[str, list[str]]:
        """Warnings, and names in the file that were not read, if any."""
        found = {"warnings": list(self.warnings), "ignored": list(self.recording.ignored)}
        return {name: words for name, words in found.items() if words}


@grouped
def segment(
    files: RecordingFiles,
    *,
    preset: PresetName = DEFAULT_PRESET,
    threshold: Annotated[
        float | None,
        typer.Option(
            help="Set a changepoint where the probability exceeds this value, as in the thesis (0.2)."
        ),
    ] = None,
    json_out: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="OUT",
            help="Write the results to this file, or those of several recordings to this directory. "
            "-: print only the results, one line for each recording.",
        ),
    ] = None,
    reading: Reading,
    asked: ProgramOptions,
    mapping: Mapping = None,
    ask: Annotated[
        bool,
        typer.Option(
            "--ask", help="Ask for columns, units, wrench, hand, robot and up, and store the answers."
        ),
    ] = False,
) -> None:
    """Divide recordings into segments, and show them with the task program. Several are shown in a line each.

    The exit code is 1 if a recording is refused. All others are segmented.
    """
    with reported():
        if json_out is not None:
            check_output(json_out, files)
        if threshold is not None and not 0.0 <= threshold <= 1.0:
            raise SourceError(f"--threshold is {threshold}, expected a probability between 0 and 1")
        found = recordings_of(files)
        if ask and len(found) > 1:
            raise SourceError(
                f"--ask asks about one recording, and there are {len(found)}: ask about one, and use its "
                "mapping for all with --mapping"
            )
        if ask:
            answered = ask_about(found[0])
            mapping = answered.mapping or mapping
            reading, asked = _with_answers(reading, asked, answered.options)
            typer.echo(f"next time: caesura segment {found[0]} {_as_options(answered)}", err=True)
        job = _Job(reading, asked, mapping, preset, threshold)
        if found != files or len(found) > 1:  # a directory may hold one
            _segment_each(job, found, json_out)
            return
        (one,) = map(job.segmented, found)
        if json_out is not None:
            write_result(json_out, one.file, one.view, one.findings, job.method)
    if json_out != STDOUT:
        Console().print(_shown(one.recording, preset, one.view, one.warnings))


def _segment_each(job: _Job, files: Sequence[Path], json_out: Path | None) -> None:
    """Segment several recordings, a line for each. Raises CaesuraError, typer.Exit if one is refused."""
    outputs = outputs_of(files, json_out)
    refused = 0
    for file in files:
        try:
            one = job.segmented(file)
        except (CaesuraError, ProtocolError) as error:
            refused += 1
            typer.echo(f"error: {str(error).removeprefix('malformed: ')}", err=True)
            continue
        if json_out == STDOUT:
            write_line(file, one.view, one.findings, job.method)
            continue
        if outputs is not None:
            write_result(outputs[file], file, one.view, one.findings, job.method)
        typer.echo(_line(one))
        for warning in filter(None, (*one.warnings, _ignored(one.recording), _repeats(one.view))):
            typer.echo(f"{file}: {at_command_line(warning)}", err=True)
    if refused:
        typer.echo(f"{refused} of {counted(len(files), 'recording')} refused", err=True)
        raise typer.Exit(1)


def _line(one: _Segmented) -> str:
    """Return a line on a recording and its results."""
    seconds = float(one.recording.t[-1] - one.recording.t[0])
    counts = [counted(len(one.view.segments), "segment"), counted(len(one.view.apps), "app")]
    counts += [counted(len(one.view.gaps), "gap")] if one.view.gaps else []
    wrench = one.view.wrench
    source = f"wrench {wrench.source}{'' if wrench.stated else ' (assumed)'}"
    return f"{one.file}: {', '.join((f'{seconds:.2f} s', *counts, source))}"


def _with_answers(
    reading: Reading, asked: ProgramOptions, answers: Answers[str, str]
) -> tuple[Reading, ProgramOptions]:
    """Return the options completed by answers; a typed option takes precedence."""
    own = {
        key: value for key, value in answers.items() if key in Reading._fields and not getattr(reading, key)
    }
    return reading._replace(**own), asked._replace(robot=asked.robot or answers.get("robot"))


def _as_options(answered: Answered) -> str:
    options = dict(answered.options) | ({"mapping": str(answered.mapping)} if answered.mapping else {})
    return " ".join(f"--{key.replace('_', '-')} {value}" for key, value in options.items())


def segmented(recording: Recording, preset: str, threshold: float | None = None) -> PipelineView:
    """Segment a recording, with a progress bar on stderr. Raises SourceError where no segment comes out."""
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
            f"{recording.name}: nothing to segment in {counted(view.samples, 'sample')} over "
            f"{float(np.ptp(recording.t)):.3g} s, of which {view.repeats} do not "
            f"advance in time, {counted(len(view.gaps), 'gap')} between them; expected t in seconds, "
            f"more than 0.2 s, and pauses of at most {HOLE_S:g} s"
        )
    return view


def announce_compilation() -> None:
    """Compile the filter if no compiled code is cached, and print that on stderr."""
    if has_kernels() and not is_compiled():
        typer.echo("compiling the filter (once, about a minute)", err=True)
        from caesura_service.prepare import prepare  # noqa: PLC0415

        prepare()


def _shown(recording: Recording, preset: str, view: PipelineView, warnings: Sequence[str]) -> Group:
    clock = clock_of(view.segments)
    lines = (
        *doubtful_apps(view.apps),
        view.wrench.note,
        *map(clock.text, warnings),
        *_warnings(recording, view, clock),
        *map(clock.text, program_findings(view)),
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
        apps_table(view.apps, "task program", clock, groups_of(view.apps, view.phases)),
        *map(Text, map(at_command_line, lines)),
    )


def _ignored(recording: Recording) -> str:
    """Return the parts of a file that were not read, without its name; empty if all was read."""
    return ignored_line(recording).replace(f"{recording.name}: ", "", 1)


def _repeats(view: PipelineView) -> str:
    """Return a sentence with the number of dropped samples; empty where none was dropped."""
    if not view.repeats:
        return ""
    verb, whose = ("was", "its") if view.repeats == 1 else ("were", "their")
    return f"{view.repeats} of {view.samples} samples {verb} dropped: {whose} time did not advance"


def _warnings(recording: Recording, view: PipelineView, clock: SessionClock) -> Iterator[str]:
    """Yield the notes that the tables do not show: on results, ignored columns, dropped samples and gaps."""
    yield from map(clock.text, notes_beside_tables(view))
    if ignored := ignored_line(recording):
        yield ignored
    if repeats := _repeats(view):
        yield repeats
    for gap in view.gaps[:SHOWN_GAPS]:
        when = f"between {clock.shown(gap.t0)} s and"
        if gap.t0 == gap.tn:  # at an end of the recording
            when = "before" if gap.t0 <= recording.t[0] else "after"
        yield f"no samples {when} {clock.shown(gap.tn)} s"
    if len(view.gaps) > SHOWN_GAPS:
        yield f"and {counted(len(view.gaps) - SHOWN_GAPS, 'more gap')}; is t in seconds?"

"""`caesura report`: writes a report of a recording, without a network."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Annotated

import typer

from caesura_clients.cli.options import ProgramOptions, Reading, grouped, reported
from caesura_lab.commands.options import Mapping, PresetName, RecordingFile, stated_recording
from caesura_lab.commands.segment import announce_compilation
from caesura_lab.evaluation.cases.suites import check_hash, within_recording
from caesura_lab.ground_truth import Truth, TruthError, read_annotation, truth_file
from caesura_lab.report.report_data import ReportData, collect
from caesura_lab.report.times_from_start import from_start
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError
from caesura_protocol.package_version_and_extras import install_command
from caesura_protocol.recording import Recording
from caesura_service.config import DEFAULT_PRESET


@grouped
def report(
    file: RecordingFile,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .pdf, .png or .html.")],
    preset: PresetName = DEFAULT_PRESET,
    truth: Annotated[
        Path | None,
        typer.Option(help="Annotation to compare with; by default FILE's .ann.json, if it exists."),
    ] = None,
    no_truth: Annotated[bool, typer.Option("--no-truth", help="Draw FILE without its .ann.json.")] = False,
    reading: Reading,
    asked: ProgramOptions,
    mapping: Mapping = None,
) -> None:
    """Draw a recording with its segmentation: signals, path, tables, and the posterior over time."""
    with reported():
        _writable(out)
        if truth and no_truth:
            raise CaesuraError(f"--no-truth contradicts --truth {truth}: state one of them")
        recording = stated_recording(file, reading, asked, mapping)
        known = None
        if truth is not None:
            recording, known = _annotated(file, recording, truth)
        elif not no_truth and truth_file(file).is_file():
            try:
                recording, known = _annotated(file, recording, truth_file(file))
            except TruthError as error:
                raise TruthError(f"{error}; --no-truth draws the recording without it") from error
        _report(recording, out, preset, known)
    typer.echo(f"{out}: {out.stat().st_size / 1000:.0f} kB")


def _annotated(file: Path, recording: Recording, annotation: Path) -> tuple[Recording, Truth]:
    """Return a recording and its annotation. Raises TruthError if it is that of another recording."""
    known = read_annotation(annotation)
    check_hash(file, known.source)
    return within_recording(recording, known)


def _writable(out: Path) -> None:
    _writers().writer_of(out)
    if not out.resolve().parent.is_dir():
        raise CaesuraError(f"cannot write {out}: no such directory")


def _report(recording: Recording, out: Path, preset: str, truth: Truth | None) -> None:
    announce_compilation()
    content = _collected(recording, preset, truth)
    try:
        _writers().write_report(content, out)
    except OSError as error:
        raise CaesuraError(f"cannot write {out}: {error.strerror}") from error


def _collected(recording: Recording, preset: str, truth: Truth | None) -> ReportData:
    try:
        return from_start(collect(recording, preset, truth))
    except (ProtocolError, ValueError) as error:
        raise SourceError(f"{recording.name}: {str(error).removeprefix('malformed: ')}") from error


def _writers() -> ModuleType:
    """Import the module that draws reports. Raises CaesuraError if its extra is not installed."""
    try:
        return import_module("caesura_lab.report.writers")
    except ModuleNotFoundError as error:
        raise CaesuraError(f"a report needs {error.name}: {install_command('report')}") from error

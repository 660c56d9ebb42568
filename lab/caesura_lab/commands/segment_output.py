"""Writes the results of `caesura segment` for other software: JSON to a file, a directory, or stdout."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import typer

from caesura_lab.commands.options import namesakes
from caesura_protocol.errors import CaesuraError, SourceError
from caesura_protocol.formats.read import is_there_as_recording
from caesura_protocol.formats.write import check_not_read
from caesura_protocol.package_version_and_extras import installed_version
from caesura_service.offline_segmentation import as_json
from caesura_service.segmentation.pipeline_interface import PipelineView

STDOUT = Path("-")


def check_output(out: Path, files: Sequence[Path]) -> None:
    """Raise SourceError without a directory for the output, CaesuraError if it would replace a recording."""
    if out == STDOUT:
        return
    if not out.resolve().parent.is_dir():
        raise SourceError(f"cannot write {out}: no such directory")
    if not out.is_dir():
        check_not_read(out, files)
    if is_there_as_recording(out):
        raise CaesuraError(
            f"cannot write {out}: it is a recording; --json takes the name of the file to write, such as "
            f"{files[0].stem}.json"
        )


def outputs_of(files: Sequence[Path], out: Path | None) -> Mapping[Path, Path] | None:
    """Return the result file of each recording, and make their directory; None where no file is written.

    Raises SourceError for a file in place of a directory, and for two recordings of one name.
    """
    if out is None or out == STDOUT:
        return None
    if out.exists() and not out.is_dir():
        raise SourceError(f"--json {out} is a file, expected a directory for {len(files)} recordings, or -")
    if not out.exists() and out.suffix:
        raise SourceError(
            f"--json {out} is the name of a file, expected a directory for {len(files)} recordings, or -"
        )
    outputs = {file: out / f"{file.stem}.json" for file in files}
    if found := namesakes(files):
        one, other = found
        raise SourceError(
            f"{one} and {other} would both be written to {outputs[one]}: segment them separately"
        )
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise SourceError(f"cannot write {out}: {error.strerror}") from error
    return outputs


def write_result(
    out: Path, file: Path, view: PipelineView, findings: Mapping[str, Any], method: Mapping[str, Any]
) -> None:
    """Write one result, or print it. Raises SourceError where it cannot be written."""
    text = json.dumps(_result(file, view, findings, method), indent=2)
    if out == STDOUT:
        typer.echo(text)
        return
    try:
        out.write_text(f"{text}\n", encoding="utf-8")
    except OSError as error:
        raise SourceError(f"cannot write {out}: {error.strerror}") from error


def write_line(
    file: Path, view: PipelineView, findings: Mapping[str, Any], method: Mapping[str, Any]
) -> None:
    """Print one result as a line."""
    typer.echo(json.dumps(_result(file, view, findings, method)))


def _result(
    file: Path, view: PipelineView, findings: Mapping[str, Any], method: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the results with the recording, method and version on which they depend."""
    origin = {"file": str(file), "sha256": _digest(file), **method, "version": installed_version()}
    return {"origin": origin, **as_json(view), **findings}


def _digest(file: Path) -> str | None:
    """Return the SHA-256 of a file; None for a directory."""
    if not file.is_file():
        return None
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()

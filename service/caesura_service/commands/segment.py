"""`caesura segment`: a recording in, segments out, without a network."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console, Group
from rich.progress import Progress

from caesura_clients.cli.options import reported
from caesura_clients.cli.show import apps_table, segments_table
from caesura_clients.recording import Recording, load_recording
from caesura_protocol.errors import ProtocolError
from caesura_service.changepoint.presets import PRESETS
from caesura_service.config import DEFAULT_PRESET
from caesura_service.recordings import as_json, segment_recording
from caesura_service.session.view import View


def segment(
    file: Annotated[Path, typer.Argument(help="Recording, npz or csv.")],
    preset: Annotated[str, typer.Option(help=f"Model: {', '.join(sorted(PRESETS))}.")] = DEFAULT_PRESET,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the results here.")
    ] = None,
    wrench_source: Annotated[str | None, typer.Option(help="Overrides what the file declares.")] = None,
    length_unit: Annotated[
        str | None, typer.Option("--length-unit", "--unit", help="Overrides what the file declares.")
    ] = None,
) -> None:
    """Divide a recording into segments and show them with the task program."""
    with reported():
        recording = load_recording(file, wrench_source=wrench_source, length_unit=length_unit)
        view = _segmented(recording, preset)
        if json_out is not None:
            _write(json_out, view)
    Console().print(_shown(recording, preset, view))


def _segmented(recording: Recording, preset: str) -> View:
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(recording.name, total=recording.t.size)
        try:
            return segment_recording(
                recording, preset, progress=lambda samples: progress.update(task, completed=samples)
            )
        except ValueError as error:
            raise ProtocolError("malformed", f"{recording.name}: {error}") from error


def _write(path: Path, view: View) -> None:
    try:
        path.write_text(json.dumps(as_json(view), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ProtocolError("malformed", f"cannot write {path}: {error.strerror}") from error


def _shown(recording: Recording, preset: str, view: View) -> Group:
    return Group(
        segments_table(view.segments, title=f"{recording.name} ({preset})"),
        apps_table(view.apps, title="task program"),
        view.wrench.note,
        *(f"nothing is known between {gap.t0:.2f} s and {gap.tn:.2f} s" for gap in view.gaps),
    )

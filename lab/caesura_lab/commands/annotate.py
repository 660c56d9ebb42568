"""`caesura annotate`. NiceGUI is imported when the command runs, so that other commands start fast."""

from __future__ import annotations

import getpass
import signal
from contextlib import suppress
from itertools import takewhile
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import (
    AngleUnit,
    ForceFrame,
    ForceUnit,
    LengthUnit,
    TimeUnit,
    WrenchSource,
    reported,
)
from caesura_lab.commands.options import Mapping, RecordingFile
from caesura_lab.ground_truth import truth_file
from caesura_protocol.formats.read import load_recording
from caesura_protocol.session_time_display import clock_from

DEFAULT_PORT = 8081


def annotate(
    file: RecordingFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Annotation to write.", show_default="beside the recording"),
    ] = None,
    annotator: Annotated[
        str | None,
        typer.Option(envvar="CAESURA_AUTHOR", help="Author of a new annotation; by default the login name."),
    ] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, metavar="N", help="Port to listen on.")
    ] = DEFAULT_PORT,
    wrench_source: WrenchSource = None,
    force_frame: ForceFrame = None,
    length_unit: LengthUnit = None,
    time_unit: TimeUnit = None,
    angle_unit: AngleUnit = None,
    force_unit: ForceUnit = None,
    mapping: Mapping = None,
) -> None:
    """Mark boundaries and classes of a recording by hand, in a browser on this machine."""
    from caesura_clients.dashboard.server import Address, check_free  # noqa: PLC0415
    from caesura_lab.annotation.edits import AnnotationEditor, milliseconds  # noqa: PLC0415
    from caesura_lab.annotation.page import AnnotationSession, serve  # noqa: PLC0415
    from caesura_lab.annotation.signals import plotted_signals  # noqa: PLC0415
    from caesura_lab.annotation.storage import (  # noqa: PLC0415
        check_writable,
        drafts,
        open_annotation,
        save_draft,
    )

    with reported():
        address = Address(port=port)  # loopback: an annotation is no service
        check_free(address)
        recording = load_recording(
            file,
            wrench_source=wrench_source,
            force_frame=force_frame,
            length_unit=length_unit,
            time_unit=time_unit,
            angle_unit=angle_unit,
            force_unit=force_unit,
            mapping=mapping,
        )
        path = truth_file(file) if out is None else out
        check_writable(path)
        document = open_annotation(path, recording, file, annotator or getpass.getuser())
        for draft in takewhile(Path.exists, drafts(path)):
            typer.echo(f"note: {draft} was not saved; rename it to {path} to go on with it", err=True)
        signals = plotted_signals(recording)
        if signals.coarse is not None:
            typer.echo(f"note: {signals.coarse}", err=True)
        editor = AnnotationEditor(document)
        signal.signal(signal.SIGTERM, _interrupt)  # as Ctrl-C
        with suppress(KeyboardInterrupt):
            clock = clock_from(milliseconds(float(recording.t.min())))
            serve(AnnotationSession(file.name, path, editor, signals, clock), address)
        if not editor.is_saved:
            draft = save_draft(editor.document, path)
            typer.echo(f"not saved: the marks are in {draft}; rename it to {path} to keep them", err=True)


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt

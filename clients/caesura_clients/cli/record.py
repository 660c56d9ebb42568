"""`caesura record`: records a live session into a file.

It runs on any machine that receives the station's samples.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.connection_options import Config, Connect
from caesura_clients.cli.options import connected, named, reported
from caesura_clients.recorder import RecordedSession, Recorder, record
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.write import WRITERS, check_new, check_writable
from caesura_protocol.number_words import counted
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.transport.zenoh_transport import endpoint_of


def record_session(
    station: Annotated[str, typer.Option(help="Teaching station.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .mcap, .npz or .csv.")],
    session: Annotated[
        str | None, typer.Option(help="Session to record; by default the first one that is received.")
    ] = None,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Record a session as it is taught, until it is closed or Ctrl-C: .npz, .csv, or .mcap with its results.

    Samples sent before, up to two minutes, are requested from the bridge. The exit code is 1 if samples are
    missing.
    """
    with reported():
        named(station)
        check_writable(out, ".mcap")
        check_new(out)  # a demonstration cannot be recorded again
        if out.suffix == ".mcap":
            with import_extra("mcap", "writing .mcap"):  # looked for before the demonstration, not after it
                import_module("caesura_protocol.formats.mcap_write")
        with connected(endpoint, config, patient=True) as caesura, _until_interrupted() as over:
            where = endpoint_of(endpoint, config)
            typer.echo(f"waiting for {station}/{session or '…'} at {where}; Ctrl-C ends it", err=True)
            found = record(caesura.transport, station, session, over=over, on_message=_progress(station))
        try:
            _write(out, station, found)
        except OSError as error:
            raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    span_s = found.recording.t[-1] - found.recording.t[0]
    where = f"{station}/{found.recorder.session}"
    typer.echo(f"{out}: {where}, {counted(found.recording.t.size, 'sample')}, {span_s:.2f} s")
    if found.missed:
        typer.echo(f"{where}: {found.missed}", err=True)
    if found.recorder.lost:
        raise typer.Exit(1)


def _progress(station: str) -> Callable[[Recorder], None]:
    """Return a function that prints the name of each session once, when it is first recorded."""
    said: set[str] = set()

    def report(recorder: Recorder) -> None:
        if recorder.session not in said:
            said.add(recorder.session)
            typer.echo(f"recording {station}/{recorder.session}", err=True)

    return report


@contextmanager
def _until_interrupted() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set, so that the received samples are written."""
    over = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: over.set()) for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield over
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _write(out: Path, station: str, found: RecordedSession) -> None:
    if out.suffix == ".mcap":
        _write_mcap(out, station, found)
    else:
        WRITERS[out.suffix](out, found.recording)


def _write_mcap(out: Path, station: str, found: RecordedSession) -> None:
    mcap = import_module("caesura_protocol.formats.mcap_write")
    recording, snapshot, recorder = found.recording, found.snapshot, found.recorder
    first = -float(recording.t.min())  # not before 1970
    content = mcap.McapContent(
        station=station,
        session=recorder.session,
        preset="" if snapshot is None else snapshot.status.preset,
        recording=recording,
        began_s=max(recorder.began_s if recorder.began_s < float("inf") else 0.0, first, 0.0),
        columns=recording.columns,
        poses=mcap.poses_of(recording),
        more={"missing_batches": str(recorder.lost)},
        program=mcap.TaskProgram(complete=found.closed),
    )
    if snapshot is not None:
        content = replace(
            content,
            segments=snapshot.segments.segments,
            changepoints=snapshot.changepoints.changepoints,
            gaps=snapshot.status.gaps,
            phases=snapshot.segments.phases,
            program=mcap.TaskProgram.of(snapshot.program),
            wrench_note=snapshot.status.wrench.note,
        )
    mcap.write_mcap(out, content)

"""`caesura export`: a recording in another format, as MCAP with its segments and its program."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import ProgramOptions, Reading, grouped, reported
from caesura_clients.cli.result_tables import ignored_line
from caesura_lab.commands.options import Mapping, PresetName, RecordingFile
from caesura_lab.commands.segment import segmented
from caesura_lab.recording_warnings import without_confirmed
from caesura_protocol.distribution import import_extra
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.formats.write import WRITERS, check_writable
from caesura_protocol.recording import Recording
from caesura_service.config import DEFAULT_PRESET
from caesura_service.offline_segmentation import opening_of

STATION = "file"  # what a file that came from no station is said to be of


@grouped
def export_recording(
    file: RecordingFile,
    *,
    out: Annotated[Path, typer.Option("--out", "-o", help="Where to: .mcap, .npz or .csv.")],
    preset: PresetName = DEFAULT_PRESET,
    reading: Reading,
    asked: ProgramOptions,
    mapping: Mapping = None,
) -> None:
    """Write a recording in another format: .mcap with its segments for Foxglove and Rerun, .npz or .csv.

    A rosbag2, a csv in another layout or an MCAP is converted to a form that every command reads. A session
    that was taught over the wire is exported by `caesura sessions export`.
    """
    with reported():
        check_writable(out, ".mcap")
        copied = out.suffix != ".mcap"  # without results, which a wrench that cannot be used would spoil
        recording = load_recording(file, **reading._asdict(), mapping=mapping, as_stated=copied)
        for line in (ignored_line(recording), *recording.assumed, *recording.cautions, *recording.doubts):
            if line:
                typer.echo(line, err=True)
        recording = replace(recording, setting=asked.setting().completed_by(recording.setting))
        try:
            if out.suffix == ".mcap":
                _write_mcap(out, recording, preset)
            else:
                WRITERS[out.suffix](out, recording)
        except OSError as error:
            raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    typer.echo(f"{out}: {recording.t.size} samples, {recording.t[-1] - recording.t[0]:.2f} s")


def _write_mcap(out: Path, recording: Recording, preset: str) -> None:
    with import_extra("mcap", "writing .mcap"):
        written = import_module("caesura_lab.export.mcap_file")
    recording = without_confirmed(recording)
    view = segmented(recording, preset)
    taught = import_module("caesura_lab.export.session_export").SessionExport(
        station=STATION,
        opening=opening_of(recording, preset),
        recording=recording,
        began_s=max(0.0, -float(recording.t.min())),  # unknown; a time before 1970 cannot be written
        view=view,
        notes=(*view.notes, *recording.cautions),
        complete=True,
    )
    written.write_mcap(out, taught)

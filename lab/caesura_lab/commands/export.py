"""`caesura export`: writes a recording in another format, or several as a dataset.

An MCAP file has its segments, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from caesura_clients.cli.options import ProgramOptions, Reading, grouped, reported
from caesura_clients.cli.result_tables import ignored_line
from caesura_lab.commands.dataset_export_options import DATASET_OPTIONS, DatasetOptions, write_dataset
from caesura_lab.commands.options import Mapping, PresetName, RecordingFiles, namesakes, stated_recording
from caesura_lab.commands.segment import segmented
from caesura_lab.recording_warnings import without_confirmed
from caesura_protocol.command_line_advice import at_command_line
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.mcap_schemas import TaskProgram
from caesura_protocol.formats.read import recordings_of
from caesura_protocol.formats.write import WRITERS, check_not_read, check_writable
from caesura_protocol.number_words import counted
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.recording import Recording
from caesura_service.config import DEFAULT_PRESET
from caesura_service.offline_segmentation import opening_of

if TYPE_CHECKING:
    from caesura_lab.export.session_from_journal import SessionExport

STATION = "file"  # what a file that came from no station is said to be of


@grouped
def export_recording(
    files: RecordingFiles,
    *,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="File to write, .mcap, .npz or .csv, or a new directory.")
    ],
    file_format: Annotated[
        Literal["lerobot"] | None,
        typer.Option(
            "--format",
            help="A dataset, an episode for each recording; by default the format follows --out.",
        ),
    ] = None,
    dataset: DatasetOptions,
    preset: PresetName = DEFAULT_PRESET,
    reading: Reading,
    asked: ProgramOptions,
    mapping: Mapping = None,
) -> None:
    """Write a recording in another format: .mcap with its segments for Foxglove and Rerun, .npz or .csv; or,
    with --format lerobot, recordings as the episodes of a dataset, each by the name of its file.

    A rosbag2, a csv in another layout or an MCAP is converted to a form that every command reads. A session
    that was taught over the wire is exported by `caesura sessions export`.
    """
    with reported():
        found = recordings_of(files)
        if file_format is None:
            _check_one(out, found, dataset)
        else:
            _check_names(found)
            with import_extra("lerobot", "a dataset for LeRobot"):
                import_module("pyarrow")
        copied = out.suffix in WRITERS and file_format is None  # without results
        recordings = []
        for file in found:
            recording = stated_recording(file, reading, asked, mapping, as_stated=copied)
            for line in (ignored_line(recording), *recording.assumed, *recording.cautions, *recording.doubts):
                if line:
                    line = at_command_line(line)
                    typer.echo(f"{file}: {line}" if len(found) > 1 else line, err=True)
            recordings.append(recording)
        try:
            if file_format is not None:
                names = [file.stem for file in found]
                taught = [_taught(one, preset, name) for one, name in zip(recordings, names, strict=True)]
                done = write_dataset(out, taught, dataset)
            else:
                done = _write_one(out, recordings[0], preset)
        except OSError as error:
            raise CaesuraError(f"cannot write {out}: {error.strerror}") from error
    typer.echo(f"{out}: {done}")


def _check_one(out: Path, files: Sequence[Path], dataset: DatasetOptions) -> None:
    """Raise CaesuraError for options that do not apply to one recording."""
    if len(files) > 1:
        raise CaesuraError(f"{len(files)} recordings for one file: several are for --format lerobot")
    if dataset != DatasetOptions():
        raise CaesuraError(f"{DATASET_OPTIONS} are for --format lerobot")
    check_writable(out, ".mcap")
    check_not_read(out, files)


def _check_names(files: Sequence[Path]) -> None:
    """Raise CaesuraError for two recordings with one name, because an episode is named by it."""
    if found := namesakes(files):
        one, other = found
        raise CaesuraError(f"{one} and {other} would both be the episode {one.stem}: rename one")


def _write_one(out: Path, recording: Recording, preset: str) -> str:
    """Write one recording; return text on it."""
    if out.suffix == ".mcap":
        with import_extra("mcap", "writing .mcap"):
            written = import_module("caesura_lab.export.mcap_file")
        written.write_mcap(out, _taught(recording, preset))
    else:
        WRITERS[out.suffix](out, recording)
    return f"{counted(recording.t.size, 'sample')}, {recording.t[-1] - recording.t[0]:.2f} s"


def _taught(recording: Recording, preset: str, name: str | None = None) -> SessionExport:
    """Return a recording with its results, in the form of a session. name: of the session."""
    recording = without_confirmed(recording)
    view = segmented(recording, preset)
    opening = opening_of(recording, preset)
    exported: type[SessionExport] = import_module("caesura_lab.export.session_from_journal").SessionExport
    return exported(
        station=STATION,
        opening=opening if name is None else opening.model_copy(update={"session": name}),
        recording=recording,
        began_s=max(recording.began_s or 0.0, -float(recording.t.min())),  # not before 1970
        view=view,
        program=TaskProgram(
            complete=True,
            apps=tuple(view.apps),
            notes=(*view.notes, *recording.cautions),
            force_limit_n=view.force_limit_n,
            robot=view.robot,
            up=view.up,
        ),
    )

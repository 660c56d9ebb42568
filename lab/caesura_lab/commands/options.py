"""Options that commands on a recording share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import ProgramOptions, Reading, reported
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording, wrong_option
from caesura_service.changepoint.presets import KNOWN_PRESETS, PRESETS

RecordingFile = Annotated[Path, typer.Argument(help="Recording: npz, csv, MCAP, or a rosbag2.")]


RecordingFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILE...",
        help="Recordings: npz, csv, MCAP, or a rosbag2. A directory stands for all recordings in it.",
        show_default=False,
    ),
]


def stated_recording(
    file: Path, reading: Reading, asked: ProgramOptions, mapping: Path | None, *, as_stated: bool = False
) -> Recording:
    """Read a recording with the options of the command line, which come before its own statements.

    as_stated: as for `load_recording`. Raises CaesuraError, ProtocolError.
    """
    recording = load_recording(
        file,
        **reading._asdict(),
        robot=asked.robot,
        up=asked.up,
        mapping=mapping,
        as_stated=as_stated,
    )
    return replace(recording, setting=asked.setting().completed_by(recording.setting))


def namesakes(files: Sequence[Path]) -> tuple[Path, Path] | None:
    """Return two files with the same name except its suffix, in order; None if there are none."""
    first: dict[str, Path] = {}
    for file in files:
        if (other := first.setdefault(file.stem, file)) != file:
            return other, file
    return None


def _known_preset(name: str) -> str:
    with reported():
        if name not in KNOWN_PRESETS:
            raise CaesuraError(wrong_option("preset", name, KNOWN_PRESETS))
    return name


PresetName = Annotated[
    str, typer.Option(help=f"Preset of the models: {', '.join(sorted(PRESETS))}.", callback=_known_preset)
]
Mapping = Annotated[
    Path | None,
    typer.Option(help="Names and units in a csv or rosbag2 of other software (docs/recordings.md)."),
]

"""Options that commands on a recording share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from caesura_clients.cli.options import reported
from caesura_protocol.errors import CaesuraError
from caesura_protocol.recording import wrong_option
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

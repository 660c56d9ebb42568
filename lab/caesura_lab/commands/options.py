"""Options that commands on a recording share."""

from __future__ import annotations

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


def _known_preset(name: str) -> str:
    with reported():
        if name not in KNOWN_PRESETS:
            raise CaesuraError(wrong_option("preset", name, KNOWN_PRESETS))
    return name


PresetName = Annotated[
    str, typer.Option(help=f"Model: {', '.join(sorted(PRESETS))}.", callback=_known_preset)
]
Mapping = Annotated[
    Path | None,
    typer.Option(help="Names and units in a csv or rosbag2 of other software (docs/recordings.md)."),
]

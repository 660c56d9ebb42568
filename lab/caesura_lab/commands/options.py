"""Options that commands on a recording share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from caesura_service.changepoint.presets import PRESETS

RecordingFile = Annotated[Path, typer.Argument(help="Recording: npz, csv, MCAP, or a rosbag2.")]
PresetName = Annotated[str, typer.Option(help=f"Model: {', '.join(sorted(PRESETS))}.")]
Mapping = Annotated[
    Path | None,
    typer.Option(help="Names and units in a csv or rosbag2 of other software (docs/recordings.md)."),
]

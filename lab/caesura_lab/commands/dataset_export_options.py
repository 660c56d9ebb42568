"""The options of `caesura export` and `caesura sessions export` for a dataset of several demonstrations."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from caesura_protocol.errors import CaesuraError
from caesura_protocol.number_words import counted

if TYPE_CHECKING:
    from caesura_lab.export.session_from_journal import SessionExport

DATASET_OPTIONS = "--fps, --task, --success, --failed and --without-language"


class DatasetOptions(NamedTuple):
    """Options of `--format lerobot`."""

    fps: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Frames per second; by default the rate of the samples, at most 100."
        ),
    ] = None
    task: Annotated[str | None, typer.Option(help="Task of all episodes; by default the name of each.")] = (
        None
    )
    success: Annotated[
        bool, typer.Option("--success", help="Mark the episodes as successful, except those of --failed.")
    ] = False
    failed: Annotated[
        list[str], typer.Option(metavar="NAME", help="An episode that failed; may be repeated.")
    ] = []  # noqa: RUF012 - typer copies it
    without_language: Annotated[
        bool, typer.Option("--without-language", help="Omit the language columns, which lerobot 0.4 refuses.")
    ] = False

    def success_of(self, names: Sequence[str]) -> dict[str, bool]:
        """Return whether each session succeeded, if stated. Raises CaesuraError."""
        if unknown_names := sorted(set(self.failed) - set(names)):
            raise CaesuraError(f"--failed {unknown_names[0]}: exported episodes are {', '.join(names)}")
        return {name: name not in self.failed for name in names if self.success or name in self.failed}


def write_dataset(out: Path, taught: Sequence[SessionExport], asked: DatasetOptions) -> str:
    """Write demonstrations as a dataset; return text on it. Raises CaesuraError, OSError."""
    episodes = import_module("caesura_lab.export.lerobot_dataset").write_sessions(
        out,
        taught,
        fps=asked.fps,
        task=asked.task,
        success=asked.success_of([one.opening.session for one in taught]),
        language=not asked.without_language,
    )
    for line in (line for episode in episodes for line in episode.left_out):
        typer.echo(line, err=True)
    frames = sum(episode.length for episode in episodes)
    return f"{counted(len(episodes), 'episode')}, {counted(frames, 'frame')} at {episodes[0].fps} Hz"

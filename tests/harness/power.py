"""Power losses: a process is killed, and its files become what had been synced to the disk by then."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("synced.c")
COMPILER = shutil.which("gcc") or shutil.which("cc")
NO_COMPILER = "not run: there is no C compiler (scripts/debian.sh gcc)"


class Power:
    """Keeps each file of a directory as it was at its last fsync by a process started through `command`."""

    def __init__(self, directory: Path, beside: Path) -> None:
        """directory: whose files may be lost; beside: where the copies go. Both are made."""
        self.directory, self._kept = directory.resolve(), beside.resolve() / "synced"
        self._library = beside.resolve() / "synced.so"
        for made in (self.directory, self._kept):
            made.mkdir(parents=True, exist_ok=True)
        build(SOURCE, self._library)

    def command(self, command: list[str]) -> list[str]:
        """The same command, watched."""
        watched = {"LD_PRELOAD": self._library, "SYNCED_FROM": self.directory, "SYNCED_TO": self._kept}
        return ["env", *(f"{name}={value}" for name, value in watched.items()), *command]

    def lose(self) -> None:
        """To be called while no process has the files: put what was synced in their place."""
        shutil.rmtree(self.directory)
        self.directory.mkdir()
        for kept in self._kept.iterdir():
            if kept.suffix != ".half":
                shutil.copy(kept, self.directory / kept.name)


def build(source: Path, library: Path) -> None:
    """A library to preload. Raises CalledProcessError."""
    command = [str(COMPILER), "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl"]
    subprocess.run(command, check=True, timeout=60.0)


def environment() -> dict[str, str]:
    """Of a child that imports what this process does."""
    path = os.pathsep.join(filter(None, [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path}

"""Runs a program on the simulated robot, in a separate process, so that it does not block the pages.

It runs the commands `caesura program --speed` and `caesura execute --simulated`. So a dashboard without the
simulation states what to install, as the command does.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from caesura_clients.dashboard.correction_requests import EditRefused
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Program
from caesura_protocol.programs.document import document
from caesura_protocol.programs.export_formats import WRITERS

SPEEDS = ("taught", "optimal")
LONGEST_S = 180.0  # of a simulation
MOST_APPS = 200  # a minute or so of a simulation
POINTS = 600  # of a run that are sent
MM = 1000.0


class SimulatorBusyError(EditRefused):
    """Another simulation is running."""


class Simulation:
    """The process of one simulation; any thread may end it, at any time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._child: subprocess.Popen[str] | None = None
        self.is_ended = False

    def end(self) -> None:
        """Kill the process, and start no other one."""
        with self._lock:
            self.is_ended = True
            if self._child is not None:
                self._child.kill()

    def outcome(self, command: Sequence[str]) -> tuple[str, int]:
        """Run a command to its end; return its output and its exit code. Raises EditRefused."""
        with self._lock:
            self._check_goes_on()
            self._child = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
        with self._child as child:
            try:
                said, _ = child.communicate(timeout=LONGEST_S)
            except subprocess.TimeoutExpired:
                raise EditRefused(f"Not simulated: no result after {LONGEST_S:g} s.") from None
            finally:
                child.kill()  # nothing where it has ended
        self._check_goes_on()
        return said, child.returncode

    def _check_goes_on(self) -> None:
        if self.is_ended:
            raise EditRefused("Not simulated: cancelled.")


class Simulator:
    """Simulates one program at a time."""

    def __init__(self) -> None:
        self._one = threading.Lock()
        self._current = Simulation()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._current.end()

    @property
    def is_busy(self) -> bool:
        """Whether a simulation is running."""
        return self._one.locked()

    def run(self, program: Program, speed: str, simulation: Simulation | None = None) -> dict[str, Any]:
        """Run a program: {said, stopped, points}; points are [t, x, y, z], [s] of the run and [mm].

        stopped: whether a check or the safety monitor stopped it. simulation: lets another thread end it.
        Raises EditRefused if it cannot be run or is ended.
        """
        if speed not in SPEEDS:
            raise EditRefused(f"Not simulated: speed {speed[:20]!r}, expected {' or '.join(SPEEDS)}.")
        if len(program.apps) > MOST_APPS:
            many = f"the program has {len(program.apps)} apps, at most {MOST_APPS} are simulated here"
            raise EditRefused(f"Not simulated: {many}.")
        if not self._one.acquire(blocking=False):
            raise SimulatorBusyError("Not simulated: another simulation is under way on this dashboard.")
        try:
            self._current = simulation or Simulation()
            with tempfile.TemporaryDirectory(prefix="caesura-simulation-") as folder:
                return self._run(program, speed, Path(folder))
        finally:
            self._one.release()

    def _run(self, program: Program, speed: str, folder: Path) -> dict[str, Any]:
        taught, run = folder / "program.json", folder / "run.npz"
        try:
            taught.write_text(WRITERS["json"].write(document(program)), encoding="utf-8")
        except (ValueError, CaesuraError) as error:
            raise EditRefused(f"Not simulated: {error}.") from error
        asked = taught
        if speed != "taught":
            asked = folder / f"{speed}.json"
            options = [f"--file={taught}", f"--speed={speed}", "--format=json", f"--out={asked}"]
            self._command(["program", *options], asked)
        said, ended_well = self._command(["execute", str(asked), "--simulated", f"--out={run}"], run)
        recording = load_recording(run)
        chosen = np.unique(np.linspace(0, len(recording.t) - 1, POINTS).astype(int))
        table = np.column_stack(
            [recording.t[chosen].round(2), (MM * recording.signals["pos"][chosen]).round(1)]
        )
        words = said.replace(f"; {run}", "").replace("\n", "; ")
        outcome = "Ran to the end" if ended_well else "Not ended"
        return {"said": f"{outcome}: {words}.", "stopped": not ended_well, "points": (table + 0.0).tolist()}

    def _command(self, words: Sequence[str], made: Path) -> tuple[str, bool]:
        """Run a command that writes a file; return its output, and whether it succeeded.

        Raises EditRefused.
        """
        said, code = self._current.outcome([sys.executable, "-m", "caesura_clients", *words])
        lines = said.strip()
        if not made.exists():
            assumed, _, error = lines.partition("error: ")
            reason = f"{error} ({assumed.strip()})" if assumed and error else error or assumed
            raise EditRefused(f"Not simulated: {reason}")
        return lines, code == 0

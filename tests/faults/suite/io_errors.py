"""Every call to the disk fails in turn, as in SQLite's own tests (https://www.sqlite.org/testing.html, 3.2).

First each call once, then each with all that follow it until the service says so.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from faults.suite.outcome import Row
from harness.power import COMPILER, NO_COMPILER, build, environment

SOURCE = Path(__file__).parents[2] / "harness" / "failing.c"
MEMORY = Path("/dev/shm")  # a disk would be synced some ten thousand times
DEADLINE_S = 600.0


def io_errors(directory: Path, stride: int = 1) -> Row:
    """stride: fail only every so many-th call."""
    if COMPILER is None:
        return Row(0, 0, 0, 0, "–", None, NO_COMPILER, met=False)
    library = directory / "failing.so"
    build(SOURCE, library)
    where = MEMORY if os.access(MEMORY, os.W_OK) else directory
    with tempfile.TemporaryDirectory(dir=where) as journals:
        command = [sys.executable, "-m", "faults.suite.io_errors_process", journals, str(stride)]
        watched = {"LD_PRELOAD": str(library), "FAILING_IN": journals}
        ended = subprocess.run(
            command,
            env={**environment(), **watched},
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=True,
        )
    modes = [json.loads(line) for line in ended.stdout.splitlines()]
    wrong = [f"call {call} {mode['mode']}: {why[0]}" for mode in modes for call, why in mode["wrong"].items()]
    note = "; ".join(
        f"{mode['failures']} calls failed {mode['mode']}, {mode['said']} said why" for mode in modes
    )
    note += f"; wrong: {len(wrong)}" + "".join(f"; {one}" for one in wrong[:3])
    sessions = 3 * sum(mode["failures"] for mode in modes)
    met = not wrong and len(modes) == 2 and all(mode["failures"] and mode["said"] for mode in modes)
    return Row(sessions, 0, 0, 0, "no" if wrong else "yes", None, note, met)

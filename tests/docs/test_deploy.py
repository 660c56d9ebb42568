"""docs/deploy.md, followed word by word: from nothing to certificates, two stations and somebody who watches.

Real processes on free ports in an empty directory. Only the ports are put in, and the simulated hand does not
take its time.
"""

from __future__ import annotations

import os
import re
import select
import shlex
import signal
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, suppress
from pathlib import Path
from subprocess import PIPE

import pytest

from clients.conftest import free_port
from harness.forked import Forked
from harness.processes import CAESURA, start

pytestmark = pytest.mark.slow

PAGE = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text()
DEADLINE_S = 60.0
IN_TERMINALS_OF_THEIR_OWN = ("serve", "bridge", "watch")
Started = subprocess.Popen[str] | Forked


def commands(section: str) -> list[str]:
    """The fenced commands of a section, in order."""
    text = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (found,) = [part for part in text if part.startswith(f"{section}\n")]
    blocks = re.findall(r"^```sh\n(.*?)^```", found, re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.splitlines()]


def verb(command: str) -> str:
    """Of `caesura VERB …`, or the command itself."""
    first, second, *_ = command.split()
    return second if first == "caesura" else first


def two_free_ports() -> int:
    """The first of two that follow each other: the metrics of two instances."""
    for _ in range(100):
        first = free_port()
        with suppress(OSError), socket.create_server(("127.0.0.1", first + 1)):
            return first
    raise AssertionError("no two free ports")


class Machine:
    """Runs commands as they are typed, in one directory."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._router, self._metrics = free_port(), two_free_ports()
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self._environment = {**os.environ, "PATH": path, "COLUMNS": "120"}
        self.running: list[tuple[str, Started]] = []

    def start(self, command: str) -> Started:
        process = self._start(self._here(command))
        self.running.append((verb(command), process))
        return process

    def run(self, command: str) -> str:
        """What it prints; fails unless its exit code is 0."""
        process = self._start(self._here(command))
        try:
            out, error = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
        assert process.returncode == 0, f"{command}\n{out}\n{error}"
        return out

    def outputs(self, name: str) -> list[str]:
        """Wait for all that run under this name, and let go of them."""
        mine = [process for known, process in self.running if known == name]
        self.running = [one for one in self.running if one[0] != name]
        return [process.communicate(timeout=DEADLINE_S)[0] for process in mine]

    def interrupt(self, name: str) -> list[str]:
        """Ctrl-C."""
        for known, process in self.running:
            if known == name:
                process.send_signal(signal.SIGINT)
        return self.outputs(name)

    def _start(self, command: str) -> Started:
        """`caesura` in a forked process, what else there is by a shell."""
        options = {"env": self._environment, "stdout": PIPE, "stderr": PIPE}
        first, *words = shlex.split(command)
        with chdir(self._folder):
            if first == "caesura":
                return start([*CAESURA, *words], **options)
            return subprocess.Popen(["sh", "-c", command], text=True, **options)

    def _here(self, command: str) -> str:
        command = command.replace(":7447", f":{self._router}").replace(":9464", f":{self._metrics}")
        if verb(command) == "certs" and "--host" in command:
            command += f" --listen tls/[::]:{self._router}"
        return command.replace("--source teacher", "--source teacher --pace 4")


@pytest.fixture
def machine(tmp_path) -> Iterator[Machine]:
    one = Machine(tmp_path)
    yield one
    for _, process in one.running:
        process.kill()
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=DEADLINE_S)


def ready(service: Started) -> str:
    assert service.stdout is not None
    if not select.select([service.stdout], [], [], DEADLINE_S)[0]:
        service.kill()  # it says below how far it came
    line = service.stdout.readline()
    assert "caesura ready at tls/" in line, service.communicate(timeout=DEADLINE_S)
    return line


def test_from_nothing_to_two_stations_and_a_watcher(machine, tmp_path):
    steps = commands("One machine")
    said: dict[str, str] = {}
    for command in steps:
        name = verb(command)
        if name == "sessions":
            bridges = machine.outputs("bridge")
        if name not in IN_TERMINALS_OF_THEIR_OWN:
            said[name] = machine.run(command)
        elif name == "serve":
            ready(machine.start(command))
        else:
            machine.start(command)
    assert [line.split("/")[0] for line in bridges] == ["cell-1", "cell-2"]
    assert all("closed," in line for line in bridges)
    assert "✗" not in said["doctor"]
    assert "caesura-1 is alive" in said["doctor"]
    assert said["curl"] == "ok\n"
    assert {"cell-1", "cell-2"} <= set(re.findall(r"cell-\d", said["sessions"]))
    assert "complete" in said["program"]
    (watched,) = machine.interrupt("watch")
    assert {"cell-1/", "cell-2/"} <= set(re.findall(r"^cell-\d/", watched, flags=re.MULTILINE))
    assert (tmp_path / "certs" / "bridge.cell-3.json5").exists()

    (backup,) = commands("Backing up")
    machine.run(backup)
    failing = subprocess.run(
        backup.replace("caesura-1", "caesura1"), cwd=tmp_path, shell=True, capture_output=True, check=False
    )
    assert failing.returncode != 0, "a mistyped name made an empty copy in place of the last one"
    assert not (tmp_path / "journal" / "caesura1.sqlite").exists()
    with sqlite3.connect(tmp_path / "copy.sqlite") as copy:
        assert copy.execute("SELECT count(*) FROM sessions").fetchone() == (2,)
    copy.close()

    machine.interrupt("serve")
    certs, serve, doctor = commands("Several instances")
    machine.run(certs)
    assert "caesura-1, caesura-2" in ready(machine.start(serve))
    looked_at = machine.run(doctor)
    assert "caesura-1 is alive" in looked_at
    assert "caesura-2 is alive" in looked_at
    again = machine.run(next(one for one in steps if verb(one) == "sessions"))
    assert {"cell-1", "cell-2"} <= set(re.findall(r"cell-\d", again)), "what was taught is still there"


def test_files_that_the_page_names_are_there():
    root = Path(__file__).parents[2]
    named = set(re.findall(r"deploy/[\w./@-]+", PAGE))
    assert named
    assert [name for name in sorted(named) if not (root / name.rstrip(".")).exists()] == []

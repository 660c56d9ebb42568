"""`caesura serve --instances N`: several processes that share the stations, and live and die as one."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from caesura_clients import Caesura, connect
from caesura_clients.query import services
from caesura_service.commands.supervisor import Instance, credentials_of, names_of
from harness.processes import DEADLINE_S, eventually, start, started

pytestmark = pytest.mark.slow

SERVE = [sys.executable, "-m", "caesura_service", "serve"]


class Supervised:
    """The command, and what its processes are."""

    def __init__(self, journal: Path) -> None:
        options = ["--listen", "tcp/127.0.0.1:0", "--instances", "2", "--instance", "west"]
        options += ["--instance-silence-s", "8"]
        command = [*SERVE, *options, "--journal", str(journal), "--preset", "contact", "--log-level", "error"]
        self.process = start(command, stdout=subprocess.PIPE)
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()
        self.endpoint = self.line.split()[3] if self.line else ""

    def children(self) -> list[int]:
        tasks = Path(f"/proc/{self.process.pid}/task").iterdir()  # each thread has its own
        return [int(child) for task in tasks for child in (task / "children").read_text().split()]


@pytest.fixture
def supervised(tmp_path: Path) -> Iterator[Supervised]:
    running = Supervised(tmp_path)
    try:
        yield running
    finally:
        running.process.kill()
        running.process.communicate(timeout=DEADLINE_S)


def alive(caesura: Caesura) -> list[str]:
    return services(caesura.transport)


def gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except (FileNotFoundError, ProcessLookupError):  # before it is opened, or before it is read
        return True


def test_it_says_where_it_is_starts_again_what_dies_or_hangs_and_leaves_cleanly_with_all(supervised):
    assert supervised.line == f"caesura ready at {supervised.endpoint} as west-1, west-2\n"
    with connect(supervised.endpoint, timeout_s=DEADLINE_S) as caesura:
        assert alive(caesura) == ["west-1", "west-2"]
        victim, other = supervised.children()
        for end in (signal.SIGKILL, signal.SIGSTOP):  # one that hangs was shared out to the others
            os.kill(victim, end)
            eventually(lambda victim=victim: gone(victim) and victim not in supervised.children())
            eventually(lambda: len(supervised.children()) == 2)
            eventually(lambda: alive(caesura) == ["west-1", "west-2"])
            (new,) = set(supervised.children()) - {other}
            victim, other = other, new  # one that has just begun to announce itself may take minutes to start
    supervised.process.send_signal(signal.SIGTERM)
    children = supervised.children()
    assert supervised.process.wait(DEADLINE_S) == 0
    assert len(children) == 2
    assert all(gone(child) for child in children)


def test_its_instances_end_when_it_is_killed(supervised):
    children = supervised.children()
    supervised.process.kill()
    eventually(lambda: all(gone(child) for child in children))


def test_one_that_cannot_begin_is_said_and_ends_it_all(tmp_path):
    (tmp_path / "caesura-2.sqlite").write_text("a letter to my mother " * 100)
    options = ["--listen", "tcp/127.0.0.1:0", "--instances", "2", "--journal", str(tmp_path)]
    with started([*SERVE, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        out, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    assert out == ""
    assert "caesura-2.sqlite is no journal" in error
    assert "caesura serve: instance caesura-2 ended with 1 before it was ready" in error


def test_one_that_cannot_be_started_again_for_lack_of_memory_is_started_later(monkeypatch):
    begun, ready, start_process = [], threading.Event(), subprocess.Popen

    def scarce(*command, **options):
        begun.append(None)
        if len(begun) == 2:
            raise OSError(errno.ENOMEM, "Cannot allocate memory")
        begun[-1] = start_process(*command, **options)
        return begun[-1]

    monkeypatch.setattr(subprocess, "Popen", scarce)
    says_so = "import sys; print('caesura ready', flush=True); sys.stdin.read()"
    instance = Instance("west-1", [sys.executable, "-c", says_so], ready.set)
    instance.start()
    try:
        assert ready.wait(DEADLINE_S)
        ready.clear()
        begun[0].kill()
        assert ready.wait(DEADLINE_S)
        assert len(begun) == 3
    finally:
        instance.end()


def test_names_count_on_from_that_of_a_single_instance():
    assert names_of("caesura-1", 3, default="caesura-1") == ["caesura-1", "caesura-2", "caesura-3"]
    assert names_of("cell-1", 2, default="caesura-1") == ["cell-1-1", "cell-1-2"]


def test_an_instance_shows_its_own_credentials_where_there_are_some(tmp_path):
    router, own = tmp_path / "router.json5", tmp_path / "service.west-1.json5"
    own.touch()
    assert credentials_of(router, "west-1") == ["--zenoh-config", str(own)]
    assert credentials_of(router, "west-2") == ["--zenoh-config", str(router)]
    assert credentials_of(None, "west-1") == []

"""`caesura serve` as a process: its ready line, its options, and how it leaves."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from harness.peer import Peer

DEADLINE_S = 20.0


@contextmanager
def serving(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process and the endpoint of its ready line."""
    command = [sys.executable, "-m", "caesura_service", "serve", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        words = process.stdout.readline().split()
        assert words[:3] == ["caesura", "ready", "at"], process.communicate(timeout=DEADLINE_S)
        yield process, words[3]
    finally:
        process.kill()
        process.communicate(timeout=DEADLINE_S)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_is_serves_and_leaves_cleanly_at_a_signal(number):
    with serving("--listen", "tcp/127.0.0.1:0", "--instance", "cell-west") as (process, endpoint):
        with Peer(endpoint) as peer:
            assert peer.service_status("cell-west").instance == "cell-west"
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == 0


def test_it_can_be_stopped_while_it_waits_for_a_router():
    command = [sys.executable, "-m", "caesura_service", "serve", "--connect", "tcp/127.0.0.1:9"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert any("no router at tcp/127.0.0.1:9" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=DEADLINE_S)[0] == ""
        assert process.returncode == 0


def test_a_second_one_on_the_same_endpoint_says_why_not():
    with serving("--listen", "tcp/127.0.0.1:0") as (_, endpoint):
        command = [sys.executable, "-m", "caesura_service", "serve", "--listen", endpoint]
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 1
    assert "Address already in use" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_name_that_is_no_name_is_refused():
    command = [sys.executable, "-m", "caesura_service", "serve", "--instance", "Not A Name"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 1
    assert "'Not A Name'" in done.stderr

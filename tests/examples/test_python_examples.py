"""Each Python example, as a process of its own, with a real service."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from caesura_clients import Caesura, connect
from harness.processes import ServiceProcess, running, snapshot

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SESSION = "s1"


@pytest.fixture(scope="module")
def service(tmp_path_factory) -> Iterator[ServiceProcess]:
    with running(ServiceProcess(tmp_path_factory.mktemp("journal"))) as started:
        yield started


@pytest.fixture(scope="module")
def caesura(service) -> Iterator[Caesura]:
    with connect(service.endpoint) as client:
        yield client


def run(name: str, *args: str, endpoint: str) -> str:
    """An example as it stands, but for the address: it says the default one."""
    source = (EXAMPLES / name).read_text(encoding="utf-8")
    assert source.count("connect()") <= 1
    done = subprocess.run(
        [sys.executable, "-c", source.replace("connect()", f"connect({endpoint!r})"), *args],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.py")), ids=lambda file: file.name)
def test_an_example_states_its_arguments(file: Path):
    """`--help` was taken for an endpoint or a number, or was ignored: each ended with a traceback."""
    command = [sys.executable, file, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: {file.name} [-h] [")


def test_a_bridge_of_ones_own_a_query_and_a_reader(service, caesura):
    said = run("own_source.py", "2", endpoint=service.endpoint)
    session = said.split()[1].rstrip(":")
    assert said == f"session {session}: 100 batches, 0 of them lost\n"
    found = caesura.snapshot("cell-1", session)
    assert (found.status.samples, found.status.state, found.status.gaps) == (2000, "closed", ())

    program = run("query.py", endpoint=service.endpoint)
    assert len(program.splitlines()) == len(found.program.apps) > 0
    assert found.program.apps[0].kind in program.splitlines()[0]

    source = (EXAMPLES / "follow.py").read_text()
    assert "silence_s=30.0" in source
    followed = subprocess.run(
        [
            sys.executable,
            "-c",
            source.replace("connect()", f"connect({service.endpoint!r})").replace("30.0", "0.5"),
        ],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=True,
    )
    kinds = " ".join(segment.kind for segment in found.segments.segments[-5:])
    assert followed.stdout.splitlines()[-1] == f"{found.status.t:.1f} s: {kinds}"


def test_the_minimal_bridge_speaks_the_wire_without_our_library(service, caesura):
    source = (EXAMPLES / "minimal_bridge.py").read_text()
    assert "caesura_clients" not in source
    assert "caesura_protocol" not in source
    said = run("minimal_bridge.py", service.endpoint, "cell-raw", "1", endpoint=service.endpoint)
    where, state, batches, _ = said.split()
    assert (state, batches) == ("closed,", "50")
    found = caesura.snapshot("cell-raw", where.removeprefix("cell-raw/"))
    status = found.status
    assert (status.samples, status.state, status.gaps, status.refused) == (1000, "closed", (), {})
    assert found.segments.segments
    assert snapshot(caesura, "cell-raw") is None  # of that name there is none


LOSSY = """
import random
random.seed(1)
put = MinimalBridge.send
MinimalBridge.send = lambda bridge, payload: put(bridge, payload) if random.random() < 0.7 else None
"""


def test_what_the_minimal_bridge_loses_is_replayed(service, caesura):
    source = (EXAMPLES / "minimal_bridge.py").read_text()
    lossy = source.replace('if __name__ == "__main__":', LOSSY + '\nif __name__ == "__main__":')
    done = subprocess.run(
        [sys.executable, "-c", lossy, service.endpoint, "cell-lossy", "1"],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    session = done.stdout.split()[0].removeprefix("cell-lossy/")
    status = caesura.snapshot("cell-lossy", session).status
    assert (status.samples, status.gaps, status.refused) == (1000, (), {})


def test_the_minimal_bridge_says_why_it_is_refused(service):
    source = (EXAMPLES / "minimal_bridge.py").read_text().replace('["t", "px", "py", "pz"]', '["t", "qq"]')
    done = subprocess.run(
        [sys.executable, "-c", source, service.endpoint, "cell-wrong", "1"],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("malformed: ")


def test_a_bridge_without_a_router_is_one_line():
    # It was a traceback of zenoh.
    command = [sys.executable, EXAMPLES / "minimal_bridge.py", "tcp/127.0.0.1:1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    said = "error: no router at tcp/127.0.0.1:1: start `caesura serve`, or name another endpoint\n"
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith(said)
    assert "Traceback" not in done.stderr

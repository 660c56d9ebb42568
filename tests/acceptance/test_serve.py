"""`caesura serve` as a process: its ready line, its options, and how it leaves."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

from caesura_service.__main__ import app
from clients.conftest import RouterNetwork
from harness.peer import Peer

DEADLINE_S = 60.0
SERVE = [sys.executable, "-m", "caesura_service", "serve"]


@contextmanager
def serving(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process and the endpoint of its ready line."""
    options = options if "--journal" in options else (*options, "--journal", "memory")
    command = [*SERVE, *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        words = process.stdout.readline().split()
        assert words[:3] == ["caesura", "ready", "at"], process.communicate(timeout=DEADLINE_S)
        yield process, words[3]
    finally:
        process.kill()
        process.communicate(timeout=DEADLINE_S)


def refused(*options: str) -> str:
    """What it says where it does not begin, in this process."""
    done = CliRunner().invoke(app, ["serve", *options])
    assert (done.exit_code, done.stdout) == (1, "")
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_is_serves_and_leaves_cleanly_at_a_signal(number):
    with serving("--listen", "tcp/127.0.0.1:0", "--instance", "cell-west") as (process, endpoint):
        with Peer(endpoint) as peer:
            assert peer.service_status("cell-west").instance == "cell-west"
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == 0


def test_it_can_be_stopped_while_it_waits_for_a_router():
    command = [*SERVE, "--connect", "tcp/127.0.0.1:9", "--journal", "memory"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert any("no router at tcp/127.0.0.1:9" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=DEADLINE_S)[0] == ""
        assert process.returncode == 0


def test_a_second_one_on_the_same_endpoint_says_why_not():
    with RouterNetwork() as first:
        command = [*SERVE, "--listen", first.endpoint, "--journal", "memory"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 1
    assert "Address already in use" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_name_that_is_no_name_is_refused():
    assert "'Not A Name'" in refused("--instance", "Not A Name")


def test_sessions_are_kept_in_the_users_state_directory_unless_told_otherwise(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    command = [*SERVE, "--listen", "tcp/127.0.0.1:0", "--instance", "west"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert "ready" in process.stdout.readline()
        finally:
            process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=DEADLINE_S)[1]
    path = tmp_path / "caesura" / "west.sqlite"
    assert path.exists()
    assert f"journal {path}, written every 0.05 s" in said


def test_a_journal_that_will_not_do_is_one_line(tmp_path):
    (tmp_path / "caesura-1.sqlite").write_text("a letter to my mother " * 100)
    said = refused("--listen", "tcp/127.0.0.1:0", "--journal", str(tmp_path))
    assert said.startswith(f"caesura serve: journal {tmp_path}/caesura-1.sqlite is no journal: move it")


def test_what_other_machines_reach_is_not_listened_on_without_credentials():
    said = refused("--listen", "tcp/0.0.0.0:0", "--journal", "memory")
    assert "caesura serve: tcp/0.0.0.0:" in said
    assert "say --insecure" in said


def test_unless_told_to_and_how_long_a_record_may_wait_is_an_option_that_the_status_shows(tmp_path):
    options = ("--listen", "tcp/0.0.0.0:0", "--insecure", "--journal", str(tmp_path))
    with serving(*options, "--journal-commit-s", "0.2") as (_, endpoint):
        assert endpoint.startswith("tcp/0.0.0.0:")
        with Peer(endpoint.replace("0.0.0.0", "127.0.0.1")) as peer:
            journal = peer.service_status("caesura-1").journal
    assert journal is not None
    assert (journal.kind, journal.commit_s, journal.size_limit) == ("sqlite", 0.2, 10**10)

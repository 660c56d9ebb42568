"""`caesura serve` as a process: its ready line, its options, and how it leaves.

How it leaves at a signal is tested with an interpreter of its own; every other process is forked.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial

import pytest
from typer.testing import CliRunner

from caesura_service.__main__ import app
from clients.conftest import RouterNetwork
from harness.forked import Forked
from harness.peer import Peer
from harness.processes import start

DEADLINE_S = 60.0
Started = subprocess.Popen[str] | Forked
Start = Callable[..., Started]
SERVE = [sys.executable, "-m", "caesura_service", "serve"]


PIPES: Mapping[str, int] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}


@contextmanager
def running(*options: str, starting: Start = start) -> Iterator[Started]:
    """A process, killed in the end."""
    process = starting([*SERVE, *options], **PIPES)
    try:
        yield process
    finally:
        process.kill()
        process.communicate(timeout=DEADLINE_S)


@contextmanager
def serving(*options: str, starting: Start = start) -> Iterator[tuple[Started, str]]:
    """A process and the endpoint of its ready line."""
    options = options if "--journal" in options else (*options, "--journal", "memory")
    with running(*options, starting=starting) as process:
        assert process.stdout is not None
        words = process.stdout.readline().split()
        assert words[:3] == ["caesura", "ready", "at"], process.communicate(timeout=DEADLINE_S)
        yield process, words[3]


def refused(*options: str) -> str:
    """What it says where it does not begin, in this process."""
    done = CliRunner().invoke(app, ["serve", *options])
    assert (done.exit_code, done.stdout) == (1, "")
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "starting"),
    [(signal.SIGINT, partial(subprocess.Popen, text=True)), (signal.SIGTERM, start)],
    ids=["SIGINT, with an interpreter of its own", "SIGTERM"],
)
def test_it_says_where_it_is_serves_and_leaves_cleanly_at_a_signal(number: int, starting: Start):
    options = ("--listen", "tcp/127.0.0.1:0", "--instance", "cell-west")
    with serving(*options, starting=starting) as (process, endpoint):
        with Peer(endpoint) as peer:
            assert peer.service_status("cell-west").instance == "cell-west"
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == 0


def test_it_can_be_stopped_while_it_waits_for_a_router():
    with running("--connect", "tcp/127.0.0.1:9", "--journal", "memory") as process:
        assert process.stderr is not None
        assert any("no router at tcp/127.0.0.1:9" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=DEADLINE_S)[0] == ""
        assert process.returncode == 0


def test_a_second_one_on_the_same_endpoint_says_why_not():
    with RouterNetwork() as first:
        with running("--listen", first.endpoint, "--journal", "memory") as process:
            said = process.communicate(timeout=DEADLINE_S)[1]
        assert process.returncode == 1
    assert "Address already in use" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--listen", "x"), "'x' is no endpoint: write it as tcp/127.0.0.1:7447"),
        (("--connect", "x"), "'x' is no endpoint: write it as tcp/127.0.0.1:7447"),
        (("--listen", "tcp/127.0.0.1:99999"), "port 99999, expected 0 to 65535"),
        (("--connect", "tcp/127.0.0.1:99999"), "port 99999, expected 0 to 65535"),
        (("--listen", "foo/127.0.0.1:0"), "protocol 'foo', expected one of tcp, tls"),
        (("--listen", "tcp/0.0.0.0:0"), "set --insecure"),
        (("--listen", "tcp/127.0.0.1:{taken}"), "Address already in use"),
        (("--zenoh-config", "{config}"), "lost.pem: No such file"),
    ],
)
def test_an_endpoint_that_is_refused_leaves_no_journal(options: tuple[str, ...], why: str, tmp_path):
    """Each made a journal first, in a directory that was wrong as often as the endpoint."""
    config, journal = tmp_path / "router.json5", tmp_path / "journal"
    tls = '{tls: {listen_certificate: "lost.pem", listen_private_key: "lost.pem"}}'
    config.write_text(f'{{listen: {{endpoints: ["tls/127.0.0.1:0"]}}, transport: {{link: {tls}}}}}')
    with socket.create_server(("127.0.0.1", 0)) as taken:
        names = {"taken": taken.getsockname()[1], "config": config}
        said = refused(*(one.format(**names) for one in options), "--journal", str(journal))
    assert why in said
    assert not journal.exists()


def test_an_endpoint_of_a_router_and_one_of_a_client_contradict_each_other(tmp_path):
    """The first was left out in silence: bridges that were to connect to it found no service."""
    both = ("--listen", "tcp/127.0.0.1:0", "--connect", "tcp/127.0.0.1:7447")
    done = CliRunner().invoke(app, ["serve", *both, "--journal", str(tmp_path / "journal")])
    assert done.exit_code == 2
    assert "state one of them" in " ".join(done.stderr.replace("│", " ").split())
    assert not (tmp_path / "journal").exists()


def test_a_name_that_is_no_name_is_refused():
    """The error began with `malformed:`, and stated the rule as a regular expression."""
    done = CliRunner().invoke(app, ["serve", "--instance", "Not A Name"])
    assert done.exit_code == 2
    said = " ".join(done.stderr.replace("│", " ").split())
    assert "Invalid value for --instance: 'Not A Name', expected 1 to 64 of a to z, 0 to 9" in said


def test_sessions_are_kept_in_the_users_state_directory_unless_a_directory_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with running("--listen", "tcp/127.0.0.1:0", "--instance", "west") as process:
        assert process.stdout is not None
        assert "ready" in process.stdout.readline()
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
    assert "set --insecure" in said


def test_unless_it_is_named_and_how_long_a_record_may_wait_is_an_option_that_the_status_shows(tmp_path):
    options = ("--listen", "tcp/0.0.0.0:0", "--insecure", "--journal", str(tmp_path))
    with serving(*options, "--journal-commit-s", "0.2") as (_, endpoint):
        assert endpoint.startswith("tcp/0.0.0.0:")
        with Peer(endpoint.replace("0.0.0.0", "127.0.0.1")) as peer:
            journal = peer.service_status("caesura-1").journal
    assert journal is not None
    assert (journal.kind, journal.commit_s, journal.size_limit) == ("sqlite", 0.2, 10**10)

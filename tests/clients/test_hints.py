"""Hints at the reader: which are raised and cleared, in the table, as lines, and as commands that are run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from pydantic import ValidationError
from rich.console import Console
from typer import BadParameter

from caesura_clients.cli import hints as hints_command
from caesura_clients.cli.hints import _failure, hint_line
from caesura_clients.cli.result_tables import segments_view
from caesura_clients.hint_lifecycle import HintChange, HintChanges
from caesura_clients.session_follower import SessionRemoved
from caesura_clients.session_state_reader import SessionReader, Update
from caesura_protocol.messages import Hint, HintKind, Hints
from clients.answering import Answering
from clients.examples import example, snapshot
from harness.processes import eventually


def hint(kind: HintKind, since: float, until: float | None = None) -> Hint:
    return Hint(kind=kind, since=since, until=until, text=f"{kind} found.", advice="Move back.")


def hints(seq: int, *some: Hint) -> Hints:
    return example(Hints).model_copy(update={"seq": seq, "station": "cell-1", "session": "s1", "hints": some})


def update(*some: Hint, **changes: object) -> Update:
    reader = SessionReader()
    whole = snapshot(0, "motion", station="cell-1", session="s1", **changes)
    reader.restart(whole.model_copy(update={"hints": hints(0, *some)}))
    assert reader.update is not None
    return reader.update


def said(changes: HintChanges, event: Update | SessionRemoved) -> list[tuple[str, str, int]]:
    return [(one.event, one.hint.kind, one.active) for one in changes.receive(event)]


def test_a_reader_has_the_newest_message_whatever_was_lost():
    reader = SessionReader()
    reader.restart(snapshot(0, "motion", station="cell-1", session="s1", instance="a", epoch=1))
    newest = hints(7, hint("too_fast", 2.0)).model_copy(update={"instance": "a", "epoch": 1})
    assert reader.receive(newest) == "changed"
    assert reader.receive(newest.model_copy(update={"seq": 6, "hints": ()})) == "unchanged"
    assert reader.update is not None
    assert [one.kind for one in reader.update.hints] == ["too_fast"]


def test_each_hint_is_raised_and_cleared_once():
    changes = HintChanges()
    fast, limit = hint("too_fast", 2.0), hint("joint_limit", 3.0)
    assert said(changes, update(fast)) == [("raised", "too_fast", 1)]
    assert said(changes, update(fast, limit)) == [("raised", "joint_limit", 2)]
    assert said(changes, update(fast.model_copy(update={"until": 4.0}), limit)) == [
        ("cleared", "too_fast", 1)
    ]
    assert said(changes, update(limit)) == []
    assert said(changes, SessionRemoved("cell-1", "s1")) == [("cleared", "joint_limit", 0)]


def test_a_hint_that_asks_for_something_else_is_updated():
    changes = HintChanges()
    pause = hint("uncertain_boundary", 2.0)
    again = pause.model_copy(update={"advice": "Teach the part again."})
    assert said(changes, update(pause)) == [("raised", "uncertain_boundary", 1)]
    (change,) = changes.receive(update(again))
    assert (change.event, change.active) == ("updated", 1)
    assert hint_line(change) == (
        "cell-1/s1 2.00 updated uncertain_boundary uncertain_boundary found. Teach the part again."
    )
    reworded = again.model_copy(update={"text": "Otherwise said."})
    assert said(changes, update(reworded)) == []
    assert said(changes, SessionRemoved("cell-1", "s1")) == [("cleared", "uncertain_boundary", 0)]


def test_what_is_over_at_first_sight_is_no_change_and_the_end_clears_all():
    changes = HintChanges()
    assert said(changes, update(hint("too_fast", 2.0, until=3.0))) == []
    assert said(changes, update(hint("joint_limit", 3.0))) == [("raised", "joint_limit", 1)]
    assert said(changes, update(hint("joint_limit", 3.0), state="closed")) == [("cleared", "joint_limit", 0)]
    changes.receive(update(hint("singularity", 5.0)))
    assert [(one.event, one.hint.kind) for one in changes.clear()] == [("cleared", "singularity")]


def test_the_table_of_watch_shows_active_hints_only():
    one = update(hint("too_fast", 2.0), hint("joint_limit", 1.0, until=1.5))
    console = Console(width=120, color_system=None)
    with console.capture() as drawn:
        console.print(segments_view(one.status, one.segments, hints=one.hints))
    assert "! too_fast found. Move back." in drawn.get()
    assert "joint_limit" not in drawn.get()


def test_a_command_is_run_at_each_change_and_clears_at_the_end(router, tmp_path: Path):
    seen = tmp_path / "seen"
    script = tmp_path / "lamp.sh"
    script.write_text(
        f'echo "$CAESURA_HINT_EVENT $CAESURA_HINT_KIND $CAESURA_HINT_ACTIVE" >> {seen}; exit 3\n'
    )
    with Answering(router.transport()) as service:
        active = snapshot(0, "motion", station="cell-1", session="s1")
        service.snapshots = [active.model_copy(update={"hints": hints(0, hint("too_fast", 2.0))})]
        child = subprocess.Popen(
            [sys.executable, "-m", "caesura_clients", "hints", "--exec", f"sh {script}"],
            env={**os.environ, "CAESURA_CONNECT": router.endpoint},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        deadline = threading.Timer(100.0, child.kill)
        deadline.start()
        try:
            raised = child.stdout.readline()
            trouble = child.stderr.readline()  # comes once the command has ended
            child.send_signal(signal.SIGTERM)
            rest, more_trouble = child.communicate(timeout=60.0)
        finally:
            deadline.cancel()
            child.kill()
    assert raised == "cell-1/s1 2.00 raised too_fast too_fast found. Move back.\n"
    assert rest == "cell-1/s1 2.00 cleared too_fast\n"
    assert seen.read_text().splitlines() == ["raised too_fast 1", "cleared too_fast 0"]
    assert [trouble, more_trouble] == ["--exec sh: exit code 3\n"] * 2
    assert child.returncode == 0


def test_a_command_that_cannot_be_run_is_refused_at_the_start(tmp_path: Path):
    """It was reported at the first hint: an operator who watches a lamp sees no terminal."""
    (tmp_path / "lamp.sh").write_text("exit 0")
    for words in ("./no-such-lamp.sh", str(tmp_path / "lamp.sh")):
        with pytest.raises(BadParameter, match="no such command, or it may not be run"):
            hints_command._split(words)
    assert hints_command._split("sh -c true") == ["sh", "-c", "true"]


def changed() -> HintChange:
    return HintChange("raised", "cell-1", "s1", hint("too_fast", 2.0), 1)


def test_a_command_that_hangs_ends_with_what_it_started(monkeypatch, tmp_path: Path):
    monkeypatch.setattr(hints_command, "PATIENCE_S", 0.5)
    began = tmp_path / "began"
    script = tmp_path / "lamp.sh"
    script.write_text(f"sleep 300 & echo $! > {began}; wait\n")
    assert _failure(changed(), ["sh", str(script)]) == "ended after 0.5 s, the limit"
    pid = int(began.read_text())
    eventually(lambda: not is_running(pid))


def is_running(pid: int) -> bool:
    """Whether a process runs; one that has ended and that its parent has not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("field", ["text", "advice"])
@pytest.mark.parametrize("words", ["", 201 * "x", "Too\0fast.", "Too\nfast.", "Too\x1b[31mfast."])
def test_a_hint_is_one_short_line_that_every_environment_can_have(field: str, words: str):
    with pytest.raises(ValidationError, match=field):
        Hint.model_validate(hint("too_fast", 2.0).model_dump() | {field: words})


def test_a_command_that_is_none_ends_nothing():
    assert _failure(changed(), ["no-such-command"]) == "No such file or directory"
    assert _failure(changed(), ["true"]) == ""

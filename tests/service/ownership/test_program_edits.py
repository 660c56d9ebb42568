"""Edits of a program in the journal: kept over a restart, a kill, a takeover and a correction."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import StoredPage
from caesura_protocol.messages import (
    Ack,
    Action,
    AppReference,
    ChangeApp,
    DeleteApp,
    DuplicateApp,
    Edit,
    EditProgram,
    Insert,
    Program,
    ProgramAction,
    Redo,
    Undo,
)
from caesura_service.journal import JournalSettings, PeerJournals, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.program import EditLog
from caesura_service.publishing import session_state
from caesura_service.publishing.events import TakeoverFailed
from caesura_service.publishing.session_state import program_of
from harness.sessions import NAME, STATION, answer, batch, batches, closing, opening, published
from service.ownership.test_descriptions import OPENED, registry_on

FIRST = AppReference(kind="cartesian_motion", t0=0.0, tn=0.99)
RENAMED = ChangeApp(app=FIRST, name="reach")


def program(registry: Registry) -> Program:
    (state,) = registry.index.all_states()
    return program_of(state)


def edit(registry: Registry, action: ProgramAction, revision: int | None = None) -> Ack | ProtocolError:
    if revision is None:
        revision = program(registry).edit_revision
    command = EditProgram(session=NAME, revision=revision, author="Ann", action=action)
    return ask(registry, command)


def ask(registry: Registry, command: Edit | EditProgram) -> Ack | ProtocolError:
    return answer(registry.handle_command(STATION, command, OPENED + 60.0))


def taught(registry: Registry, *, closed: bool = False) -> None:
    assert isinstance(answer(registry.handle_command(STATION, opening(), OPENED)), Ack)
    for one in batches(20):
        registry.handle_samples(STATION, one, OPENED)
    if closed:
        assert isinstance(answer(registry.handle_command(STATION, closing(19), OPENED + 8.0)), Ack)


def names(registry: Registry) -> list[str | None]:
    return [one.name for one in program(registry).apps]


@pytest.mark.parametrize("is_closed", [False, True])
def test_edits_are_published_and_kept_over_a_restart(tmp_path: Path, is_closed: bool):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=is_closed)
        inferred = program(registry)
        command = EditProgram(session=NAME, revision=0, author="Ann", action=RENAMED)
        (shown,) = published(registry.handle_command(STATION, command, OPENED + 60.0), Program)
        assert (shown.apps[0].name, shown.author, shown.version) == ("reach", "Ann", inferred.version + 1)
        assert isinstance(edit(registry, DuplicateApp(app=FIRST)), Ack)
        assert isinstance(edit(registry, DeleteApp(app=FIRST)), Ack)
        assert isinstance(edit(registry, Undo()), Ack)
        before = program(registry)
    with registry_on(tmp_path / "a.sqlite") as registry:
        again = program(registry)
        assert again.model_copy(update={"instance": "", "epoch": 0}) == before.model_copy(
            update={"instance": "", "epoch": 0}
        )
        for _ in range(2):
            assert isinstance(edit(registry, Undo()), Ack)
        assert program(registry).apps == inferred.apps
        assert [one.state for one in program(registry).edits] == ["undone"] * 3


def test_an_acknowledged_edit_is_there_after_the_service_was_killed(tmp_path: Path):
    (left := tmp_path / "left").mkdir()
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        assert isinstance(edit(registry, RENAMED), Ack)
        for file in tmp_path.glob("a.sqlite*"):  # what a kill leaves: the log is not yet in the file
            shutil.copy(file, left)
    with registry_on(left / "a.sqlite") as registry:
        assert names(registry)[0] == "reach"
        assert isinstance(edit(registry, Undo()), Ack)
        assert names(registry)[0] is None


def test_apps_that_are_taught_after_an_edit_follow_and_the_edit_stays(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        count = len(program(registry).apps)
        assert isinstance(edit(registry, RENAMED), Ack)
        outputs = [
            out for seq in range(20, 60) for out in registry.handle_samples(STATION, batch(seq), OPENED)
        ]
        assert published(outputs, Program)[-1].apps[0].name == "reach"
        assert len(program(registry).apps) > count


def test_an_edit_is_merged_with_corrections_that_remove_its_app_and_bring_it_back(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=True)

        def corrected(action: Action, revision: int) -> None:
            command = Edit(session=NAME, revision=revision, author="Bo", action=action)
            while isinstance(answered := ask(registry, command), ProtocolError):
                assert answered.code == "overloaded", "a closed session is rebuilt first"
                registry.rebuild_step()

        corrected(Insert(t=0.8), 0)
        short = program(registry).apps[1]
        there = AppReference(kind=short.kind, t0=0.8, tn=short.tn)
        assert isinstance(edit(registry, ChangeApp(app=there, name="last bit")), Ack)
        corrected(Undo(), 1)
        (listed,) = program(registry).edits
        assert (listed.state, "no longer in the program" in str(listed.reason)) == ("not_applied", True)
        assert any("Edit 1 by Ann" in note for note in program(registry).notes)
        corrected(Redo(), 2)
        assert names(registry)[:3] == [None, "last bit", None]
        assert program(registry).notes == ()


def test_an_edit_on_an_older_program_is_refused_and_so_is_one_that_does_not_apply(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        assert isinstance(edit(registry, RENAMED), Ack)
        stale = edit(registry, DeleteApp(app=FIRST), revision=0)
        assert isinstance(stale, ProtocolError)
        assert (stale.code, stale.value, stale.limit) == ("conflict", 0, 1)
        refused = edit(registry, ChangeApp(app=FIRST, gripper_width=0.01))
        assert isinstance(refused, ProtocolError)
        assert "'move' moves no fingers" in refused.message
        assert program(registry).edit_revision == 1


def test_an_outcome_that_lacks_the_last_edit_is_not_believed(tmp_path: Path):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        taught(registry, closed=True)
    with sqlite3.connect(path) as database:
        stale = database.execute("SELECT opening, last_seq, snapshot, crc FROM outcomes").fetchone()
    with registry_on(path) as registry:
        assert isinstance(edit(registry, RENAMED), Ack)
    with sqlite3.connect(path) as database:  # as when the process is killed before the outcome is stored anew
        database.execute("UPDATE outcomes SET opening = ?, last_seq = ?, snapshot = ?, crc = ?", stale)
    with registry_on(path) as registry:
        assert names(registry)[0] == "reach"


@pytest.mark.parametrize("is_closed", [False, True])
def test_another_instance_takes_the_edits_over_and_continues_them(tmp_path: Path, is_closed: bool):
    first, second = tmp_path / "a.sqlite", tmp_path / "b.sqlite"
    with registry_on(first) as a:
        taught(a)
        assert isinstance(edit(a, RENAMED), Ack)
        with registry_on(second, peers=PeerJournals(second)) as b:
            assert names(b)[0] == "reach"
            assert isinstance(edit(a, DuplicateApp(app=FIRST)), Ack)
            if is_closed:
                assert isinstance(answer(a.handle_command(STATION, closing(19), OPENED + 8.0)), Ack)
            assert list(b.take_over(STATION, OPENED + 90.0))
            assert names(b)[:2] == ["reach", "reach"]
            while isinstance(reply := edit(b, Undo()), ProtocolError):
                assert reply.code == "overloaded", "a session that only the peer has is rebuilt first"
                b.rebuild_step()
            assert names(b)[:2] == ["reach", None]


def test_edits_are_applied_once_a_version_and_not_at_every_question(tmp_path: Path, monkeypatch):
    applied: list[int] = []
    with_edits = session_state.with_edits

    def counted(program: Program, log: EditLog) -> Program:
        applied.append(log.revision)
        return with_edits(program, log)

    monkeypatch.setattr(session_state, "with_edits", counted)
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        program(registry)
        assert applied == []
        assert isinstance(edit(registry, RENAMED), Ack)
        assert [names(registry)[0] for _ in range(5)] == ["reach"] * 5
        assert isinstance(edit(registry, Undo()), Ack)
        assert [names(registry)[0] for _ in range(5)] == [None] * 5
        assert applied == [1, 2]
        for one in batches(40)[20:]:
            registry.handle_samples(STATION, one, OPENED)
        (state,) = registry.index.all_states()
        assert program_of(state).t == state.program_header.t  # of the program as it is now


def test_an_edit_of_a_peer_that_has_nothing_to_undo_here_is_left_out(tmp_path: Path):
    """Two instances held the station for a while, as when the network was divided, and were edited apart."""
    first, second = tmp_path / "a.sqlite", tmp_path / "b.sqlite"
    with registry_on(first) as a:
        taught(a)
        assert isinstance(edit(a, RENAMED), Ack)
        with registry_on(second, peers=PeerJournals(second)) as b:
            assert isinstance(edit(b, Undo()), Ack)
            assert isinstance(edit(a, DuplicateApp(app=FIRST)), Ack)
            assert isinstance(edit(a, Undo()), Ack)  # names revision 2, where b has no edit left
            for seq in range(20, 30):
                a.handle_samples(STATION, batch(seq), OPENED)
            assert isinstance(edit(a, Undo()), Ack)  # all before an answer is on disk
            for outputs in b.take_over(STATION, OPENED + 90.0):
                assert not [one for one in outputs if isinstance(one, TakeoverFailed)]
            (state,) = b.index.all_states()
            assert (state.counters.batches, program(b).edit_revision) == (30, 2)
    with registry_on(second) as again:
        (state,) = again.index.all_states()
        assert (state.counters.batches, program(again).edit_revision) == (30, 2)


def test_a_session_that_is_no_longer_held_has_its_edits(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=True)
        assert isinstance(edit(registry, RENAMED), Ack)
        before = program(registry)
    newer: Any = SimpleNamespace(sessions={STATION: [SimpleNamespace(name="newer")]})
    with SqliteJournal(tmp_path / "a.sqlite", JournalSettings()) as journal:
        (found,) = StoredSessions(journal, lambda: newer).page(lambda _: True, StoredPage())
    assert (found.program.apps, found.program.edits) == (tuple(before.apps), before.edits)

"""Edits of a program in the journal: kept over a restart, a kill, a takeover and a correction."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from caesura_protocol.codec import encode
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
    ReplacePart,
    TakeBack,
    Undo,
)
from caesura_service.cooperative_scheduler import Slices
from caesura_service.journal import JournalSettings, PeerJournals, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.program_edits import EditLog
from caesura_service.publishing import edited_programs
from caesura_service.publishing.events import TakeoverFailed
from caesura_service.publishing.session_state import program_of
from harness.journals import journal_file
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


def acknowledged(reply: Ack | ProtocolError) -> Any:
    assert isinstance(reply, Ack)
    return reply


def ask(registry: Registry, command: Edit | EditProgram) -> Ack | ProtocolError:
    return answer(registry.handle_command(STATION, command, OPENED + 60.0))


def correct(registry: Registry, action: Action, revision: int) -> None:
    """Correct a closed session, which is rebuilt first."""
    command = Edit(session=NAME, revision=revision, author="Bo", action=action)
    while isinstance(answered := ask(registry, command), ProtocolError):
        assert answered.code == "overloaded", "a closed session is rebuilt first"
        registry.rebuild_step(STATION)


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
        undone, redone, _ = (acknowledged(edit(registry, one)) for one in (Undo(), Redo(), Undo()))
        assert undone.program_edit == redone.program_edit, "what was undone, and done again"
        assert (undone.program_edit.number, undone.program_edit.action) == (3, DeleteApp(app=FIRST))
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


@pytest.mark.parametrize("is_closed", [False, True])
@pytest.mark.parametrize(
    ("kind", "actions"),
    [
        (EditProgram, [DuplicateApp(app=FIRST)]),
        (EditProgram, [RENAMED, RENAMED, Undo()]),
        (EditProgram, [RENAMED, DuplicateApp(app=FIRST), Undo(), Undo(), Redo()]),
        (Edit, [Insert(t=1.235)]),
        (Edit, [Insert(t=0.8), Insert(t=1.235), Undo()]),
        (Edit, [Insert(t=0.8), Insert(t=1.235), Undo(), Undo(), Redo()]),
        (Edit, [Insert(t=0.8), Insert(t=1.235), TakeBack(number=1)]),
    ],
)
def test_an_edit_whose_answer_was_lost_is_acknowledged_again_and_made_once(
    tmp_path: Path, kind: type[Edit] | type[EditProgram], actions: list[Any], is_closed: bool
):
    """A client asks again after a kill; it once read that another operator had been first.

    Then it read neither what the edit had changed nor what an undo had undone.
    """
    stated = {"with_effect": True} if kind is Edit else {}
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=is_closed)
        for revision, action in enumerate(actions):
            command = kind(session=NAME, revision=revision, author="Ann", action=action, **stated)
            while isinstance(answered := ask(registry, command), ProtocolError):
                assert answered.code == "overloaded"
                registry.rebuild_step(STATION)
        before = program(registry)
        assert ask(registry, command) == answered
        assert program(registry) == before
    with registry_on(tmp_path / "a.sqlite") as registry:
        again = ask(registry, command)
        assert again == answered
        assert (program(registry).apps, program(registry).version) == (before.apps, before.version)
        other = command.model_copy(update={"author": "Bo"})
        refused = ask(registry, other)
        assert isinstance(refused, ProtocolError)
        assert "another operator" in refused.message
        later = other.model_copy(update={"revision": command.revision + 1, "action": actions[0]})
        while isinstance(made := ask(registry, later), ProtocolError):
            assert made.code == "overloaded"
            registry.rebuild_step(STATION)
        afterwards = ask(registry, command)
        assert afterwards.revision == answered.revision, "its own, so that its author finds the other's edit"
        assert afterwards == answered


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
        correct(registry, Insert(t=0.8), 0)
        short = program(registry).apps[1]
        there = AppReference(kind=short.kind, t0=0.8, tn=short.tn)
        assert isinstance(edit(registry, ChangeApp(app=there, name="last bit")), Ack)
        correct(registry, Undo(), 1)
        (listed,) = program(registry).edits
        assert (listed.state, "no longer in the program" in str(listed.reason)) == ("not_applied", True)
        assert any("Edit 1 by Ann" in note for note in program(registry).notes)
        correct(registry, Redo(), 2)
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
        wide = edit(registry, ChangeApp(app=FIRST, tolerance_m=5.0))  # typed in mm
        assert isinstance(wide, ProtocolError)
        assert "tolerance_m is 5, expected a number above 0 and at most 1" in wide.message
        assert program(registry).edit_revision == 1


def test_an_outcome_that_lacks_the_last_edit_is_not_believed(tmp_path: Path):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        taught(registry, closed=True)
    with journal_file(path) as database:
        stale = database.execute("SELECT opening, last_seq, snapshot, crc FROM outcomes").fetchone()
    with registry_on(path) as registry:
        assert isinstance(edit(registry, RENAMED), Ack)
    with journal_file(path) as database:  # as when the process is killed before the outcome is stored anew
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
                b.rebuild_step(STATION)
            assert names(b)[:2] == ["reach", None]


def test_edits_are_applied_once_a_version_and_not_at_every_question(tmp_path: Path, monkeypatch):
    applied: list[int] = []
    with_edits = edited_programs.with_edits

    def counted(program: Program, log: EditLog, *more: Any) -> Program:
        applied.append(log.revision)
        return with_edits(program, log, *more)

    monkeypatch.setattr(edited_programs, "with_edits", counted)
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
        stored = StoredSessions(journal, lambda: newer, lambda _station: True)
        (found,) = stored.page(lambda _: True, StoredPage())
        (first,) = stored.page(lambda _: True, StoredPage(edits=0))
        (second,) = stored.page(lambda _: True, StoredPage(edits=1))
    assert (found.program.apps, found.program.edits) == (tuple(before.apps), before.edits)
    assert (first.program.edits, first.program.edit_revision) == ((), 0)
    assert first.program.apps != found.program.apps == second.program.apps


def test_the_edits_of_a_session_that_is_no_longer_held_give_way_to_other_stations(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=True)
        assert isinstance(edit(registry, RENAMED), Ack)
        before = program(registry)
    newer: Any = SimpleNamespace(sessions={})
    slices, found = Slices(slice_s=0.0), list[Program | None]()
    with SqliteJournal(tmp_path / "a.sqlite", JournalSettings()) as journal:
        stored = StoredSessions(journal, lambda: newer, lambda _station: True)
        assert not slices.begin("a", lambda: found.append(stored.program(STATION, NAME))), "in one piece"
        slices.finish("a")
    assert found[0] is not None
    assert (found[0].apps, found[0].edits) == (tuple(before.apps), before.edits)


# --- a part that was taught again -------------------------------------------------------------------------

AGAIN = "s2"
PART = ReplacePart(first=FIRST, last=FIRST, session=AGAIN)


def teach_again(registry: Registry, *, close: bool = True, count: int = 10, **stated: Any) -> None:
    commands = [opening(AGAIN, **stated), *([closing(count - 1, AGAIN)] if close else [])]
    assert isinstance(answer(registry.handle_command(STATION, commands[0], OPENED + 20.0)), Ack)
    for one in batches(count, AGAIN):
        registry.handle_samples(STATION, one, OPENED + 20.0)
    for command in commands[1:]:
        assert isinstance(answer(registry.handle_command(STATION, command, OPENED + 30.0)), Ack)


def edited_program(registry: Registry) -> Program:
    (state,) = [one for one in registry.index.all_states() if one.session == NAME]
    return program_of(state)


def replace(registry: Registry, part: ReplacePart = PART) -> Ack | ProtocolError:
    revision = edited_program(registry).edit_revision
    command = EditProgram(session=NAME, revision=revision, author="Ann", action=part)
    return ask(registry, command)


def bare(program: Program) -> Program:
    """Without what a new owner changes."""
    return program.model_copy(update={"instance": "", "epoch": 0, "apps": tuple(program.apps)})


@pytest.mark.parametrize("is_closed", [False, True])
def test_a_part_taught_again_survives_a_restart_and_the_deletion_of_its_session(
    tmp_path: Path, is_closed: bool
):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        taught(registry, closed=is_closed)
        before = tuple(edited_program(registry).apps)
        teach_again(registry)
        assert isinstance(replace(registry), Ack)
        shown = edited_program(registry)
        new = [one for one in shown.apps if one.added == 1]
        assert len(new) >= 2
        assert [one for one in shown.apps if one.added is None] == list(before[1:])
    with SqliteJournal(path, JournalSettings()) as journal:
        journal.delete(STATION, AGAIN)
    with registry_on(path) as registry:
        assert bare(edited_program(registry)) == bare(shown)
        undo = EditProgram(session=NAME, revision=1, author="Bo", action=Undo())
        assert isinstance(ask(registry, undo), Ack)
        assert tuple(edited_program(registry).apps) == before
        redo = EditProgram(session=NAME, revision=2, author="Bo", action=Redo())
        assert isinstance(ask(registry, redo), Ack)
        assert tuple(edited_program(registry).apps) == tuple(shown.apps)


def test_a_part_whose_answer_was_lost_is_acknowledged_though_its_session_was_deleted_meanwhile(
    tmp_path: Path,
):
    path = tmp_path / "a.sqlite"
    command = EditProgram(session=NAME, revision=0, author="Ann", action=PART)
    with registry_on(path) as registry:
        taught(registry)
        teach_again(registry)
        answered = ask(registry, command)
    with SqliteJournal(path, JournalSettings()) as journal:
        journal.delete(STATION, AGAIN)
    with registry_on(path) as registry:
        assert ask(registry, command) == answered
        assert edited_program(registry).edit_revision == 1


def test_a_closed_session_is_rebuilt_from_its_records_with_the_part_bit_for_bit(tmp_path: Path):
    path = tmp_path / "a.sqlite"
    with registry_on(path) as registry:
        taught(registry, closed=True)
        teach_again(registry)
        assert isinstance(replace(registry), Ack)
        shown = edited_program(registry)
    with journal_file(path) as database:
        database.execute("DELETE FROM outcomes")
    with registry_on(path) as registry:
        assert encode(bare(edited_program(registry))) == encode(bare(shown))


def test_another_instance_takes_the_part_over(tmp_path: Path):
    first, second = tmp_path / "a.sqlite", tmp_path / "b.sqlite"
    with registry_on(first) as a:
        taught(a)
        with registry_on(second, peers=PeerJournals(second)) as b:
            assert not list(edited_program(b).edits)
            teach_again(a)
            assert isinstance(replace(a), Ack)
            assert list(b.take_over(STATION, OPENED + 90.0))
            assert edited_program(b).apps == edited_program(a).apps


def test_a_session_that_is_no_longer_held_can_take_the_place_of_a_part(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        teach_again(registry)
        taught(registry)
        registry._held.remove(STATION, AGAIN)
        assert isinstance(replace(registry), Ack)


@pytest.mark.parametrize(
    ("stated", "close", "reason"),
    [
        ({}, False, "session s2 is still open: stop it first"),
        ({"wrench_source": "none"}, True, "session s2 has another wrench source than the program"),
        ({"count": 0}, True, "session s2 has no apps"),
    ],
)
def test_a_session_that_cannot_take_the_place_is_refused_with_the_reason(
    tmp_path: Path, stated: dict[str, Any], close: bool, reason: str
):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        teach_again(registry, close=close, **stated)
        refused = replace(registry)
        assert isinstance(refused, ProtocolError)
        assert (refused.code, refused.message) == ("conflict", reason)
        assert edited_program(registry).edit_revision == 0


def test_a_part_or_a_session_that_is_not_there_is_refused(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry)
        unknown = replace(registry)
        assert isinstance(unknown, ProtocolError)
        assert (unknown.code, unknown.value) == ("unknown_session", AGAIN)
        itself = replace(registry, PART.model_copy(update={"session": NAME}))
        assert isinstance(itself, ProtocolError)
        assert "replaces no part of itself" in itself.message
        teach_again(registry)
        nowhere = AppReference(kind="grasp", t0=100.0, tn=101.0)
        gone = replace(registry, PART.model_copy(update={"last": nowhere}))
        assert isinstance(gone, ProtocolError)
        assert "at 100.00 to 101.00 s is no longer in the program" in gone.message


def test_a_part_that_a_correction_takes_away_is_listed_and_is_back_with_it(tmp_path: Path):
    with registry_on(tmp_path / "a.sqlite") as registry:
        taught(registry, closed=True)
        teach_again(registry)
        correct(registry, Insert(t=0.8), 0)
        short = edited_program(registry).apps[1]
        there = AppReference(kind=short.kind, t0=short.t0, tn=short.tn)
        assert isinstance(replace(registry, ReplacePart(first=there, last=there, session=AGAIN)), Ack)
        replaced = tuple(edited_program(registry).apps)
        correct(registry, Undo(), 1)
        without = edited_program(registry)
        (listed,) = without.edits
        assert (listed.state, "no longer in the program" in str(listed.reason)) == ("not_applied", True)
        assert any("(replace_part) is not applied" in note for note in without.notes)
        assert all(one.added is None for one in without.apps)
        correct(registry, Redo(), 2)
        assert tuple(edited_program(registry).apps) == replaced

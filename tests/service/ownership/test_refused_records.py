"""An instance is frozen between its look at the epochs and the record of a change, which is then refused.

Its successor has acknowledged another change meanwhile. The refused record lies in a journal and counts for
nothing, whatever is killed and whichever instance takes the station over next.
"""

from __future__ import annotations

import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Close,
    Command,
    Describe,
    Description,
    Edit,
    EditProgram,
    Insert,
    NameProgram,
)
from caesura_service.journal import JournalError, PeerJournals, Record, Recordable
from caesura_service.journal.sqlite_statements import TAKEOVERS
from caesura_service.publishing.events import SessionDeleted
from caesura_service.publishing.session_state import program_of
from harness.sessions import NAME, STATION, answer, opening
from service.ownership.test_takeover import BATCHES, COUNT, EXPECTED, RestartableRegistry, reported
from service.sessions.edits import compared, edit, stepped


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[RestartableRegistry, RestartableRegistry]]:
    with ExitStack() as stack:
        yield RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)


def asked(instance: RestartableRegistry, command: Command) -> Ack | ProtocolError:
    return answer(instance.registry.handle_command(STATION, command, 9.0))


def frozen(instance: RestartableRegistry, command: Command, meanwhile: Callable[[], None]) -> None:
    """The instance is frozen just before it records the command, which is refused after that."""
    assert isinstance(refused := froze(instance, command, meanwhile), ProtocolError)
    assert refused.code == "overloaded"


def froze(
    instance: RestartableRegistry, command: Command, meanwhile: Callable[[], None]
) -> Ack | ProtocolError:
    """Return the answer of an instance that is frozen just before it records the command."""
    append = instance.journal.append

    def appending(record: Record, *, now: bool = False) -> None:
        patched.undo()
        meanwhile()
        append(record, now=now)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(instance.journal, "append", appending)
        return asked(instance, command)


def succeeding(instance: RestartableRegistry, *commands: Command) -> Callable[[], None]:
    """The instance takes the station over, and acknowledges these."""

    def succeed() -> None:
        instance.take()
        for command in commands:
            assert isinstance(asked(instance, command), Ack)

    return succeed


def full(*_: object) -> None:
    raise JournalError("the disk is full")


def named(revision: int, name: str) -> EditProgram:
    action = NameProgram(name=name)
    return EditProgram(session=NAME, revision=revision, author="Ann", action=action)


def described(before: Description, after: Description) -> Describe:
    return Describe(session=NAME, author="Ann", before=before, description=after)


def tasked(task: str) -> Describe:
    return described(Description(), Description(task=task))


def recorded(instance: RestartableRegistry) -> tuple[Recordable, ...]:
    return instance.journal.changes(STATION, NAME)


def begun(instance: RestartableRegistry, batches: int = 9) -> None:
    instance.open()
    instance.feed(*range(batches))
    instance.journal.commit()


LATE, KEPT = edit(0, Insert(t=0.155)), edit(0, Insert(t=0.525))
CHANGES = {
    "edit": (LATE, KEPT),
    "program edit": (named(0, "late"), named(0, "kept")),
    "description": (tasked("late"), tasked("kept")),
    "description, program edit": (tasked("late"), named(0, "kept")),
}


def shown(instance: RestartableRegistry) -> tuple[object, ...]:
    state = instance.standing
    return compared(state)[1:], state.description


@pytest.mark.parametrize("is_killed", [False, True], ids=["goes on", "is killed"])
@pytest.mark.parametrize(("late", "kept"), CHANGES.values(), ids=CHANGES)
def test_a_refused_change_takes_no_acknowledged_one_away(pair, late, kept, is_killed):
    """Copies were compared by their length alone: the refused change counted, at the next takeover."""
    a, b = pair
    begun(a)
    frozen(a, late, succeeding(b, kept))
    expected = shown(b)
    b.take(renew=False)
    assert shown(b) == expected
    if is_killed:
        a.kill()
    a.take()
    assert shown(a) == expected
    b.kill()
    b.path.unlink()
    a.kill()
    a.take()
    assert shown(a) == expected


@pytest.mark.parametrize(("late", "kept"), CHANGES.values(), ids=CHANGES)
def test_a_refused_change_of_a_closed_session_takes_no_acknowledged_one_away(pair, late, kept):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()

    def acknowledge() -> None:
        b.take()
        while isinstance(answered := asked(b, kept), ProtocolError):
            assert answered.code == "overloaded"
            stepped(b.registry)

    frozen(a, late, acknowledge)
    a.journal.flush()  # the results with the refused change
    expected = shown(b)
    a.take()
    assert shown(a) == expected
    a.kill()
    a.take()
    assert shown(a) == expected


def test_a_third_instance_takes_over_what_was_acknowledged_and_not_what_was_refused(pair, tmp_path):
    a, b = pair
    begun(a)
    frozen(a, LATE, succeeding(b, KEPT))
    with ExitStack() as stack:
        c = RestartableRegistry(tmp_path, "c", stack)
        c.take()
        assert shown(c) == shown(b)
        assert asked(c, edit(1, Insert(t=1.155))).revision == 2
        a.take()
        assert shown(a) == shown(c)


def test_a_takeover_that_is_given_up_or_killed_leaves_the_acknowledged_change_to_the_next_one(pair):
    a, b = pair
    begun(a)
    frozen(a, LATE, succeeding(b, KEPT))
    expected = shown(b)
    taking = a.registry.take_over(STATION, 0.0)
    next(taking)
    taking.close()
    a.take()
    assert shown(a) == expected
    b.take()
    frozen(b, edit(1, Insert(t=0.155)), succeeding(a, edit(1, Insert(t=1.155))))
    expected = shown(a)
    next(b.registry.take_over(STATION, 0.0))
    b.kill()
    b.take()
    assert shown(b) == expected


def test_what_was_refused_is_kept_aside_in_the_journal(pair, caplog):
    a, b = pair
    begun(a)
    frozen(a, LATE, succeeding(b, KEPT))
    a.take()
    assert f"{STATION}/{NAME} has records that conflict" in caplog.text
    with closing(sqlite3.connect(a.path)) as database:
        (aside,) = database.execute("SELECT session FROM sessions WHERE damage IS NOT NULL").fetchall()
    assert ".refused-" in aside[0]
    assert [one.action for one in a.journal.changes(STATION, aside[0])] == [LATE.action]
    assert a.journal.sessions() == ((STATION, NAME),)
    a.kill()
    assert len([*a.journal.replay(STATION, NAME)]) == 1 + 9 + 1


def test_a_session_that_another_process_deletes_meanwhile_has_nothing_to_set_aside(pair, monkeypatch):
    """The takeover failed with a TypeError, and the station was not taken over again."""
    a, b = pair
    begun(a)
    frozen(a, LATE, succeeding(b, KEPT))
    retract = a.journal.retract

    def deleted(*refused: Any) -> None:
        a.journal.delete(STATION, NAME)
        retract(*refused)

    monkeypatch.setattr(a.journal, "retract", deleted)
    a.take()
    assert shown(a) == shown(b)


def test_a_look_for_deleted_sessions_compares_no_changes(pair):
    """It read every change of a station twice, every half a minute, in the thread of all results."""
    a, b = pair
    for command in (opening("s0"), Close(session="s0", last_seq=-1)):
        assert isinstance(asked(a, command), Ack)
    begun(a)
    assert isinstance(asked(a, KEPT), Ack)
    a.journal.flush()
    b.take()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(b.journal, "changes", None)
        assert b.registry.tick(1e6) == []
    a.journal.delete(STATION, "s0")
    assert b.registry.tick(1e6 + 100.0) == [SessionDeleted(STATION, "s0", "deleted by another process")]


def test_a_refused_close_ends_no_session_that_its_successor_goes_on_with(pair):
    """The successor looked again, closed its session, and deleted the batches behind that close."""
    a, b = pair
    begun(a, 5)

    def go_on() -> None:
        b.take()
        b.registry.handle_samples(STATION, BATCHES[5], 10.0)
        b.journal.commit()

    frozen(a, Close(session=NAME, last_seq=4), go_on)
    a.journal.flush()
    b.take(renew=False)
    assert (b.standing.lifecycle, b.next_seq) == ("open", 6)
    b.registry.release(STATION)
    a.take()
    assert (a.standing.lifecycle, a.next_seq) == ("open", 6)
    a.feed(*range(6, COUNT))
    a.close()
    assert reported(a.standing) == EXPECTED
    a.kill()
    a.take()
    assert reported(a.standing) == EXPECTED


def test_a_refused_close_hides_no_change_that_its_successor_has_acknowledged(pair):
    a, b = pair
    begun(a)
    frozen(a, Close(session=NAME, last_seq=8), succeeding(b, KEPT))
    a.journal.flush()
    a.take()
    assert a.standing.revision == 1
    assert recorded(a) == recorded(b)


def test_a_takeover_that_is_not_on_disk_yet_is_there_before_the_next_change(pair):
    """Otherwise the journal of a change counted no more than those before the takeover."""
    a, b = pair
    begun(a)

    def acknowledge() -> None:
        with pytest.MonkeyPatch.context() as disk:
            disk.setattr(b.journal, "store_takeover", full)
            b.take()
            assert isinstance(asked(b, KEPT), ProtocolError)
        assert isinstance(asked(b, KEPT), Ack)

    frozen(a, LATE, acknowledge)
    a.take()
    assert shown(a) == shown(b)


def test_a_journal_of_an_older_caesura_counts_by_its_last_epoch(pair):
    """It has no table of takeovers: it is read as it is, and gets the table when its instance starts."""
    a, b = pair
    begun(a)
    frozen(a, LATE, succeeding(b, KEPT))
    expected = shown(b)
    b.journal.__exit__(None, None, None)
    with closing(sqlite3.connect(b.path)) as database:
        database.execute(f"DROP TABLE {TAKEOVERS}")
    (found,) = PeerJournals(a.path).copies(STATION)
    b.start()
    (copy,) = b.journal.copies(STATION)
    assert found.copy.owner_epoch == copy.owner_epoch == b.journal.epoch_of(STATION)
    a.take()
    assert shown(a) == expected


# What may happen: a batch; a change; a change or a close in whose record the owner is frozen, while another
# instance takes over and acknowledges a second change; a close; the station changes hands or owners die; an
# instance takes over without its epoch on disk, and the owner goes on.
kinds = st.sampled_from(["edit", "name", "describe"])
numbers = st.integers(0, 1)  # of an instance
events = st.lists(
    st.one_of(
        st.integers(0, COUNT - 1),
        kinds,
        st.sampled_from(["look", "close"]),
        st.tuples(st.sampled_from(["hand", "kill"]), numbers),
        st.tuples(st.one_of(kinds, st.just("close")), kinds, st.sampled_from(["", "kill", "hand"]), numbers),
        st.tuples(st.sampled_from(["store_epoch", "store_takeover"]), kinds, kinds, numbers, st.just("full")),
    ),
    max_size=15,
)


class ContestedStation:
    """An owner and two other instances, with what was acknowledged of each kind."""

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        self.owner, *self.others = (RestartableRegistry(directory, name, stack) for name in "abc")
        self.owner.open()
        self.inserted: list[float] = []  # [s]
        self.namers: list[str] = []
        self.tags: list[str] = []
        self._count = 0

    def command(self, instance: RestartableRegistry, kind: str) -> Command:
        """Return the next change, which no other one equals."""
        self._count += 1
        state, author = instance.standing, f"author-{self._count}"
        match kind:
            case "edit":
                return edit(state.revision, Insert(t=round(0.1 + self._count / 100 + 0.005, 3)))
            case "name":
                revision, action = state.program_edits.revision, NameProgram(name=author)
                return EditProgram(session=NAME, revision=revision, author=author, action=action)
            case "describe":
                after = {"tags": (*state.description.tags, author)}
                return described(state.description, state.description.model_copy(update=after))
        return Close(session=NAME, last_seq=instance.next_seq - 1)

    def change(self, instance: RestartableRegistry, kind: str) -> None:
        """Make a change; its session is rebuilt first where that is needed."""
        command = self.command(instance, kind)
        answered = asked(instance, command)
        if isinstance(answered, ProtocolError) and instance.registry.rebuilding:
            stepped(instance.registry)
            answered = asked(instance, command)
        if not isinstance(answered, Ack):
            return
        match command:
            case Edit(action=Insert(t=t)):
                self.inserted.append(t)
            case EditProgram(author=author):
                self.namers.append(author)
            case Describe(description=description):
                self.tags.append(description.tags[-1])

    def freeze(self, late: str, kept: str, number: int) -> RestartableRegistry:
        """Freeze the owner in its record; return the successor, which acknowledges a change meanwhile."""
        successor = self.others[number]

        def succeed() -> None:
            successor.take()
            self.change(successor, kept)

        self.owner.journal.commit()
        answered = froze(self.owner, self.command(self.owner, late), succeed)
        assert isinstance(answered, ProtocolError) or late == "close"
        return successor

    def replace_late(self, unstored: str, last: str, first: str, number: int) -> None:
        """Take over from an owner that goes on, as the disk is full for what states the takeover."""
        successor = self.others[number]
        self.owner.journal.commit()
        with pytest.MonkeyPatch.context() as disk, suppress(JournalError):
            disk.setattr(successor.journal, unstored, full)
            successor.take()
        self.change(self.owner, last)
        if not successor.registry.ownership.in_takeover(STATION) and successor.registry.index.sessions:
            self.change(successor, first)
        self.pass_to(number)
        self.owner.take()

    def pass_to(self, number: int) -> None:
        """Another instance is the owner from now on."""
        self.owner, self.others[number] = self.others[number], self.owner

    def step(self, step: Any) -> None:
        match step:
            case int():
                self.owner.feed(step)
            case "look":
                self.owner.take(renew=False)
            case str():
                self.change(self.owner, step)
            case how, number:
                self.owner.registry.release(STATION) if how == "hand" else self.owner.kill()
                self.pass_to(number)
                self.owner.take()
            case unstored, last, first, number, "full":
                self.replace_late(unstored, last, first, number)
            case late, kept, how, number:
                self.freeze(late, kept, number)
                if how == "kill":
                    self.owner.kill()
                elif how == "hand":
                    self.pass_to(number)
                self.owner.take(renew=how != "hand")

    def assert_kept(self) -> None:
        """The owner shows what was acknowledged, in turn; what was refused may be there too."""
        state = self.owner.standing
        assert {*self.inserted} <= {one.t for one in state.view.changepoints}
        namers = iter([one.author for one in program_of(state).edits])
        assert all(name in namers for name in self.namers)
        tags = iter(state.description.tags)
        assert all(tag in tags for tag in self.tags)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(events)
def test_whatever_is_frozen_in_its_record_no_acknowledged_change_is_lost(steps):
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        station = ContestedStation(Path(directory), stack)
        for step in steps:
            station.step(step)
            station.assert_kept()

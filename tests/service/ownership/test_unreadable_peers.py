"""The journal of another instance cannot be read for a moment: what it has does not count as absent."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from caesura_protocol.messages import Ack, Insert
from caesura_service.journal import PeerJournalError, peer_journals
from caesura_service.journal.peer_journals import BUSY_S, UNREADABLE_S
from caesura_service.publishing.events import SessionDeleted
from caesura_service.server.station_manager import StationManager
from harness.sessions import NAME, STATION
from service.ownership.test_edits_of_two_instances import corrected
from service.ownership.test_takeover import COUNT, RestartableRegistry
from service.sessions.edits import compared, refused, stepped


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[RestartableRegistry, RestartableRegistry]]:
    """b had the station, then a: it has a correction that b does not know. b starts again."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        b.open()
        b.feed(*range(5))
        b.registry.release(STATION)
        a.take()
        a.feed(*range(5, 9))
        assert isinstance(corrected(a, 0, Insert(t=0.5)), Ack)
        a.journal.commit()
        b.kill()
        yield a, b


@contextmanager
def refused_by_system(path: Path, after: int = 0) -> Iterator[None]:
    """After so many looks. A superuser may read every file, so the error is made here."""
    connect, left = sqlite3.connect, [after]

    def refusing(where: str, **options: Any) -> sqlite3.Connection:
        if path.name in where:
            left[0] -= 1
            if left[0] < 0:
                raise PermissionError(13, "Permission denied")
        return connect(where, **options)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(peer_journals.sqlite3, "connect", refusing)
        yield


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """By a copying program."""
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode = EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        yield


@contextmanager
def not_listed(looks: int) -> Iterator[None]:
    """The directory, as where too many files are open, at that look alone."""
    listed, left = os.listdir, [looks]

    def listing(directory: Path) -> list[str]:
        left[0] -= 1
        if left[0] == -1:
            raise OSError(24, "Too many open files")
        return listed(directory)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(peer_journals.os, "listdir", listing)
        yield


def started(instance: RestartableRegistry) -> None:
    """It is served again as soon as everything can be read."""
    now = [0.0]
    manager = StationManager(instance.registry, instance.name, lambda _: None, lambda: now[0])
    while instance.registry.ownership.in_takeover(STATION):
        now[0] += manager.idle_s()
        manager.step()


@pytest.mark.parametrize("looks", range(4))
def test_a_correction_that_cannot_be_read_is_not_replaced_by_the_next_one(pair, looks):
    """The station was served without it, and the next correction was acknowledged in its place."""
    a, b = pair
    with refused_by_system(a.path, after=looks):
        assert b.registry.restore(0.0, {STATION}) == []
        late = refused(corrected(b, 0, Insert(t=0.155)))
        assert (late.code, "let this user read" in late.message) == ("overloaded", True)
    started(b)
    assert compared(b.standing) == compared(a.standing)
    assert (b.standing.revision, b.next_seq) == (1, 9)


def test_a_journal_that_another_program_has_locked_is_waited_for(pair):
    a, b = pair
    a.journal.__exit__(None, None, None)
    with locked(a.path):
        b.registry.restore(0.0, {STATION})
        assert refused(corrected(b, 0, Insert(t=0.155))).code == "overloaded"
    started(b)
    assert (b.standing.revision, b.next_seq) == (1, 9)


def test_a_journal_that_stays_locked_delays_one_look_alone(pair, monkeypatch):
    """Each look at the epochs waited half a second, and each command looks twice."""
    a, b = pair
    b.take()
    a.journal.__exit__(None, None, None)
    connect, waits = sqlite3.connect, []

    def connecting(where: str, *, timeout: float, **options: Any) -> sqlite3.Connection:
        waits.append(timeout)
        return connect(where, timeout=0.0, **options)

    with locked(a.path):
        monkeypatch.setattr(peer_journals.sqlite3, "connect", connecting)
        assert isinstance(corrected(b, 1), Ack)
        assert isinstance(corrected(b, 2, Insert(t=0.155)), Ack)
    assert waits == [BUSY_S, 0.0, 0.0, 0.0]
    assert isinstance(corrected(b, 3, Insert(t=1.155)), Ack)
    assert waits[4:] == [0.0, BUSY_S]


def test_an_owner_that_cannot_read_whether_it_was_replaced_accepts_nothing(pair):
    """It accepted a correction in the place of one that its successor had acknowledged."""
    a, b = pair
    b.take()
    a.take()
    assert isinstance(corrected(a, 1, Insert(t=0.155)), Ack)
    with refused_by_system(a.path):
        with pytest.raises(PeerJournalError):
            b.take()
        assert refused(corrected(b, 1, Insert(t=1.155))).code == "overloaded"
    b.take()
    assert compared(b.standing) == compared(a.standing)


def test_one_that_stays_unreadable_does_not_keep_a_station_from_being_served(pair, monkeypatch, caplog):
    a, b = pair
    now = [0.0]
    monkeypatch.setattr(b.registry._journals._peers, "_clock", lambda: now[0])
    with refused_by_system(a.path):
        b.registry.restore(0.0, {STATION})
        now[0] = UNREADABLE_S
        started(b)
        assert b.registry.ownership.serves(STATION)
        assert b.next_seq == 5
        b.registry.known_stations()
    assert caplog.text.count(f"{a.path} could not be read for 30 s and counts as absent from now on") == 1


def test_a_journal_counts_as_absent_only_while_one_looks_again_and_again(pair, monkeypatch):
    """Of two looks an hour apart that failed, the second one took over without its corrections."""
    a, b = pair
    now = [0.0]
    monkeypatch.setattr(b.registry._journals._peers, "_clock", lambda: now[0])
    with refused_by_system(a.path):
        b.registry.known_stations()
        now[0] = 3600.0
        with pytest.raises(PeerJournalError):
            b.take()
    b.take()
    assert compared(b.standing) == compared(a.standing)


def test_a_session_of_an_unreadable_journal_is_corrected_as_soon_as_it_can_be_read(tmp_path):
    """The answer to the operator was that it cannot be corrected."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.open()
        a.feed(*range(COUNT))
        a.close()
        a.registry.release(STATION)
        b.take()
        assert refused(corrected(b)).code == "overloaded"
        with refused_by_system(a.path):
            stepped(b.registry)
        passing = refused(corrected(b))
        assert (passing.code, "let this user read" in passing.message) == ("overloaded", True)
        assert refused(corrected(b)).code == "overloaded"
        stepped(b.registry)
        assert isinstance(corrected(b), Ack)


def test_a_name_is_not_given_to_a_second_session_while_the_first_cannot_be_read(tmp_path):
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.open()
        a.feed(*range(9))
        a.journal.commit()
        with refused_by_system(a.path):
            assert refused(b.open()).code == "overloaded"
        assert b.open() == Ack(session=NAME, next_seq=9, state="open", revision=0)


def test_a_session_that_cannot_be_read_has_not_been_deleted(tmp_path, monkeypatch):
    """It was no longer found, though its journal had it, until the instance started again."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.open()
        a.feed(*range(COUNT))
        a.close()
        a.registry.release(STATION)
        b.take()
        now = [0.0]
        monkeypatch.setattr(b.registry._journals._peers, "_clock", lambda: now[0])
        with refused_by_system(a.path):
            for now[0] in (0.0, UNREADABLE_S):
                assert b.registry.tick(1e6 + now[0] * 100) == []
        assert b.standing.lifecycle == "closed"
        a.path.unlink()
        (said,) = b.registry.tick(1e9)
        assert isinstance(said, SessionDeleted)


def test_an_owner_learns_of_its_successor_beside_a_journal_that_cannot_be_read(tmp_path):
    """It acknowledged a correction that its successor never had: a third journal could not be read."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "b", stack), RestartableRegistry(tmp_path, "c", stack)
        third = RestartableRegistry(tmp_path, "a", stack)
        a.open()
        a.feed(*range(9))
        a.journal.commit()
        b.take(10.0)
        with refused_by_system(third.path):
            a.registry.ownership.is_settling = True
            assert a.registry.ownership.may_be_behind({STATION}) == {STATION}
            late = refused(corrected(a, 0, Insert(t=0.5)))
        assert (late.code, "another instance has served" in late.message) == ("overloaded", True)


@pytest.mark.parametrize("looks", range(8))
def test_a_station_that_an_opening_could_not_take_over_is_taken_over_later(tmp_path, looks):
    """It was rejected from then on, as one that is just being taken over, and no instance took it over."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.registry.ownership.acquire(STATION, 0.0)
        b.registry.ownership.acquire(STATION, 10.0)
        b.open()
        b.feed(*range(9))
        b.journal.commit()
        with not_listed(looks):
            a.open()
        ownership = a.registry.ownership
        assert not ownership.in_takeover(STATION) or STATION in ownership.superseded

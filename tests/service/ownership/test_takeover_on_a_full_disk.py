"""The new owner of a station cannot record what the last one had: nothing acknowledged is given up."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Insert
from caesura_service.cooperative_scheduler import give_way
from caesura_service.journal import JournalError, JournalShareError, Record
from caesura_service.ownership.takeover import NotRecordedError
from caesura_service.publishing.events import Output, TakeoverFailed
from caesura_service.server.inbound_events import LivelinessChanged, RouterLinkChanged, Watching
from caesura_service.server.live_tokens import LiveTokens
from caesura_service.server.station_manager import TAKEOVER, StationManager
from harness.sessions import NAME, STATION
from service.ownership.test_edits_of_two_instances import corrected
from service.ownership.test_takeover import COUNT, EXPECTED, RestartableRegistry, reported
from service.sessions.edits import compared, refused

FULL = JournalError("the disk is full")


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[RestartableRegistry, RestartableRegistry]]:
    """b had the station, then a: it has a correction that b does not know when it is killed."""
    with ExitStack() as stack:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        b.open()
        b.feed(*range(5))
        b.registry.release(STATION)
        a.take()
        a.feed(*range(5, 9))
        assert isinstance(corrected(a, 0, Insert(t=0.5)), Ack)
        a.kill()
        yield a, b


@pytest.fixture
def disk(pair: tuple[RestartableRegistry, RestartableRegistry]) -> Iterator[pytest.MonkeyPatch]:
    """That of b, which is full until it is undone."""
    with pytest.MonkeyPatch.context() as patched:
        fail(patched, pair[1], FULL)
        yield patched


def fail(
    disk: pytest.MonkeyPatch, instance: RestartableRegistry, error: JournalError, after: int = 0
) -> None:
    """Let the journal refuse every record after so many."""
    append, left = instance.journal.append, [after]

    def failing(record: Record, *, now: bool = False) -> None:
        if not left[0]:
            raise error
        left[0] -= 1
        append(record, now=now)

    disk.setattr(instance.journal, "append", failing)


@pytest.mark.parametrize("after", range(5))
def test_a_correction_that_cannot_be_copied_is_not_replaced_by_the_next_one(pair, monkeypatch, after):
    """The station was served without it, and the next correction was acknowledged in its place."""
    a, b = pair
    with monkeypatch.context() as disk:
        fail(disk, b, FULL, after)
        with pytest.raises(NotRecordedError, match="the disk is full"):
            b.take()
        late = refused(corrected(b, 0, Insert(t=0.155)))
        assert (late.code, "the disk is full" in late.message) == ("overloaded", True)
        assert b.registry.ownership.in_takeover(STATION)
    assert refused(corrected(b, 0, Insert(t=0.155))).code == "overloaded"
    b.take()
    a.take()
    assert compared(b.standing) == compared(a.standing)
    assert (b.standing.revision, b.next_seq) == (1, 9)


def test_the_station_is_taken_over_as_soon_as_there_is_room(pair, disk):
    _, b = pair
    now = [0.0]
    manager = StationManager(b.registry, "b", lambda _: None, lambda: now[0])
    b.registry.restore(0.0, {STATION})
    assert b.registry.index.all_states() == ()
    for _ in range(3):
        assert manager.idle_s() == 0.0
        while manager.idle_s() == 0.0:
            assert manager.step() == []
        assert 0.0 < manager.idle_s() <= 1.0
        now[0] += manager.idle_s()
    disk.undo()
    while manager.idle_s() == 0.0:
        manager.step()
    assert (b.standing.revision, b.next_seq) == (1, 9)
    assert b.registry.ownership.serves(STATION)


def test_a_station_that_another_instance_gets_meanwhile_is_rejected_here_no_longer_for_the_disk(pair, disk):
    _, b = pair
    with pytest.raises(NotRecordedError):
        b.take()
    b.registry.release(STATION)
    assert b.registry.ownership.stations_in_takeover() == ()


def test_beyond_the_share_of_its_station_a_session_is_not_held_without_its_corrections(pair, disk):
    """Other sessions of the station are, which can be closed."""
    _, b = pair
    fail(disk, b, JournalShareError("the share is used up", 2, 1))
    assert [type(said.error) for said in b.take() if isinstance(said, TakeoverFailed)] == [JournalShareError]
    assert b.registry.ownership.serves(STATION)
    assert refused(corrected(b, 0, Insert(t=0.155))).code == "unknown_session"
    opened = b.open()
    assert isinstance(opened, ProtocolError)
    assert opened.code == "overloaded"
    disk.undo()
    assert b.open() == Ack(session=NAME, next_seq=9, state="open", revision=1)


def test_what_is_copied_late_ends_like_an_undisturbed_session(tmp_path):
    with ExitStack() as stack, pytest.MonkeyPatch.context() as disk:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.open()
        a.feed(*range(9))
        a.registry.release(STATION)
        fail(disk, b, FULL, after=4)
        with pytest.raises(NotRecordedError):
            b.take()
        disk.undo()
        b.take()
        b.feed(*range(9, COUNT))
        b.close()
        assert reported(b.standing) == EXPECTED


@pytest.mark.parametrize("revision", [0, 1], ids=["frozen", "goes on"])
def test_an_owner_whose_epoch_could_not_be_stored_records_no_correction_without_it(tmp_path, revision):
    """The last owner did not learn that it had been replaced: both acknowledged a correction.

    The one of an owner that went on was set aside as refused.
    """
    with ExitStack() as stack, pytest.MonkeyPatch.context() as disk:
        a, b = RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)
        a.open()
        a.feed(*range(9))
        a.registry.release(STATION)
        b.take()
        b.registry.release(STATION)
        a.take()

        def full(*_: object) -> None:
            raise FULL

        disk.setattr(b.journal, "store_epoch", full)
        b.take()
        assert refused(corrected(b, 0, Insert(t=0.5))).code == "overloaded"
        for before in range(revision):
            assert isinstance(corrected(a, before, Insert(t=1.155)), Ack)
        disk.undo()
        assert refused(corrected(b, 0, Insert(t=0.5))).code == "overloaded"
        b.take()
        assert b.standing.revision == revision
        assert isinstance(corrected(b, revision, Insert(t=0.5)), Ack)
        assert refused(corrected(a, revision, Insert(t=0.155))).code == "overloaded"
        a.take()
        assert a.standing.revision == revision + 1
        assert compared(a.standing) == compared(b.standing)


def test_a_station_that_is_let_go_of_in_the_middle_of_a_record_is_not_taken_over_again(pair, monkeypatch):
    """What was left of the record failed, and the takeover was tried again beside the new owner's."""
    _, b = pair
    now, begun, outputs = [0.0], list[str](), list[Output]()
    manager = StationManager(b.registry, "b", lambda _: None, lambda: now[0])
    manager.start(LiveTokens(frozenset(), frozenset({STATION})))

    def failing(station: str, *_: object, **__: object) -> Iterator[list[Output]]:
        begun.append(station)
        give_way()
        raise NotRecordedError("the disk is full")
        yield []

    monkeypatch.setattr(b.registry, "take_over", failing)
    manager.handle_event(Watching())
    manager.handle_event(RouterLinkChanged(True))
    manager._takeovers.slices.slice_s = 0.0
    b.registry.slices.begin(TAKEOVER, lambda: outputs.extend(manager.step()))
    assert manager._takeovers.slices.is_under_way(STATION)
    manager.handle_event(LivelinessChanged("service", "a", True))
    while (idle_s := manager.idle_s()) < 60.0:
        now[0] += idle_s
        manager.step()
    assert begun == [STATION]

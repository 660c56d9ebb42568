"""Two instances on one directory: stations change hands in every state, and nothing differs in the end."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, SessionStatus
from caesura_service.journal import JournalError, PeerJournals, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.ownership.takeover import NotRecordedError
from caesura_service.publishing.events import (
    Output,
    Owner,
    ReplayEnded,
    Reply,
    SessionDeleted,
    StationTakenOver,
    TakeoverFailed,
)
from caesura_service.publishing.session_state import SessionState, snapshot_of
from caesura_service.sessions.limits import Limits
from harness.fake_pipeline import make_fake_pipeline
from harness.sessions import (
    NAME,
    STATION,
    Ring,
    answer,
    asked,
    batch,
    batches,
    closing,
    heartbeat,
    new_registry,
    opening,
    published,
    unowned,
)
from service.journal.journal_files import NEVER

COUNT = 16
BATCHES = batches(COUNT)


class RestartableRegistry:
    """A registry on a journal that others can read, and that can be killed and started again."""

    def __init__(self, directory: Path, name: str, stack: ExitStack, **limits: int) -> None:
        self.name, self.path, self.limits = name, directory / f"{name}.sqlite", Limits(**limits)
        self.start()
        stack.callback(lambda: self.journal.__exit__(None, None, None))

    def start(self) -> None:
        self.journal = SqliteJournal(self.path, NEVER).__enter__()
        self.registry = Registry(
            owner=Owner(self.name, 1),
            pipeline_factory=make_fake_pipeline,
            default_preset="fake",
            journal=self.journal,
            limits=self.limits,
            peers=PeerJournals(self.path),
        )

    def kill(self) -> None:
        self.journal._waiting.clear()  # which is all that a process takes with it
        self.journal._waiting_bytes = 0
        self.journal.__exit__(None, None, None)
        self.start()

    def take(self, now: float = 0.0, *, renew: bool = True) -> list[Output]:
        return [out for said in self.registry.take_over(STATION, now, renew=renew) for out in said]

    def feed(self, *numbers: int) -> None:
        for seq in numbers:
            self.registry.handle_samples(STATION, BATCHES[seq], 0.0)

    def open(self) -> Ack | ProtocolError:
        return answer(self.registry.handle_command(STATION, opening(), 0.0))

    def close(self) -> Ack | ProtocolError:
        ended = answer(self.registry.handle_command(STATION, closing(COUNT - 1), 0.0))
        self.journal.flush()  # as its thread does soon
        return ended

    @property
    def standing(self) -> SessionState:
        (standing,) = self.registry.index.all_states()
        return standing

    @property
    def next_seq(self) -> int:
        return self.registry.index.sessions[STATION][0].next_seq


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[RestartableRegistry, RestartableRegistry]]:
    with ExitStack() as stack:
        yield RestartableRegistry(tmp_path, "a", stack), RestartableRegistry(tmp_path, "b", stack)


def has_checked(instance: RestartableRegistry, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has seen that no other instance has acquired the station, just before one does."""
    journals = instance.registry._journals
    monkeypatch.setattr(journals, "readable_peer_epochs_of", lambda asked: dict.fromkeys(asked, -1))


def reported(standing: SessionState) -> tuple[object, ...]:
    snapshot = snapshot_of(unowned(standing))
    status = snapshot.status
    counted = (status.state, status.samples, status.repeats, status.gaps, status.batches)
    return snapshot.segments, snapshot.changepoints, snapshot.posterior, snapshot.program, counted


def undisturbed() -> tuple[object, ...]:
    registry = new_registry()
    registry.handle_command(STATION, opening(), 0.0)
    for each in BATCHES:
        registry.handle_samples(STATION, each, 0.0)
    registry.handle_command(STATION, closing(COUNT - 1), 0.0)
    return reported(registry.index.all_states()[0])


EXPECTED = undisturbed()


def test_what_the_owner_has_recorded_is_gone_on_with(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    assert a.registry.index.sessions == {}
    said = b.take()
    assert [out for out in said if isinstance(out, StationTakenOver)] == [StationTakenOver(STATION, 2, 1, 1)]
    assert [status.epoch for status in published(said, SessionStatus)] == [2]
    assert b.next_seq == 9
    assert b.open() == Ack(session=NAME, next_seq=9, state="open")
    b.feed(*range(9, COUNT))
    assert b.close() == Ack(session=NAME, next_seq=COUNT, state="closed")
    assert reported(b.standing) == EXPECTED


def test_what_it_had_not_written_when_it_was_killed_is_asked_of_the_bridge(pair):
    a, b = pair
    a.open()
    a.feed(*range(5))
    a.journal.commit()
    a.feed(*range(5, 9))
    a.kill()
    b.take()
    assert b.next_seq == 5
    session = b.registry.index.sessions[STATION][0]
    Ring(BATCHES).feed(session, heartbeat(COUNT - 1), 1.0)
    b.close()
    assert reported(b.standing) == EXPECTED


def test_it_is_kept_so_that_the_next_owner_need_not_know_the_one_before(pair, tmp_path):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    b.take()
    b.feed(*range(9, 12))
    b.registry.release(STATION)
    a.path.rename(tmp_path / "gone")
    with ExitStack() as stack:
        c = RestartableRegistry(tmp_path, "c", stack)
        c.take()
        c.feed(*range(12, COUNT))
        c.close()
        assert reported(c.standing) == EXPECTED


def test_a_session_that_ended_is_answered_for_without_being_replayed(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    b.registry._factory._pipeline_factory = lambda *_: pytest.fail("a closed session needs no mathematics")
    b.take()
    assert reported(b.standing) == EXPECTED
    assert b.standing.owner.instance == "b"
    assert b.close() == Ack(session=NAME, next_seq=COUNT, state="closed")
    assert b.journal.sessions() == ()


def test_a_session_that_ended_elsewhere_is_no_longer_open_at_its_first_owner(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    b.take()
    b.feed(*range(9, COUNT))
    b.close()
    b.registry.release(STATION)
    a.take()
    assert reported(a.standing) == EXPECTED
    assert a.journal.sessions() == ()


def test_a_close_that_the_owner_took_at_the_last_moment_is_found_when_one_looks_again(pair, monkeypatch):
    a, b = pair
    has_checked(a, monkeypatch)
    a.open()
    a.feed(*range(COUNT))
    a.journal.commit()
    b.take()
    assert b.take(renew=False) == []
    a.close()
    a.registry.release(STATION)
    said = b.take(renew=False)
    assert [status.state for status in published(said, SessionStatus)] == ["closed"]
    assert reported(b.standing) == EXPECTED


def test_an_owner_that_was_frozen_takes_up_what_was_taught_meanwhile(pair):
    a, b = pair
    a.open()
    a.feed(*range(5))
    a.journal.commit()
    b.take()
    b.feed(*range(5, 12))
    b.registry.release(STATION)
    said = a.take()
    assert a.next_seq == 12
    assert [status.epoch for status in published(said, SessionStatus)] == [3]
    a.feed(*range(12, COUNT))
    a.close()
    assert reported(a.standing) == EXPECTED


def test_an_owner_that_was_frozen_neither_closes_nor_gives_up_what_its_successor_goes_on_with(pair):
    a, b = pair
    a.open()
    a.feed(*range(5))
    b.take()
    b.feed(*range(5, 9))
    b.journal.commit()
    late = answer(a.registry.handle_command(STATION, closing(4), 0.0))
    again = answer(a.registry.handle_command(STATION, opening(epoch=1), 0.0))
    assert [(type(one), one.code) for one in (late, again)] == [(ProtocolError, "overloaded")] * 2
    a.registry.handle_samples(STATION, heartbeat(8), 0.0)
    evicted = ReplayEnded(NAME, 5, answered=False, evicted=True, oldest=9)
    a.registry.handle_samples(STATION, evicted, 0.0)
    assert a.standing.counters.lost == 0
    a.take()
    a.feed(*range(9, COUNT))
    assert a.close().state == "closed"
    assert reported(a.standing) == undisturbed()


def test_an_owner_behind_its_successor_has_the_bridge_of_a_new_session_come_again(pair):
    """Two instances that start open the same station: a bridge gives up at anything but `overloaded`."""
    a, b = pair
    a.open()
    b.take()
    refused = answer(a.registry.handle_command(STATION, opening().model_copy(update={"session": "s2"}), 0.0))
    assert (type(refused), refused.code) == (ProtocolError, "overloaded")
    assert "s2" not in a.registry.index.sessions.get(STATION, ())


def test_the_last_session_of_a_station_is_the_current_one_whatever_the_clocks_said(pair):
    """The clock of one instance had been an hour ahead: its closed session stayed the current one."""
    a, b = pair
    assert isinstance(answer(a.registry.handle_command(STATION, opening(), 3600.0)), Ack)
    a.feed(*range(5))
    a.registry.release(STATION)
    b.take(10.0)
    second = opening().model_copy(update={"session": "s2"})
    assert isinstance(answer(b.registry.handle_command(STATION, second, 10.0)), Ack)
    b.registry.release(STATION)
    a.take(3620.0)
    assert [one.name for one in a.registry.index.sessions[STATION]] == [NAME, "s2"]
    assert [one.session for one in a.registry.index.newest_states()] == ["s2"]


def test_epochs_rise_with_every_taking_whatever_the_clock_says(pair):
    a, b = pair
    a.open()
    epochs = []
    for instance, now in ((b, 100.0), (a, 50.0), (a, 200.0), (b, 0.0)):
        instance.take(now)
        epochs.append(instance.standing.owner.epoch)
    assert epochs == [100_000, 100_001, 200_000, 200_001]
    b.kill()
    b.take(10.0)
    assert b.standing.owner.epoch == 200_002
    assert snapshot_of(b.standing).program.epoch == 200_002


def test_while_a_station_is_taken_its_bridge_is_asked_to_come_again_and_others_are_served(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    taking = b.registry.take_over(STATION, 0.0)
    assert next(taking) == []
    refusal = b.open()
    assert isinstance(refusal, ProtocolError)
    assert refusal.code == "overloaded"
    b.feed(9)
    assert b.registry.counters.refused == {}
    assert answer(b.registry.handle_command("cell-2", opening(), 0.0)) == Ack(
        session=NAME, next_seq=0, state="open"
    )
    assert len([*taking]) > 5
    assert b.open() == Ack(session=NAME, next_seq=9, state="open")


def test_a_taking_that_is_given_up_leaves_the_station_as_it_was(pair):
    a, b = pair
    a.open()
    a.feed(*range(9))
    a.registry.release(STATION)
    taking = b.registry.take_over(STATION, 0.0)
    next(taking)
    taking.close()
    assert b.registry.index.sessions == {}
    b.take()
    assert b.next_seq == 9


def test_what_another_instance_serves_is_neither_taken_nor_refused_for_good():
    registry = new_registry()
    registry.ownership.served = frozenset({"cell-2"})
    (said,) = registry.handle_command(STATION, opening(), 0.0)
    assert isinstance(said, Reply)
    assert isinstance(said.reply, ProtocolError)
    assert (said.reply.code, registry.counters.refused) == ("overloaded", {})
    assert registry.handle_samples(STATION, batch(0), 0.0) == []
    assert isinstance(answer(registry.handle_command("cell-2", opening(), 0.0)), Ack)


def test_a_name_that_another_instance_has_used_is_taken(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    refusal = b.open()
    assert isinstance(refusal, ProtocolError)
    assert (refusal.code, refusal.value) == ("conflict", NAME)


def test_a_session_of_the_same_name_that_is_another_one_is_not_mixed_in(pair, monkeypatch):
    a, b = pair
    a.open()
    a.feed(0, 1)
    a.journal.commit()
    other = opening(columns=("t", "py"))
    with monkeypatch.context() as strangers:  # the two do not know each other
        strangers.setattr(b.registry._journals, "_peers", PeerJournals(None))
        b.registry.handle_command(STATION, other, 0.0)
    said = b.take()
    (failed,) = [out for out in said if isinstance(out, TakeoverFailed)]
    assert "open with another setting" in str(failed.error)
    assert b.next_seq == 0


def test_a_closed_session_beyond_those_that_can_be_asked_for_is_left_where_it_is(tmp_path):
    with ExitStack() as stack:
        a, b = (RestartableRegistry(tmp_path, name, stack, closed_sessions=2) for name in "ab")
        for number in range(4):
            a.registry.handle_command(STATION, opening(f"s{number}"), float(number))
            a.registry.handle_command(STATION, closing(-1, f"s{number}"), float(number))
        b.take()
        assert [session.name for session in b.registry.index.sessions[STATION]] == ["s2", "s3"]


def test_a_sibling_that_cannot_be_read_does_not_stop_anything(pair):
    a, b = pair
    b.open()
    b.feed(*range(5))
    a.path.write_text("a letter to my mother " * 100)
    assert not [out for out in b.take() if isinstance(out, TakeoverFailed)]
    assert b.next_seq == 5


def test_what_only_another_instance_has_cannot_be_asked_for_once_that_is_deleted(pair):
    a, b = pair
    a.open()
    a.feed(*range(COUNT))
    a.close()
    b.take()
    assert b.registry.tick(1e6) == []
    a.journal.delete(STATION, NAME)
    assert b.registry.tick(1e6 + 100.0) == [SessionDeleted(STATION, NAME, "deleted by another process")]
    assert b.registry.index.sessions == {}


def test_a_session_that_cannot_be_recorded_is_refused_until_it_can(pair, monkeypatch):
    a, b = pair
    a.open()
    a.feed(*range(5))
    a.registry.release(STATION)

    def full(*_: object, **__: object) -> None:
        raise JournalError("the disk is full")

    with monkeypatch.context() as patched:
        patched.setattr(b.journal, "append", full)
        with pytest.raises(NotRecordedError, match="the disk is full"):
            b.take()
        refusal = b.open()
        assert isinstance(refusal, ProtocolError)
        assert (refusal.code, "the disk is full" in refusal.message) == ("overloaded", True)
    b.take()
    assert b.open() == Ack(session=NAME, next_seq=5, state="open")
    b.feed(*range(5, COUNT))
    b.close()
    assert reported(b.standing) == EXPECTED


def test_of_two_copies_of_a_session_that_ended_ones_own_is_kept(pair, monkeypatch):
    a, _ = pair
    for each in pair:
        with monkeypatch.context() as strangers:  # the two do not know each other
            strangers.setattr(each.registry._journals, "_peers", PeerJournals(None))
            each.open()
            each.feed(*range(COUNT))
            each.close()
    a.take()
    assert reported(a.standing) == EXPECTED
    assert a.journal.sessions() == ((STATION, NAME),)


# What may happen: a batch comes to the owner, or to both; the station changes hands; somebody is killed.
steps = st.lists(
    st.one_of(st.integers(0, COUNT - 1), st.sampled_from(["commit", "hand", "kill", "freeze", "look"])),
    max_size=40,
)


@pytest.mark.slow
@settings(deadline=None, max_examples=50)
@given(steps)
def test_whatever_happens_between_two_instances_the_session_ends_like_an_undisturbed_one(steps):
    with tempfile.TemporaryDirectory() as directory, ExitStack() as stack:
        a, b = (RestartableRegistry(Path(directory), name, stack) for name in "ab")
        owner, other = a, b
        owner.open()
        epoch = owner.standing.owner.epoch
        for step in steps:
            match step:
                case int():
                    owner.feed(step)
                case "commit":
                    owner.journal.commit()
                case "look":
                    owner.take(renew=False)
                case _:
                    if step == "hand":
                        owner.registry.release(STATION)
                    elif step == "kill":
                        owner.kill()
                    owner, other = other, owner  # the frozen one keeps what it has
                    owner.take()
                    assert owner.standing.owner.epoch > epoch
                    epoch = owner.standing.owner.epoch
        assert owner.open() == Ack(session=NAME, next_seq=owner.next_seq, state="open")
        session = owner.registry.index.sessions[STATION][0]
        Ring(BATCHES).feed(session, heartbeat(COUNT - 1), 1e6)
        assert owner.close() == Ack(session=NAME, next_seq=COUNT, state="closed")
        assert reported(owner.standing) == EXPECTED


def test_what_the_other_gave_up_is_no_longer_held(pair):
    a, b = pair
    a.open()
    a.feed(*range(5))
    a.journal.commit()
    a.feed(7)  # ahead of its turn, and not written yet: then it hangs
    b.take()
    b.feed(9)
    b.registry.handle_samples(STATION, ReplayEnded(NAME, 5, answered=False, evicted=True, oldest=9), 1.0)
    b.journal.commit()
    b.registry.release(STATION)
    a.take()
    a.feed(10, 12)
    assert a.next_seq == 11
    assert asked(a.registry.tick(100.0)) == [(11, 11)]

"""What every journal keeps to. A further implementation joins the table of factories."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from caesura_protocol.messages import (
    Describe,
    Description,
    Edit,
    EditProgram,
    Error,
    Insert,
    NameProgram,
    Undo,
)
from caesura_service.journal import (
    AppliedEdit,
    Journal,
    JournalError,
    JournalSettings,
    MemoryJournal,
    Outcome,
    Record,
    Refused,
    Resolution,
    SqliteJournal,
)
from caesura_service.publishing.events import Owner, ReplayEnded
from caesura_service.publishing.session_state import snapshot_of
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session
from harness.fake_pipeline import make_fake_pipeline
from harness.sessions import batch, batches, closing, new_registry, open_session, opening

EVERYTHING = Resolution(
    inserted=1.0,
    starts=(3,),
    none=((4, 9), (11, 12)),
    label=(7, "steady"),
    force=(1.5, None),
    meant=0.85,
    placed=0.95,
)
FACTORIES = {
    "memory": lambda path: nullcontext(MemoryJournal()),
    "sqlite": lambda path: SqliteJournal(path / "j.sqlite"),
    "sqlite, each record at once": lambda path: SqliteJournal(
        path / "j.sqlite", JournalSettings(commit_s=0.0)
    ),
}


@pytest.fixture(params=FACTORIES)
def journal(request, tmp_path) -> Iterator[Journal]:
    with FACTORIES[request.param](tmp_path) as made:
        yield made


def record(session: str, seq: int, station: str = "cell-1") -> Record:
    return Record(station, session, float(seq), batch(seq, session))


def test_records_come_back_in_the_order_in_which_they_were_appended(journal):
    for seq in (0, 2, 1):
        journal.append(record("s1", seq))
    assert [kept.message.seq for kept in journal.replay("cell-1", "s1")] == [0, 2, 1]
    assert [kept.at for kept in journal.replay("cell-1", "s1")] == [0.0, 2.0, 1.0]


def test_sessions_are_kept_apart_and_listed_in_the_order_of_their_first_record(journal):
    journal.append(record("s2", 0))
    journal.append(record("s1", 0))
    journal.append(record("s2", 0, station="cell-2"))
    journal.append(record("s2", 1))
    assert journal.sessions() == (("cell-1", "s2"), ("cell-1", "s1"), ("cell-2", "s2"))
    assert len(list(journal.replay("cell-1", "s2"))) == 2


@pytest.mark.parametrize(
    "message", [batch(3), opening(), closing(7), Error(code="evicted", message="gone", value=3, limit=9)]
)
@pytest.mark.parametrize("now", [False, True])
def test_a_message_comes_back_as_it_was(journal, message, now):
    kept = Record("cell-1", "s1", 1.5, message)
    journal.append(kept, now=now)
    assert list(journal.replay("cell-1", "s1")) == [kept]


def test_edits_come_back_with_what_they_came_to_in_their_order(journal):
    made = [
        AppliedEdit(
            session="s1", revision=0, author="Ann", action=Insert(t=1.0), version=3, resolution=EVERYTHING
        ),
        AppliedEdit(session="s1", revision=1, author="Bob", action=Undo(), version=4),
    ]
    journal.append(record("s1", 0))
    for edit in made:
        journal.append(Record("cell-1", "s1", 1.0, edit))
    journal.append(Record("cell-2", "s1", 1.0, made[0]))
    assert journal.edits("cell-1", "s1") == tuple(made)
    assert [copy.edits for copy in journal.copies("cell-1", "s1")] == [2]
    assert journal.edits("cell-1", "s2") == journal.copies("cell-1", "s2") == ()


def test_a_name_that_was_forgotten_can_be_used_again(journal):
    journal.append(record("s1", 0))
    journal.delete("cell-1", "s1")
    journal.append(record("s1", 1))
    assert [kept.message.seq for kept in journal.replay("cell-1", "s1")] == [1]


def test_what_is_committed_twice_is_kept_once(journal):
    journal.append(record("s1", 0))
    journal.commit()
    journal.commit()
    assert len(list(journal.replay("cell-1", "s1"))) == 1


def test_more_records_than_are_read_at_once_come_back_in_order(journal):
    for seq in range(1200):
        journal.append(Record("cell-1", "s1", 0.0, batch(0).model_copy(update={"seq": seq})))
    assert [kept.message.seq for kept in journal.replay("cell-1", "s1")] == list(range(1200))


def test_an_unknown_session_has_no_records_and_can_be_forgotten(journal):
    assert list(journal.replay("cell-1", "s1")) == []
    journal.delete("cell-1", "s1")
    assert journal.sessions() == ()


def test_a_forgotten_session_is_gone_and_the_others_stay(journal):
    journal.append(record("s1", 0))
    journal.append(record("s2", 0))
    journal.delete("cell-1", "s1")
    assert journal.sessions() == (("cell-1", "s2"),)


def test_a_replay_that_has_begun_does_not_see_what_is_appended_meanwhile(journal):
    journal.append(record("s1", 0))
    replay = journal.replay("cell-1", "s1")
    journal.append(record("s1", 1))
    assert len(list(replay)) == 1


def outcome_of(session: str = "s1") -> Outcome:
    """How a demonstration of three batches ended."""
    registry = new_registry()
    registry.handle_command("cell-1", opening(session), 0.0)
    for each in batches(3, session):
        registry.handle_samples("cell-1", each, 0.0)
    registry.handle_command("cell-1", closing(2, session), 0.0)
    return Outcome(opening(session), 2, snapshot_of(registry.index.all_states()[0]))


def test_how_a_session_ended_is_kept_as_it_was_until_the_session_is_forgotten(journal):
    journal.append(record("s1", 0))
    assert journal.outcome("cell-1", "s1") is None
    journal.store_outcome("cell-1", outcome_of())
    assert journal.outcome("cell-1", "s1") == outcome_of()
    journal.delete("cell-1", "s1")
    journal.append(record("s1", 0))
    assert journal.outcome("cell-1", "s1") is None


def test_sessions_with_an_outcome_are_listed_the_newest_first_whether_written_or_not(journal):
    for name in ("s2", "s3", "s1", "s4"):
        journal.append(Record("cell-1", name, 0.0, opening(name)))
        journal.append(Record("cell-1", name, 1.0, closing(-1, name)))
    for name in ("s2", "s3", "s1"):
        journal.store_outcome("cell-1", outcome_of(name))
    assert {one.key for one in journal.outcomes()} == {("cell-1", name) for name in ("s1", "s2", "s3")}
    journal.flush()
    assert [one.key[1] for one in journal.outcomes()] == ["s1", "s3", "s2"]
    assert all(one.size > 0 for one in journal.outcomes())
    journal.delete("cell-1", "s3")
    assert [one.key[1] for one in journal.outcomes()] == ["s1", "s2"]


def test_sessions_of_one_station_are_listed_without_those_of_others(journal):
    for station in ("cell-1", "cell-2"):
        journal.append(Record(station, "s1", 0.0, opening("s1")))
        journal.append(Record(station, "s1", 1.0, closing(-1, "s1")))
        journal.store_outcome(station, outcome_of("s1"))
    for _ in ("not written", "written"):
        assert [one.key for one in journal.outcomes("cell-1")] == [("cell-1", "s1")]
        assert [*journal.outcomes("cell-3")] == []
        journal.flush()


def test_a_session_with_a_close_is_a_closed_one(journal):
    for session in ("s1", "s2"):
        journal.append(record(session, 0))
    journal.append(Record("cell-1", "s2", 0.0, closing(0, "s2")))
    assert journal.closed() == {("cell-1", "s2")}


def test_what_is_young_and_small_is_kept(journal):
    journal.append(record("s1", 0))
    journal.commit()
    assert journal.enforce_retention(1.0) == {}
    assert journal.sessions() == (("cell-1", "s1"),)
    assert journal.report().trouble is None


def test_a_journal_in_memory_drops_the_oldest_session_when_it_is_full_and_never_the_one_in_hand():
    journal = MemoryJournal(capacity_bytes=10_000)
    for session in ("s1", "s2"):
        for seq in range(6):
            journal.append(record(session, seq))
    assert journal.sessions() == (("cell-1", "s2"),)
    journal.append(record("s2", 6))
    with pytest.raises(JournalError, match="which holds 10000 bytes: close the session"):
        journal.append(record("s2", 7))
    kept = len(list(journal.replay("cell-1", "s2")))
    assert kept == 7
    journal.append(Record("cell-1", "s2", 0.0, closing(kept - 1)))
    assert journal.closed() == {("cell-1", "s2")}


def test_a_journal_in_memory_that_is_full_takes_from_the_station_that_has_most():
    """It dropped the oldest session, whosever that was."""
    journal = MemoryJournal(capacity_bytes=10_000)
    journal.append(Record("small", "s1", 0.0, batch(0)))
    for session, seq in [("s1", 0), ("s1", 1), *(("s2", seq) for seq in range(5))]:
        journal.append(Record("greedy", session, 0.0, batch(seq)))
    journal.append(Record("small", "s1", 0.0, batch(1)))
    assert journal.sessions() == (("small", "s1"), ("greedy", "s2"))
    with pytest.raises(JournalError, match="session greedy/s2 fills the journal"):
        journal.append(Record("greedy", "s2", 0.0, batch(5)))
    assert journal.sessions() == (("small", "s1"), ("greedy", "s2"))


class FullJournal(MemoryJournal):
    """A disk without room."""

    full = False

    def append(self, record: Record, *, now: bool = False) -> None:
        if self.full:
            raise JournalError("no space left on device")
        super().append(record, now=now)


@pytest.mark.parametrize("message", [batch(1), closing(0), opening(epoch=1)])
def test_what_cannot_be_recorded_is_not_processed(message):
    journal = FullJournal()
    pipeline = make_fake_pipeline(opening(), "fake")
    session = Session(
        "cell-1", opening(), pipeline, owner=Owner("test-1", 1), journal=journal, limits=Limits()
    )
    session.begin(0.0)
    session.receive(batch(0), 0.0)
    journal.full = True
    before = session.state
    with pytest.raises(JournalError, match="no space"):
        session.receive(message, 0.0)
    assert (session.state, session.next_seq) == (before, 1)
    journal.full = False
    session.receive(message, 0.0)


class TimelyJournal(MemoryJournal):
    """Remembers what was written before `append` returned."""

    def __init__(self) -> None:
        super().__init__()
        self.at_once: list[tuple[str, bool]] = []

    def append(self, record: Record, *, now: bool = False) -> None:
        self.at_once.append((type(record.message).__name__, now))
        super().append(record, now=now)


def test_what_cannot_be_sent_again_is_written_at_once():
    journal = TimelyJournal()
    session, _ = open_session(journal)
    for made in batches(6):
        session.receive(made, 0.0)
    session.receive(batch(7), 0.0)
    session.receive(ReplayEnded(session.name, 6, answered=False, evicted=True, oldest=7), 1.0)
    session.receive(Edit(session=session.name, revision=0, author="Ann", action=Insert(t=0.5)), 2.0)
    session.receive(opening(epoch=1), 3.0)
    session.receive(closing(7), 4.0)
    assert [kind for kind, now in journal.at_once if not now] == ["SampleBatch"] * 7
    assert [kind for kind, now in journal.at_once if now] == ["Open", "Error", "AppliedEdit", "Open", "Close"]


def test_copies_show_how_far_along_each_session_is(journal):
    assert journal.copies() == ()
    for message, at in ((opening("s1"), 1.0), (batch(0, "s1"), 2.0), (batch(2, "s1"), 3.0)):
        journal.append(Record("cell-1", "s1", at, message))
    journal.append(Record("cell-2", "s1", 4.0, opening("s1")))
    journal.append(Record("cell-1", "s1", 5.0, batch(3, "s1", epoch=1)))
    journal.append(Record("cell-1", "s2", 6.0, opening("s2")))
    journal.append(Record("cell-1", "s2", 7.0, closing(-1, "s2")))
    one, two = journal.copies("cell-1")
    assert one[:6] == ("cell-1", "s1", 1.0, 5.0, False, 3)
    assert two[:6] == ("cell-1", "s2", 6.0, 7.0, True, -1)
    assert two.progress > one.progress
    assert [copy.key for copy in journal.copies()] == list(journal.sessions())


def test_the_epoch_of_a_station_is_remembered(journal):
    assert journal.epoch_of("cell-1") == -1
    for epoch in (7, 9):
        journal.store_epoch("cell-1", epoch)
    assert journal.epoch_of("cell-1") == 9
    assert journal.epoch_of("cell-2") == -1


def test_copies_state_the_last_completed_takeover_of_their_station(journal):
    journal.append(Record("cell-1", "s1", 1.0, opening("s1")))
    journal.append(Record("cell-2", "s1", 1.0, opening("s1")))
    journal.store_epoch("cell-1", 9)
    assert [copy.owner_epoch for copy in journal.copies()] == [-1, -1]
    for epoch in (7, 9):
        journal.store_takeover("cell-1", epoch)
    assert [copy.owner_epoch for copy in journal.copies()] == [9, -1]


def changed(journal: Journal) -> list[object]:
    """A closed session with two changes of each kind."""
    ann = {"session": "s1", "author": "Ann"}
    tasks = [Description(), Description(task="wipe"), Description(task="polish")]
    messages = [
        AppliedEdit(**ann, revision=0, action=Insert(t=1.0)),
        Describe(**ann, before=tasks[0], description=tasks[1]),
        EditProgram(**ann, revision=0, action=NameProgram(name="one")),
        AppliedEdit(**ann, revision=1, action=Insert(t=2.0)),
        Describe(**ann, before=tasks[1], description=tasks[2]),
    ]
    for message in (opening("s1"), batch(0, "s1"), *messages[:2], closing(0, "s1"), *messages[2:]):
        journal.append(Record("cell-1", "s1", 1.0, message))
    return messages


def test_changes_come_back_in_their_order(journal):
    made = changed(journal)
    found = journal.changes("cell-1", "s1")
    assert [(type(one).type_name(), one.author) for one in found] == [
        (type(one).type_name(), one.author) for one in made
    ]
    assert journal.changes("cell-1", "s2") == ()


@pytest.mark.parametrize("close", [False, True])
def test_what_was_refused_is_gone_as_if_it_had_never_been_recorded(journal, close):
    made = changed(journal)
    (before,) = journal.copies()
    journal.retract("cell-1", "s1", Refused(edits=1, described=2, close=close), "refused")
    assert len(journal.changes("cell-1", "s1")) == len(made) - 2
    (copy,) = journal.copies()
    assert (copy.edits, copy.described, copy.closed, copy.last_seq) == (1, 2, not close, 0)
    assert copy.size < before.size
    assert len([*journal.replay("cell-1", "s1")]) == 2 + 3 + (not close)
    assert journal.sessions() == (("cell-1", "s1"),)
    journal.append(record("s1", 1))
    assert len([*journal.replay("cell-1", "s1")]) == 3 + 3 + (not close)

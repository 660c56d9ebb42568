"""What every journal keeps to. A further implementation joins the list of factories."""

from __future__ import annotations

import pytest

from caesura_service.journal import Journal, MemoryJournal, Record
from caesura_service.session.fake_pipeline import make_fake_pipeline
from caesura_service.session.limits import Limits
from caesura_service.session.ports import Owner
from caesura_service.session.session import Session
from harness.sessions import batch, closing, opening


@pytest.fixture(params=[MemoryJournal])
def journal(request) -> Journal:
    return request.param()


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


def test_a_message_comes_back_as_it_was(journal):
    kept = Record("cell-1", "s1", 1.5, batch(3))
    journal.append(kept)
    assert next(journal.replay("cell-1", "s1")) == kept


def test_an_unknown_session_has_no_records_and_can_be_forgotten(journal):
    assert list(journal.replay("cell-1", "s1")) == []
    journal.forget("cell-1", "s1")
    assert journal.sessions() == ()


def test_a_forgotten_session_is_gone_and_the_others_stay(journal):
    journal.append(record("s1", 0))
    journal.append(record("s2", 0))
    journal.forget("cell-1", "s1")
    assert journal.sessions() == (("cell-1", "s2"),)


def test_a_replay_that_has_begun_does_not_see_what_is_appended_meanwhile(journal):
    journal.append(record("s1", 0))
    replay = journal.replay("cell-1", "s1")
    journal.append(record("s1", 1))
    assert len(list(replay)) == 1


def test_a_journal_in_memory_drops_the_oldest_session_when_it_is_full_and_never_the_one_in_hand():
    journal = MemoryJournal(capacity_bytes=10_000)
    for session in ("s1", "s2"):
        for seq in range(6):
            journal.append(record(session, seq))
    assert journal.sessions() == (("cell-1", "s2"),)
    for seq in range(6, 20):
        journal.append(record("s2", seq))
    assert len(list(journal.replay("cell-1", "s2"))) == 20


class FullJournal(MemoryJournal):
    """A disk without room."""

    full = False

    def append(self, record: Record) -> None:
        if self.full:
            raise OSError("no space left on device")
        super().append(record)


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
    before = session.standing
    with pytest.raises(OSError, match="no space"):
        session.receive(message, 0.0)
    assert (session.standing, session.next_seq) == (before, 1)
    journal.full = False
    session.receive(message, 0.0)

"""The journal on disk: what it survives, what it refuses, and in which words."""

from __future__ import annotations

import itertools
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing as ended
from contextlib import contextmanager, suppress
from typing import NamedTuple

import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack
from caesura_service.journal import (
    JournalError,
    JournalSettings,
    Outcome,
    PeerJournals,
    Record,
    SqliteJournal,
    peer_journals,
)
from caesura_service.journal import writer_thread as writer
from caesura_service.journal.peer_journals import open_for_reading
from caesura_service.journal.sqlite_database import LOG_KEPT
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import snapshot_of, status_of
from harness.processes import eventually
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
)
from service.journal.journal_files import NEVER, grow_again, grow_no_more, killed, on_disk, record

DEADLINE_S = 30.0


def steps_of_a_commit(journal: SqliteJournal, seqs: range) -> int:
    """Of SQLite's virtual machine, in tens."""
    steps = itertools.count()
    for seq in seqs:
        journal.append(record(seq))
    journal._database.set_progress_handler(lambda: next(steps) < 0, 10)
    journal.commit()
    journal._database.set_progress_handler(None, 10)
    return next(steps)


class RefusedBatch(NamedTuple):
    seq: int
    reason: str


def until_refused(journal: SqliteJournal, seqs: range, *, now: bool = False) -> RefusedBatch:
    for seq in seqs:
        try:
            journal.append(record(seq), now=now)
        except JournalError as error:
            return RefusedBatch(seq, str(error))
    raise AssertionError("everything was taken")


# --- commits --------------------------------------------------------------------------------------------


def test_a_record_is_on_disk_within_the_bounded_delay_without_a_flush(path):
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        written = threading.Event()
        journal._succeed, succeed = lambda: (succeed(), written.set()), journal._succeed
        journal.append(record(0))
        assert written.wait(DEADLINE_S)
        assert on_disk(path) == [0]


def test_what_shall_be_safe_now_is_and_everything_before_it(path):
    with SqliteJournal(path, NEVER) as journal:
        journal.append(record(0))
        assert on_disk(path) == []
        journal.append(record(1), now=True)
        assert on_disk(path) == [0, 1]
        journal.append(record(2))
        journal.commit()
        assert on_disk(path) == [0, 1, 2]


def test_what_waits_is_written_when_the_journal_is_closed(path):
    with SqliteJournal(path, NEVER) as journal:
        journal.append(record(0))
    assert on_disk(path) == [0]


def test_a_killed_process_loses_what_waited_and_nothing_else(path, tmp_path):
    with SqliteJournal(path, NEVER) as journal:
        journal.append(record(0), now=True)
        journal.append(record(1))
        left = killed(path, tmp_path / "left")
    with SqliteJournal(left) as journal:
        assert [kept.message.seq for kept in journal.replay(STATION, NAME)] == [0]


def test_a_batch_that_is_written_twice_is_there_once(path):
    with SqliteJournal(path, NEVER) as journal:
        for _ in range(2):
            journal.append(record(0))
        journal.append(record(0))
    assert on_disk(path) == [0]
    with SqliteJournal(path, NEVER) as journal:
        size = on_disk(path, "SELECT size FROM sessions")
        journal.append(record(0), now=True)
        assert on_disk(path, "SELECT size FROM sessions") == size


def test_a_commit_costs_the_same_however_much_there_is(path):
    with SqliteJournal(path, NEVER) as journal:
        first = [steps_of_a_commit(journal, seqs) for seqs in (range(64), range(64, 128))]
        for seq in range(128, 1024):
            journal.append(record(seq))
        journal.commit()
        assert steps_of_a_commit(journal, range(1024, 1088)) < 1.2 * max(first)


def steps_of_an_open(journal: SqliteJournal, registry: Registry, session: str) -> int:
    steps = itertools.count()
    journal._database.set_progress_handler(lambda: next(steps) < 0, 10)
    registry.handle_command(STATION, opening(session), 1e4)
    journal._database.set_progress_handler(None, 10)
    return next(steps)


def test_an_open_costs_the_same_however_many_old_sessions_the_station_has(path):
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        steps_of_an_open(journal, registry, "first")
        before = steps_of_an_open(journal, registry, "second")
        for number in range(300):
            journal.append(Record(STATION, f"old-{number}", 0.0, opening(f"old-{number}")))
        journal.commit()
        assert steps_of_an_open(journal, registry, "third") < 1.2 * before


def test_an_open_costs_the_same_however_many_old_sessions_another_instance_has(path, monkeypatch):
    """Beside it, the newest of them decides when the new one was opened."""
    steps = itertools.count()

    @contextmanager
    def counting(*given: object) -> Iterator[sqlite3.Connection]:
        with open_for_reading(*given) as kept:
            kept.set_progress_handler(lambda: next(steps) < 0, 10)
            yield kept

    def steps_of(session: str) -> int:
        before = next(steps)
        assert isinstance(answer(registry.handle_command(STATION, opening(session), 1e4)), Ack)
        return next(steps) - before

    monkeypatch.setattr(peer_journals, "open_for_reading", counting)
    with SqliteJournal(path.with_name("peer.sqlite"), NEVER) as peer, SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal, peers=PeerJournals(path))
        peer.append(Record(STATION, "old", 0.0, opening("old")), now=True)
        before = steps_of("first")
        for number in range(1000):
            peer.append(Record(STATION, f"old-{number}", 0.0, opening(f"old-{number}")))
        peer.commit()
        assert steps_of("second") < 1.2 * before


def test_payloads_are_the_codecs_bytes(path):
    with SqliteJournal(path) as journal:
        journal.append(Record(STATION, NAME, 0.0, opening()), now=True)
    (encoding,) = on_disk(path, "SELECT encoding FROM records")
    assert encoding == "application/msgpack;caesura.Open.v1"


# --- files that will not do -----------------------------------------------------------------------------


# --- a full disk ----------------------------------------------------------------------------------------


def test_a_full_disk_refuses_what_shall_be_safe_now_and_keeps_nothing_of_it(path):
    with SqliteJournal(path, NEVER) as journal:
        journal.append(record(0), now=True)
        grow_no_more(journal)
        said = until_refused(journal, range(1, 200), now=True)
        assert "caesura-1.sqlite cannot be written, there is no room left: free" in said.reason
        refused = said.seq
        grow_again(journal)
        journal.commit()
    assert on_disk(path) == list(range(refused))


def test_after_a_commit_that_failed_appends_are_refused_until_it_is_made_up_for(path, monkeypatch):
    monkeypatch.setattr(writer, "RETRY_S", 0.01)
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        journal.append(record(0), now=True)
        grow_no_more(journal)
        said = until_refused(journal, range(1, 1_000_000))
        assert "no room left" in said.reason
        recovered = threading.Event()
        journal._succeed, succeed = lambda: (succeed(), recovered.set()), journal._succeed
        grow_again(journal)
        assert recovered.wait(DEADLINE_S)
        journal.append(record(said.seq), now=True)
    assert on_disk(path) == list(range(said.seq + 1))


def test_a_disk_that_is_too_slow_refuses_before_memory_runs_out(path):
    with SqliteJournal(path, JournalSettings(commit_s=3600.0, waiting_bytes=2000)) as journal:
        assert "written too slowly" in until_refused(journal, range(10)).reason
        journal.commit()
        journal.append(record(10))


# --- sessions on it -------------------------------------------------------------------------------------


def test_an_acknowledgement_is_given_for_what_is_safe(path):
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        for each in batches(3):
            registry.handle_samples(STATION, each, 0.0)
        assert on_disk(path, "SELECT count(*) FROM records") == [1]
        assert answer(registry.handle_command(STATION, opening(), 0.0)) == Ack(
            session=NAME, next_seq=3, state="open"
        )
        assert on_disk(path, "SELECT count(*) FROM records") == [4]


def test_a_session_that_cannot_be_recorded_is_not_opened_and_the_answer_says_why(path):
    with SqliteJournal(path, NEVER) as journal:
        journal._database.execute("PRAGMA query_only = ON")
        registry = new_registry(journal)
        refusal = answer(registry.handle_command(STATION, opening(), 0.0))
        journal._database.execute("PRAGMA query_only = OFF")
    assert isinstance(refusal, ProtocolError)
    assert refusal.code == "overloaded", "a bridge that teaches must try again: it has the samples"
    assert str(path) in refusal.message
    assert registry.index.sessions == {}


def test_while_the_disk_is_full_a_session_says_so_and_afterwards_it_lacks_nothing(path):
    count = 40
    ring = Ring(batches(count))
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        registry.handle_samples(STATION, batch(0), 0.0)
        journal.commit()
        grow_no_more(journal)
        journal._error = JournalError("journal is full")  # as the thread finds it
        for seq in range(1, 10):
            registry.handle_samples(STATION, batch(seq), 0.0)
        status = status_of(registry.index.all_states()[0])
        assert status.refused == {"overloaded": 9}
        assert status.last_refusal is not None
        assert "journal is full" in status.last_refusal.message
        # Answers to questions cannot be recorded either, which does not make them lost.
        now = 0.0
        for _ in range(8):
            now += 10.0
            for out in registry.handle_samples(STATION, heartbeat(9), now):
                if asked([out]):
                    for reply in ring.answer(out):
                        registry.handle_samples(STATION, reply, now)
        grow_again(journal)
        journal.commit()
        session = registry.index.sessions[STATION][0]
        ring.feed(session, heartbeat(count - 1), now + 10.0)
        registry.handle_command(STATION, closing(count - 1), now + 20.0)
        standing = session.state
    undisturbed = new_registry()
    undisturbed.handle_command(STATION, opening(), 0.0)
    for each in batches(count):
        undisturbed.handle_samples(STATION, each, 0.0)
    undisturbed.handle_command(STATION, closing(count - 1), 0.0)
    expected = snapshot_of(undisturbed.index.all_states()[0])
    shown = snapshot_of(standing)
    assert (shown.segments, shown.changepoints, shown.program) == (
        expected.segments,
        expected.changepoints,
        expected.program,
    )
    assert shown.status.gaps == ()
    assert shown.status.samples == expected.status.samples


def concluded(registry: Registry, name: str) -> Outcome:
    """Of a session that a journal has."""
    (standing,) = [one for one in registry.index.all_states() if one.session == name]
    return Outcome(opening(name), -1, snapshot_of(standing))


def test_who_ends_a_session_does_not_wait_until_its_outcome_is_written(tmp_path):
    """An hour of results is megabytes: a close took up to 90 ms of the worker in one turn."""
    with SqliteJournal(tmp_path / "caesura-1.sqlite", NEVER) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        outcome = concluded(registry, NAME)
        ended = threading.Thread(target=journal.store_outcome, args=(STATION, outcome), daemon=True)
        with journal._writing:  # the disk works
            ended.start()
            ended.join(DEADLINE_S)
            assert not ended.is_alive()
            assert journal.outcome(STATION, NAME) is outcome
    with SqliteJournal(tmp_path / "caesura-1.sqlite") as journal:
        assert journal.outcome(STATION, NAME) == outcome, "written before the journal is let go of"


def test_an_outcome_that_the_disk_refuses_is_tried_again(path, monkeypatch):
    """It was dropped: once the session was no longer held, no list had it before the next start."""
    with SqliteJournal(path, JournalSettings(commit_s=0.0)) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        with monkeypatch.context() as patch:
            patch.setattr(writer, "INSERT_OUTCOME", "INSERT INTO nowhere VALUES (?, ?, ?, ?, ?, ?)")
            journal.store_outcome(STATION, concluded(registry, NAME))
            with pytest.raises(JournalError, match="cannot be used"):
                journal.flush()
            assert [one.key for one in journal.outcomes()] == [(STATION, NAME)]
        eventually(lambda: not [*journal.outcomes()])  # none waits, and the session is open
        assert journal.outcome(STATION, NAME) == concluded(registry, NAME)


def test_outcomes_that_the_disk_refuses_are_bounded(path, monkeypatch):
    with SqliteJournal(path, NEVER) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        outcome = concluded(registry, NAME)
        with monkeypatch.context() as patch:
            patch.setattr(writer, "INSERT_OUTCOME", "INSERT INTO nowhere VALUES (?, ?, ?, ?, ?, ?)")
            for number in range(2 * writer.OUTCOMES):
                with suppress(JournalError):
                    journal.store_outcome(f"cell-{number}", outcome)
            assert len([*journal.outcomes()]) == writer.OUTCOMES


def test_the_outcome_of_a_session_that_was_dropped_is_not_that_of_the_next_one_of_its_name(tmp_path):
    with SqliteJournal(tmp_path / "caesura-1.sqlite", NEVER) as journal:
        registry = new_registry(journal)
        registry.handle_command(STATION, opening(), 0.0)
        journal.store_outcome(STATION, concluded(registry, NAME))
        journal.delete(STATION, NAME)
        journal.append(record(0), now=True)
        journal.flush()
        assert journal.outcome(STATION, NAME) is None


def append_and_commit(journal, numbers):
    """Append records; on a full disk an append is refused where the writer has tried before."""
    for seq in numbers:
        journal.append(record(seq))
    journal.commit()


def test_a_refusal_keeps_no_frames_of_those_before(path):
    """One error was raised for every refused batch, and kept the frames of all: megabytes a second."""
    with SqliteJournal(path) as journal:
        journal.append(record(0), now=True)
        grow_no_more(journal)
        lengths = []
        with pytest.raises(JournalError):
            append_and_commit(journal, range(100))
        for _ in range(100):
            with pytest.raises(JournalError) as refusal:
                journal.append(record(0, "another"))
            lengths.append(len(refusal.traceback))
        assert max(lengths) < 10
        grow_again(journal)


def test_the_log_of_a_journal_gives_back_what_it_took_while_a_reader_kept_it(path):
    """After a backup, or a shell that was left open, it kept its room on the disk until the service ended."""
    log = path.with_name(path.name + "-wal")
    with SqliteJournal(path, NEVER) as journal, ended(sqlite3.connect(path)) as reader:
        journal.append(record(0), now=True)
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM records").fetchone()
        for number in range(40):
            journal.keep_overview((STATION, NAME), 1, bytes([number]) * (1 << 19))
        assert log.stat().st_size > LOG_KEPT
        reader.rollback()
        for seq in range(1, 4):
            journal.append(record(seq), now=True)
        assert log.stat().st_size <= LOG_KEPT
        assert on_disk(path) == [0, 1, 2, 3]


def test_who_looks_into_the_journal_of_a_service_waits_for_its_slow_disk(path):
    """`sessions delete` and `export` gave up after 2 s, and advised to end the service."""
    with SqliteJournal(path) as journal, SqliteJournal(path, alone=False) as guest:
        waits = [one._database.execute("PRAGMA busy_timeout").fetchone()[0] for one in (journal, guest)]
    assert waits == [2000, 30_000]

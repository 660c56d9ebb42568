"""Sessions that are dropped: unknown at once, gone by and by, and nobody waits for that."""

from __future__ import annotations

import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from caesura_protocol.codec import encode, pack_samples
from caesura_service.journal import JournalError, JournalSettings, Record, SqliteJournal
from caesura_service.journal.deletion import BATCH, SELECT_DELETED, SESSIONS, delete_batch, mark_deleted
from caesura_service.journal.sqlite_database import open_database
from caesura_service.journal.sqlite_journal import PATIENCE
from harness.journals import journal_file, not_written
from harness.processes import eventually
from harness.sessions import COLUMNS, NAME, STATION, batch, demonstration
from service.journal.journal_files import grow_no_more

COUNT = 3 * BATCH
KEY = (STATION, NAME)
DEADLINE_S = 30.0
FIRST = batch(0)


def record(seq: int, session: str = NAME) -> Record:
    """All have the samples of the first one, which take longer to make than a record to write."""
    return Record(STATION, session, float(seq), FIRST.model_copy(update={"seq": seq, "session": session}))


def taught(journal: SqliteJournal, count: int = COUNT, session: str = NAME) -> None:
    for seq in range(count):
        journal.append(record(seq, session))
    journal.commit()


def failing(*_: object) -> None:
    raise sqlite3.OperationalError("database is locked")


def count(path: Path, table: str) -> int:
    with closing(sqlite3.connect(path)) as reader:
        (found,) = reader.execute(f"SELECT count(*) FROM {table}").fetchone()
    return int(found)


def test_a_session_is_unknown_at_once_and_its_records_go_by_and_by(path):
    with SqliteJournal(path) as journal:
        taught(journal)
        taught(journal, 2, "other")
        journal.delete(*KEY)
        assert journal.sessions() == ((STATION, "other"),)
        assert [copy.session for copy in journal.copies()] == ["other"]
        assert [copy.session for copy in journal.copies(STATION)] == ["other"]
        assert [*journal.replay(*KEY)] == []
        assert set(journal.enforce_retention(0.0)) == set()
        eventually(lambda: (count(path, "records"), count(path, "sessions")) == (2, 1), DEADLINE_S)


def test_a_full_journal_makes_room_by_what_it_drops(path):
    with SqliteJournal(path, JournalSettings(commit_s=0.01)) as journal:
        taught(journal)
        journal.append(record(0, "new"), now=True)
        grow_no_more(journal)
        with pytest.raises(JournalError, match="full"):
            taught(journal, COUNT, "new")
        waiting = journal.report().waiting
        assert waiting > 0
        journal.delete(*KEY)
        eventually(lambda: journal.report().trouble is None, DEADLINE_S)
        journal.append(record(COUNT, "new"), now=True)
        kept = [one.message.seq for one in journal.replay(STATION, "new")]
        eventually(lambda: count(path, "sessions") == 1, DEADLINE_S)
    assert kept == sorted(set(kept))
    assert kept[-1] == COUNT


def test_what_waits_of_a_dropped_session_is_dropped_too(path, monkeypatch):
    with SqliteJournal(path, JournalSettings(commit_s=3600.0)) as journal:
        journal.append(record(0))
        journal.append(record(0, "other"))
        with monkeypatch.context() as patch:
            patch.setattr("caesura_service.journal.writer_thread.write_rows", failing)
            journal.delete(*KEY)
        assert journal.sessions() == ((STATION, "other"),)


def test_dropping_goes_on_once_no_other_process_writes(path, monkeypatch):
    refusals = [True] * 3  # more than there are reasons to look

    def drop(database: sqlite3.Connection) -> bool:
        if database.execute(SELECT_DELETED).fetchone() and refusals:
            refusals.pop()
            failing()
        return delete_batch(database)

    monkeypatch.setattr("caesura_service.journal.writer_thread.RETRY_S", 0.01)
    monkeypatch.setattr("caesura_service.journal.writer_thread.delete_batch", drop)
    with SqliteJournal(path) as journal:
        taught(journal, 5)
        journal.delete(*KEY)
        eventually(lambda: count(path, "records") == 0, DEADLINE_S)


def test_what_another_process_dropped_is_reported_where_nothing_can_be_dropped(path, monkeypatch):
    with SqliteJournal(path, JournalSettings(age_s=100.0)) as journal:
        journal.append(record(0, "old"), now=True)
        journal.append(record(900, "theirs"), now=True)
        with not_written(journal):
            journal.enforce_retention(10.0)
        with closing(sqlite3.connect(path, isolation_level=None)) as other:
            mark_deleted(other, (STATION, "theirs"))
        with monkeypatch.context() as patch, not_written(journal):
            patch.setattr("caesura_service.journal.sqlite_journal.mark_deleted", failing)
            assert set(journal.enforce_retention(950.0)) == {(STATION, "theirs")}
        with not_written(journal):
            assert set(journal.enforce_retention(950.0)) == {(STATION, "old")}


def test_a_portion_is_all_that_a_writer_waits_for(path):
    with SqliteJournal(path) as journal:
        taught(journal)
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        mark_deleted(database, KEY)
        left = []
        while delete_batch(database):
            left.append(count(path, "records"))
    assert left == [2 * BATCH, BATCH, 0, 0]
    assert count(path, "sessions") == 0


def test_a_portion_has_several_sessions_of_few_records(path):
    """It had one: a station that opened and closed sessions made the file grow without bound."""
    names = [f"s{number}" for number in range(SESSIONS + 3)]
    with SqliteJournal(path) as journal:
        taught(journal, BATCH + 1, "long")
        for name in names:
            taught(journal, 2, name)
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        for name in names:
            mark_deleted(database, (STATION, name))
        left = []
        while delete_batch(database):
            left.append(count(path, "sessions"))
        assert left == [4, 1]
        assert count(path, "records") == BATCH + 1


def test_a_deletion_takes_little_of_the_room_that_it_frees(path):
    """Some builds of SQLite write zeros over it. On a full disk a deletion of 5 kB batches never ended."""
    large = pack_samples(demonstration(300), COLUMNS, session=NAME, epoch=0, seq=0)
    with SqliteJournal(path) as journal:
        for seq in range(BATCH):
            message = large.model_copy(update={"seq": seq})
            journal.append(Record(STATION, NAME, float(seq), message))
    with closing(open_database(path)) as database:
        mark_deleted(database, KEY)
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert delete_batch(database)
        written = path.with_name(f"{path.name}-wal").stat().st_size
    assert 0 < written < BATCH * len(encode(large).payload) / 8


def test_the_name_may_be_taken_again_before_everything_is_gone(path):
    with SqliteJournal(path) as journal:
        taught(journal)
        journal.delete(*KEY)
        taught(journal, 5)
        eventually(lambda: count(path, "sessions") == 1, DEADLINE_S)
        assert [kept.message.seq for kept in journal.replay(*KEY)] == [0, 1, 2, 3, 4]


def test_what_a_killed_process_began_to_drop_is_dropped_by_the_next(path):
    with SqliteJournal(path) as journal:
        taught(journal)
    with journal_file(path) as database:
        mark_deleted(database, KEY)
    with SqliteJournal(path) as journal:
        assert journal.sessions() == ()
        eventually(lambda: count(path, "records") == 0, DEADLINE_S)


def test_a_deletion_while_no_service_runs_leaves_nothing(path):
    with SqliteJournal(path) as journal:
        taught(journal)
    with SqliteJournal(path, alone=False) as journal:
        journal.delete(*KEY)
    assert (count(path, "records"), count(path, "sessions")) == (0, 0)


def test_a_look_does_not_wait_for_what_is_being_written_but_now_and_then(path):
    """Once a second every station waited for the disk."""
    with SqliteJournal(path, JournalSettings(commit_s=3600.0)) as journal:
        taught(journal, 1)
        with not_written(journal):
            assert journal.enforce_retention(0.0) == {}
        with SqliteJournal(path, alone=False) as other:
            other.delete(*KEY)
        writes, over = threading.Event(), threading.Event()

        def write() -> None:
            with journal._writing:
                writes.set()
                over.wait(DEADLINE_S)

        writer = threading.Thread(target=write)
        writer.start()
        assert writes.wait(DEADLINE_S)
        for second in range(PATIENCE - 1):
            assert journal.enforce_retention(float(second)) == {}
            assert writer.is_alive()
        threading.Timer(0.0, over.set).start()
        assert journal.enforce_retention(100.0) == {KEY: "deleted by another process"}
        writer.join()

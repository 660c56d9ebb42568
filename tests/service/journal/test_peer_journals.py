"""Other instances' journals in the same directory: read as they are, passed over where they cannot be."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from pathlib import Path

import pytest

from caesura_service.journal import PeerJournals, Record, SqliteJournal
from caesura_service.journal.peer_journals import open_for_reading
from caesura_service.journal.rows import copies_in, epoch_in
from caesura_service.journal.sqlite_database import open_database
from caesura_service.journal.sqlite_statements import SCHEMA_VERSION
from harness.sessions import NAME, STATION, batch, batches, closing, new_registry, opening
from service.journal.journal_files import NEVER


@pytest.fixture
def siblings(tmp_path: Path) -> PeerJournals:
    return PeerJournals(tmp_path / "mine.sqlite")


def taught(journal: SqliteJournal, count: int, *, close: bool = False, session: str = NAME) -> None:
    registry = new_registry(journal)
    registry.handle_command(STATION, opening(session), 10.0)
    for each in batches(count, session):
        registry.handle_samples(STATION, each, 11.0)
    if close:
        registry.handle_command(STATION, closing(count - 1, session), 12.0)
    journal.commit()


def test_nobodys_siblings_are_none():
    assert PeerJournals(None).copies() == []
    assert PeerJournals(None).epoch_of(STATION) == -1


def test_ones_own_journal_is_no_sibling_and_looking_makes_no_file(tmp_path, siblings):
    assert siblings.copies() == []
    assert list(tmp_path.iterdir()) == []
    with SqliteJournal(tmp_path / "mine.sqlite") as journal:
        taught(journal, 2)
        assert siblings.copies() == []


def test_a_journal_that_is_about_to_be_created_is_passed_over_without_a_word(tmp_path, siblings, caplog):
    """Two instances start at the same time: SQLite's file is there before its tables are."""
    path = tmp_path / "other.sqlite"
    path.touch()
    assert siblings.stations() == frozenset()
    with sqlite3.connect(path) as began:
        began.execute("PRAGMA journal_mode = WAL")
        assert siblings.epoch_of(STATION) == -1
    began.close()
    assert caplog.text == ""
    with SqliteJournal(path) as journal:
        taught(journal, 2)
        assert siblings.stations() == {STATION}


def test_a_peer_never_sees_a_new_journal_with_a_part_of_its_tables(tmp_path, monkeypatch):
    """It looks after the first transaction."""
    seen = []

    def look(_database: sqlite3.Connection, path: Path) -> None:
        with open_for_reading(path) as kept:
            seen.append((copies_in(kept), epoch_in(kept, STATION)))

    monkeypatch.setattr("caesura_service.journal.sqlite_database.check", look)
    with contextlib.closing(open_database(tmp_path / "new.sqlite")):
        assert seen == [((), -1)]


def test_what_an_owner_that_runs_has_committed_is_seen(tmp_path, siblings):
    with SqliteJournal(tmp_path / "other.sqlite", NEVER) as journal:
        taught(journal, 5)
        taught(journal, 3, close=True, session="s2")
        journal.flush()  # as its thread does soon
        journal.append(Record(STATION, NAME, 13.0, batch(5)))  # not committed
        journal.store_epoch(STATION, 77)
        one, two = siblings.copies(STATION)
        assert (one.copy.session, one.copy.closed, one.copy.last_seq) == (NAME, False, 4)
        assert (two.copy.session, two.copy.closed, two.copy.last_seq) == ("s2", True, 2)
        assert siblings.copies("cell-9") == []
        assert siblings.epoch_of(STATION) == 77
        assert siblings.outcome(one) is None
        outcome = siblings.outcome(two)
        assert outcome is not None
        assert outcome.last_seq == 2
        assert list(siblings.records(one)) == list(journal.replay(STATION, NAME))[:-1]


def test_records_beyond_a_batch_come_with_everything_that_is_no_batch(tmp_path, siblings):
    with SqliteJournal(tmp_path / "other.sqlite", NEVER) as journal:
        taught(journal, 5, close=True)
        (found,) = siblings.copies()
        beyond = [record.message for record in siblings.records(found, 3)]
        assert beyond == [opening(), batch(3), batch(4), closing(4)]


def test_what_is_appended_while_it_is_read_is_read_as_well(tmp_path, siblings):
    with SqliteJournal(tmp_path / "other.sqlite", NEVER) as journal:
        taught(journal, 250)  # more than a page
        (found,) = siblings.copies()
        records = siblings.records(found, 1)
        next(records)
        journal.append(Record(STATION, NAME, 13.0, batch(250)), now=True)
        assert [record.message.seq for record in records] == list(range(1, 251))


def test_an_owner_in_the_middle_of_writing_does_not_keep_a_reader_waiting(tmp_path, siblings):
    with SqliteJournal(tmp_path / "other.sqlite", NEVER) as journal:
        taught(journal, 5)
        writer = sqlite3.connect(tmp_path / "other.sqlite", isolation_level=None)
        writer.execute("BEGIN IMMEDIATE")  # and is frozen
        writer.execute("DELETE FROM records")
        (found,) = siblings.copies()
        assert len(list(siblings.records(found))) == 6
        writer.close()


def test_what_a_killed_owner_left_in_its_log_is_seen(tmp_path, siblings):
    (tmp_path / "elsewhere").mkdir()
    with SqliteJournal(tmp_path / "elsewhere" / "other.sqlite") as journal:
        taught(journal, 5)
        for name in ("other.sqlite", "other.sqlite-wal"):  # as the disk is the moment after
            shutil.copy(tmp_path / "elsewhere" / name, tmp_path / name)
    (found,) = siblings.copies()
    assert found.copy.last_seq == 4
    assert len(list(siblings.records(found))) == 6


def letter(path: Path) -> None:
    path.write_text("a letter to my mother " * 100)


def newer(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    database.close()


def torn(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[:4096] + b"\xff" * (len(content) - 4096))


@pytest.mark.parametrize("damage", [letter, newer, torn])
def test_one_that_cannot_be_read_is_passed_over_and_named_once(tmp_path, siblings, caplog, damage):
    for name in ("other", "third"):
        with SqliteJournal(tmp_path / f"{name}.sqlite") as journal:
            taught(journal, 2)
    damage(tmp_path / "other.sqlite")
    for _ in range(2):
        assert [found.path.name for found in siblings.copies()] == ["third.sqlite"]
        assert siblings.epoch_of(STATION) >= -1
    said = [record.getMessage() for record in caplog.records if "other.sqlite" in record.getMessage()]
    assert len(said) == len(set(said)) > 0
    assert not any("third.sqlite" in text for text in said)


def test_one_that_is_torn_in_the_middle_is_read_as_far_as_it_goes(tmp_path, siblings):
    path = tmp_path / "other.sqlite"
    with SqliteJournal(path) as journal:
        taught(journal, 400)
    (found,) = siblings.copies()
    content = path.read_bytes()
    page = content.rindex(b"samples") // 4096
    path.write_bytes(content[: page * 4096] + b"\xff" * 4096 + content[(page + 1) * 4096 :])
    records = list(siblings.records(found))
    assert 200 <= len(records) < 401


def test_a_journal_of_version_1_becomes_one_of_version_2(tmp_path):
    path = tmp_path / "mine.sqlite"
    with SqliteJournal(path) as journal:
        taught(journal, 2)
    database = sqlite3.connect(path)
    database.executescript("DROP TABLE stations; PRAGMA user_version = 1;")
    database.close()
    with SqliteJournal(path) as journal:
        assert journal.epoch_of(STATION) == -1
        journal.store_epoch(STATION, 5)
        assert journal.epoch_of(STATION) == 5
        assert len(list(journal.replay(STATION, NAME))) == 3

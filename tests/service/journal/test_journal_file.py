"""The file of a journal: its permissions and lock, and files that are damaged, removed or no journal."""

from __future__ import annotations

import errno
import os
import re
import shutil
import sqlite3
from pathlib import Path

import pytest

from caesura_service.journal import JournalError, SqliteJournal, sqlite_errors
from caesura_service.journal.sqlite_errors import map_sqlite_errors
from caesura_service.journal.sqlite_statements import SCHEMA_VERSION
from harness.sessions import NAME, STATION
from service.journal.journal_files import NEVER, killed, on_disk, record, written


def modes(path: Path) -> set[int]:
    """Of the journal's files."""
    return {part.stat().st_mode & 0o777 for part in path.parent.glob(path.name + "*")}


@pytest.mark.parametrize("umask", [0o000, 0o022, 0o377])
def test_what_is_new_is_its_owners_whatever_the_umask(tmp_path, umask):
    path = tmp_path / "new" / "caesura-1.sqlite"
    before = os.umask(umask)
    try:
        with SqliteJournal(path) as journal:
            journal.append(record(0), now=True)
            assert len([*path.parent.iterdir()]) >= 3  # the log, and the lock
            assert modes(path) == {0o600}
    finally:
        os.umask(before)
    assert path.parent.stat().st_mode & 0o777 == 0o700


def test_a_journal_that_begins_empty_is_no_secret(path, caplog):
    """Its disk may not be mounted: the sessions on it are not there, and nothing else says so."""
    caplog.set_level("INFO")
    for _ in range(2):
        written(path)
    assert caplog.text.count(f"journal {path} did not exist and begins empty") == 1


def test_an_older_journal_becomes_its_owners_and_a_directory_that_was_there_stays_as_it_is(tmp_path):
    path = tmp_path / "caesura-1.sqlite"
    tmp_path.chmod(0o755)
    written(path)
    path.chmod(0o644)
    with SqliteJournal(path) as journal:
        journal.append(record(0), now=True)
        assert modes(path) == {0o600}
    assert tmp_path.stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("damage", ["truncated", "last page corrupted"])
def test_a_damaged_tail_of_the_log_opens_and_loses_the_tail_alone(path, tmp_path, damage):
    with SqliteJournal(path, NEVER) as journal:
        for seq in range(20):
            journal.append(record(seq), now=True)
        left = killed(path, tmp_path / "left")
    log = left.with_name(left.name + "-wal")
    content = log.read_bytes()
    keep = len(content) - 2000
    log.write_bytes(content[:keep] + (b"" if damage == "truncated" else b"\xff" * 2000))
    with SqliteJournal(left) as journal:
        kept = [each.message.seq for each in journal.replay(STATION, NAME)]
        assert kept == list(range(19))
        journal.append(record(19), now=True)
        assert len(list(journal.replay(STATION, NAME))) == 20


def test_a_damaged_file_is_set_aside_whole_and_a_new_one_begun(path, caplog):
    with SqliteJournal(path, NEVER) as journal:
        for seq in range(200):
            journal.append(record(seq))
    content = bytearray(path.read_bytes())
    middle = len(content) // 8192 * 4096
    content[middle : middle + 4096] = b"\xff" * 4096
    path.write_bytes(content)
    with SqliteJournal(path) as journal:
        assert journal.sessions() == ()
        journal.append(record(0), now=True)
    (aside,) = path.parent.glob("caesura-1.sqlite.damaged-*")
    assert aside.read_bytes()[4096:] == content[4096:]
    assert "is damaged (" in caplog.text
    assert aside.name in caplog.text
    with SqliteJournal(path) as journal:
        assert len(list(journal.replay(STATION, NAME))) == 1


def test_a_file_that_is_no_journal_is_left_alone(path):
    path.write_bytes(b"a letter to my mother " * 100)
    with pytest.raises(JournalError, match=r"caesura-1.sqlite is no journal: move it away, or name another"):
        written(path)
    assert path.read_bytes() == b"a letter to my mother " * 100


def test_another_programs_database_is_left_alone(path):
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE mine (x)")
    other.close()
    with pytest.raises(JournalError, match=r"is another program's database: name another --journal"):
        written(path)
    assert on_disk(path, "SELECT name FROM sqlite_master") == ["mine"]


def test_a_newer_journal_is_refused_with_both_versions(path):
    written(path)
    newer = sqlite3.connect(path)
    newer.execute(f"PRAGMA user_version = {SCHEMA_VERSION + 1}")
    newer.close()
    with pytest.raises(JournalError, match=rf"version {SCHEMA_VERSION + 1}, this one reads {SCHEMA_VERSION}"):
        written(path)


def test_a_directory_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(
        JournalError, match=r"file/j.sqlite cannot be made: .*; name a --journal that this user"
    ):
        written(tmp_path / "file" / "j.sqlite")


def test_a_directory_in_its_place_is_named(path):
    path.mkdir()
    with pytest.raises(JournalError, match="cannot be opened: let this user read and write it"):
        written(path)


@pytest.mark.parametrize("suffix", ["-wal", ".lock"])
def test_a_file_beside_it_that_another_user_has_left_is_named(path, monkeypatch, suffix):
    """The journal was named, whose rights were right: a restart as root had left its lock."""
    with SqliteJournal(path):
        pass
    left = path.with_name(path.name + suffix)
    left.unlink(missing_ok=True)
    left.mkdir()  # so that SQLite cannot open it, also where root runs this
    monkeypatch.setattr(os, "geteuid", lambda: left.stat().st_uid + 1)
    monkeypatch.setattr(os, "access", lambda asked, _mode: asked != left)
    named = f"cannot be opened: let this user read and write {left.name}, or"
    with pytest.raises(JournalError, match=re.escape(named)), SqliteJournal(path):
        pass


def test_a_journal_has_one_service(path):
    with SqliteJournal(path), pytest.raises(JournalError, match="in use by another process"):
        written(path)
    written(path)


def test_a_process_that_only_looks_may_beside_it(path):
    with SqliteJournal(path) as journal:
        journal.append(record(0), now=True)
        with SqliteJournal(path, alone=False) as looking:
            assert len(list(looking.replay(STATION, NAME))) == 1


def test_a_journal_that_has_become_read_only_says_so(path):
    with SqliteJournal(path) as journal:
        journal._database.execute("PRAGMA query_only = ON")
        with pytest.raises(JournalError, match=r"cannot be written: let this user write it, or name another"):
            journal.append(record(0), now=True)
        journal._database.execute("PRAGMA query_only = OFF")


def test_a_lock_that_is_none_is_named_and_not_the_journal(path):
    """`is no journal: move it away` was the advice for a journal that was whole."""
    with SqliteJournal(path):
        pass
    path.with_name(f"{path.name}.lock").write_text("rubbish" * 1000)
    with (
        pytest.raises(JournalError, match=r"caesura-1\.sqlite\.lock is no lock: remove it"),
        SqliteJournal(path),
    ):
        pass


@pytest.mark.parametrize("name", ["SQLITE_IOERR_WRITE", "SQLITE_READONLY"])
def test_a_disk_that_the_system_made_read_only_is_named_also_where_it_is_listed_as_writable(
    path, monkeypatch, name
):
    """As ext4 after an error: `let this user write it` was advised, or to free some room."""

    def refuse(**_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(sqlite_errors.tempfile, "TemporaryFile", refuse)
    error = sqlite3.OperationalError("refused")
    error.sqlite_errorname = name
    with pytest.raises(JournalError, match="its disk is read-only: mount it for"), map_sqlite_errors(path):
        raise error


@pytest.mark.parametrize("removed", ["j.sqlite", "j.sqlite-wal"])
def test_a_journal_whose_file_was_removed_acknowledges_nothing_more(tmp_path, removed):
    """The file that is gone could still be written, and its records were lost at the end of the process."""
    path, aside = tmp_path / removed, tmp_path / "aside"
    with SqliteJournal(tmp_path / "j.sqlite") as journal:
        journal.append(record(0), now=True)
        path.rename(aside)
        with pytest.raises(JournalError, match=f"{removed} was removed or replaced .* restart the service"):
            journal.append(record(1), now=True)
        assert journal.report().trouble
        shutil.copy(aside, path)  # another file of that name
        with pytest.raises(JournalError, match="removed or replaced"):
            journal.append(record(1), now=True)
        aside.replace(path)
        journal.commit()
        journal.append(record(1), now=True)
    with SqliteJournal(tmp_path / "j.sqlite") as again:
        assert len(list(again.replay(STATION, NAME))) == 2


def test_a_journal_whose_directory_was_removed_says_so(tmp_path):
    directory = tmp_path / "journal"
    removed = pytest.raises(JournalError, match="was removed or replaced")
    with removed, SqliteJournal(directory / "j.sqlite") as journal:
        journal.append(record(0), now=True)
        shutil.rmtree(directory)
        journal.append(record(1), now=True)

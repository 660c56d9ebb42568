"""Records, files and full disks of journals under test."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from caesura_service.journal import JournalSettings, Record, SqliteJournal
from harness.sessions import NAME, STATION, batch

NEVER = JournalSettings(commit_s=3600.0)  # but at `flush`


def record(seq: int, session: str = NAME) -> Record:
    return Record(STATION, session, float(seq), batch(seq, session))


def written(path: Path) -> None:
    with SqliteJournal(path):
        pass


def on_disk(path: Path, query: str = "SELECT seq FROM records ORDER BY place") -> list:
    """What another process sees."""
    reader = sqlite3.connect(path)
    try:
        return [row[0] for row in reader.execute(query)]
    finally:
        reader.close()


def killed(path: Path, to: Path) -> Path:
    """The files as a process leaves them that is killed now."""
    to.mkdir()
    for part in path.parent.glob(path.name + "*"):
        (to / part.name).write_bytes(part.read_bytes())
    return to / path.name


def grow_no_more(journal: SqliteJournal) -> None:
    """A full disk, as SQLite says it: SQLITE_FULL."""
    (pages,) = journal._database.execute("PRAGMA page_count").fetchone()
    journal._database.execute(f"PRAGMA max_page_count = {pages}")


def grow_again(journal: SqliteJournal) -> None:
    journal._database.execute("PRAGMA max_page_count = 1000000")

"""Counts the frames that SQLite silently drops from a damaged write-ahead log.

SQLite reads a log up to the first frame with a wrong checksum, and treats that as the end. So a flipped bit
hides every later commit. The later frames are still in the file, with the log's salts. Format:
https://www.sqlite.org/fileformat2.html#walformat
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

_HEADER = struct.Struct(">8I")  # magic, version, page size, number, two salts, two checksums
_FRAME = struct.Struct(">6I")  # page, pages after a commit or 0, two salts, two checksums
_MASK = 0xFFFFFFFF


def log_of(path: Path) -> Path:
    """Return the path of a database's write-ahead log."""
    return path.with_name(path.name + "-wal")


def files_beside(path: Path) -> tuple[Path, Path]:
    """Return the files that SQLite keeps beside a database: its log, and the shared memory of processes."""
    return log_of(path), path.with_name(path.name + "-shm")


def lock_file_of(path: Path) -> Path:
    """Return the file beside a journal that its process locks."""
    return path.with_name(f"{path.name}.lock")


def log_integrity_error(path: Path) -> str | None:
    """Return text on the frames of a journal's log that SQLite skips, and keep a copy of the log.

    None if it skips none. Call it before anything is written.
    """
    log = log_of(path)
    if not log.exists() or log.stat().st_size < _HEADER.size + _FRAME.size:
        return None
    written = max(_commits(log), default=0)
    whole = _has_whole_header(log)
    try:
        with closing(sqlite3.connect(path, isolation_level=None)) as database:
            keep = log.with_name(f"{path.name}.damaged-log")
            database.execute("SELECT count(*) FROM sqlite_master").fetchone()
            _, read, _ = database.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
            if whole and read >= written:
                return None
            shutil.copy(log, keep)
    except sqlite3.Error:
        return None  # opening the journal fails with the same error
    return f"{read} of {written or 'its'} frames of its log can be read; the log is kept as {keep.name}"


def _commits(log: Path) -> Iterator[int]:
    """Yield the numbers of the frames that end a commit, readable or not."""
    with log.open("rb") as file:
        _, _, page_size, _, *salts, _, _ = _HEADER.unpack(file.read(_HEADER.size))
        number = 0
        while len(frame := file.read(_FRAME.size)) == _FRAME.size:
            number += 1
            _, pages, *found, _, _ = _FRAME.unpack(frame)
            if len(file.read(page_size)) == page_size and pages and found == salts:
                yield number


def _has_whole_header(log: Path) -> bool:
    with log.open("rb") as file:
        content = file.read(_HEADER.size)
    order = ">" if content[3] & 1 else "<"
    first = second = 0
    words = struct.unpack(f"{order}6I", content[:24])
    for one, other in zip(words[::2], words[1::2], strict=True):
        first = (first + one + second) & _MASK
        second = (second + other + first) & _MASK
    return (first, second) == _HEADER.unpack(content)[6:]

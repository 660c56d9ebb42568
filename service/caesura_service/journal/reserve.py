"""Room on the journal's disk that is kept for deletions, which a full disk leaves none for.

A deletion is written to SQLite's log before it frees a page of the file. On a disk without a byte of room
it fails as every other write does, and what an operator deletes makes no room. So a file beside the journal
keeps some, and is removed where a deletion finds the disk full. It is made again once there is room for many.
To open a journal takes some room too, for SQLite's index of its log: a small part of the same file.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import time
from contextlib import suppress
from pathlib import Path
from typing import TypeGuard

from caesura_service.journal.journal import JournalError

SUFFIX = ".reserve"
# [bytes] twice SQLite's log: what it has yet to move into the file, and a portion of a deletion
SIZE = 8 << 20
SHARE = 16  # part of what is free, at most, that a reserve may be
OPENING = 256 << 10  # [bytes] of it that are given back to open a journal
LOOK_S = 10.0  # between two looks whether there is room for one
_FULL = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE}  # the latter: none for the index of the log


def is_disk_full(error: BaseException | None) -> TypeGuard[BaseException]:
    """Return whether an error comes from a disk without room."""
    cause = None if error is None else error.__cause__
    return getattr(cause, "sqlite_errorcode", None) in _FULL


class Reserve:
    """The file that keeps room for the deletions of one journal."""

    def __init__(self, journal: Path) -> None:
        self._path = journal.with_name(journal.name + SUFFIX)
        self._looks_at = 0.0  # [s]

    def keep(self) -> None:
        """Make the file where it is missing and the disk has room for it. Cheap to call often."""
        if time.monotonic() < self._looks_at:
            return
        self._looks_at = time.monotonic() + LOOK_S
        with suppress(OSError):
            if self._path.exists() or shutil.disk_usage(self._path.parent).free < SHARE * SIZE:
                return
            descriptor = os.open(self._path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, SIZE)
            except OSError:
                self._path.unlink()
            finally:
                os.close(descriptor)

    def release(self, error: JournalError) -> bool:
        """Return whether this is the error of a full disk that had a reserve, which is given back."""
        if not is_disk_full(error):
            return False
        try:
            self._path.unlink()
        except OSError:
            return False
        self._looks_at = time.monotonic() + LOOK_S
        return True

    def lend(self, error: JournalError) -> bool:
        """Return whether this is the error of a full disk, for which the end of a reserve is given back."""
        if not is_disk_full(error):
            return False
        try:
            os.truncate(self._path, max(self._path.stat().st_size - OPENING, 0))
        except OSError:
            return False
        return True

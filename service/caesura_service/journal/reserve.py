"""Reserves space on the journal's disk, so that deletions are possible on a full disk.

A deletion is written to SQLite's log before it frees a page of the file. On a full disk it would fail like
any other write, and an operator could free no space. So a file beside the journal reserves space, and is
removed when a deletion finds the disk full. It is created again once there is enough space. Without the file,
the last SIZE bytes of the disk are used for deletions alone. Opening a journal needs space too, for SQLite's
index of its log: a small part of the same file.
"""

from __future__ import annotations

import errno
import logging
import os
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from caesura_service.journal.journal import JournalError, JournalFullError

logger = logging.getLogger(__name__)

SUFFIX = ".reserve"
# [bytes] twice SQLite's log: what it has yet to move into the file, and a portion of a deletion
SIZE = 8 << 20
SHARE = 16  # part of what is free, at most, that a reserve may be
OPENING = 256 << 10  # [bytes] of it that are given back to open a journal
LOOK_S = 10.0  # between two looks whether there is room for one


class Reserve:
    """The file that reserves space for the deletions of one journal."""

    def __init__(self, journal: Path) -> None:
        self._path = journal.with_name(journal.name + SUFFIX)
        self._looks_at = 0.0  # [s]
        self._said: str | None = None  # the last reason why there is none
        self._is_filled = False  # has what lacked blocks been given them? Some disks compress

    def keep(self) -> None:
        """Create or extend the file if it is missing or too small, and the disk has enough space.

        Cheap to call often. It is too small after `lend`, after its creator was killed, or after it was
        copied as a sparse file.
        """
        if time.monotonic() < self._looks_at:
            return
        self._looks_at = time.monotonic() + LOOK_S
        try:
            if self._is_whole() or shutil.disk_usage(self._path.parent).free < SHARE * SIZE:
                return
            with self._opened(os.O_CREAT | os.O_WRONLY) as descriptor:
                os.posix_fallocate(descriptor, 0, SIZE)
            self._is_filled = True
        except OSError as error:
            self._say(error)

    def release(self, error: JournalError) -> bool:
        """Return whether the error is that of a full disk and a reserve existed, which is then removed."""
        if not isinstance(error, JournalFullError):
            return False
        try:
            self._path.unlink()
        except OSError:
            return False
        self._looks_at = time.monotonic() + LOOK_S
        return True

    def is_spent(self) -> bool:
        """Return whether there is no reserve, and the disk has no more space than one needs."""
        try:
            return shutil.disk_usage(self._path.parent).free < SIZE and not self._path.exists()
        except OSError:
            return False

    def lend(self, error: JournalError) -> bool:
        """Return whether the error is that of a full disk and the end of a reserve was freed."""
        if not isinstance(error, JournalFullError):
            return False
        try:
            with self._opened(os.O_WRONLY) as descriptor:
                if not (size := os.fstat(descriptor).st_size):
                    return False
                os.ftruncate(descriptor, max(size - OPENING, 0))
        except OSError:
            return False
        return True

    def _is_whole(self) -> bool:
        try:
            found = self._path.lstat()
        except FileNotFoundError:
            return False
        return found.st_size >= SIZE and (self._is_filled or found.st_blocks * 512 >= SIZE)

    @contextmanager
    def _opened(self, flags: int) -> Iterator[int]:
        """Open the file. Raises OSError for anything but a regular file of this journal, such as a link."""
        descriptor = os.open(self._path, flags | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
                raise OSError(errno.EEXIST, "is no file of its own")
            yield descriptor
        finally:
            os.close(descriptor)

    def _say(self, error: OSError) -> None:
        if self._said != error.strerror:
            self._said = error.strerror
            logger.warning(
                "reserve %s cannot be made (%s): on a full disk deletions make no room; remove what is there",
                self._path,
                error.strerror,
            )

"""Checks that an open journal is still the file at its path.

A process can write to an open file that was removed or replaced, and its content is lost at the end. So
acknowledged records would be lost silently.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from caesura_service.journal.journal import JournalError
from caesura_service.journal.wal_integrity import log_of


class JournalFileIdentity:
    """Device and inode of a journal's file and log when they were opened."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._known: dict[Path, tuple[int, int]] = {}  # device and number of the files that are there

    def remember(self) -> None:
        """Store the identity of the files that exist now."""
        for path in (self._journal, log_of(self._journal)):
            with suppress(OSError):
                self._known[path] = _identity(path)

    def check(self) -> None:
        """Raise JournalError if a file was removed or replaced. Cheap to call often."""
        for path, known in self._known.items():
            try:
                is_same = _identity(path) == known
            except (FileNotFoundError, NotADirectoryError):
                is_same = False
            except OSError:
                continue  # unknown
            if not is_same:
                raise JournalError(
                    f"journal {self._journal}: {path.name} was removed or replaced while it is in use, and "
                    "what is written is lost at the end: restart the service within two minutes"
                )


def _identity(path: Path) -> tuple[int, int]:
    found = os.stat(path)
    return found.st_dev, found.st_ino

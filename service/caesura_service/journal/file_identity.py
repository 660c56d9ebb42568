"""The check that an open journal is still the file of its name.

A file that is removed or replaced can be written for as long as it is open, and nothing of it is there
afterwards: what is acknowledged meanwhile would be lost without a word.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from caesura_service.journal.journal import JournalError
from caesura_service.journal.wal import log_of


class JournalFileIdentity:
    """The files of one journal, as of its opening."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal
        self._known: dict[Path, tuple[int, int]] = {}  # device and number of the files that are there

    def remember(self) -> None:
        """Take the present files for those of the journal."""
        for path in (self._journal, log_of(self._journal)):
            with suppress(OSError):
                self._known[path] = _identity(path)

    def check(self) -> None:
        """Raise JournalError where a file is no longer there, or is another one. Cheap to call often."""
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

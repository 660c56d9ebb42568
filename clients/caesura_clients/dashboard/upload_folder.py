"""The folder of uploaded recordings: created for the first of them, and deleted at the end.

A process holds a lock on its folder, which the operating system releases when the process ends. So a folder
without a lock belonged to a killed process, and the next dashboard deletes it.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from contextlib import suppress
from pathlib import Path

PREFIX = "caesura-recordings-"


class UploadFolder:
    """A temporary folder of this process, created at the first use of `path`."""

    def __init__(self) -> None:
        self._making = threading.Lock()
        self._path: Path | None = None
        self._lock: int | None = None

    @property
    def path(self) -> Path:
        """The path of the folder."""
        with self._making:
            if self._path is None:
                made = Path(tempfile.mkdtemp(prefix=f".{PREFIX}"))  # locked before others look for its name
                with suppress(OSError, ImportError):  # a file system or a platform without such locks
                    self._lock = _locked(made)
                self._path = made.rename(made.with_name(made.name[1:]))
            return self._path

    def remove(self) -> None:
        """Delete the folder with its content, if it was created."""
        if self._path is not None:
            shutil.rmtree(self._path, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def remove_abandoned() -> None:
    """Delete the folders of dashboards that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError, ImportError):  # the lock is held, or the folder is another user's
            lock = _locked(folder)
            shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)


def _locked(folder: Path) -> int:
    """Lock a folder and return the lock's file descriptor. Raises OSError if another process holds it."""
    import fcntl  # noqa: PLC0415 - not on Windows

    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor

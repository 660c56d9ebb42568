"""Errors of SQLite and the disk as errors of the journal, each with the file and a remedy."""

from __future__ import annotations

import errno
import os
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from caesura_service.journal.journal import (
    JournalBusyError,
    JournalError,
    JournalForeignError,
    JournalFullError,
    JournalMalformedError,
    JournalUnreadableError,
)
from caesura_service.journal.wal_integrity import files_beside, lock_file_of

PROBE = 64 << 10  # [bytes] that a disk with room takes
TOO_MANY_FILES = frozenset({errno.EMFILE, errno.ENFILE})
RAISE_LIMIT = "too many files are open: raise the limit (ulimit -n, LimitNOFILE), or end what has them open"
# What SQLite calls it, or a quota → what it means, and what to do.
REMEDIES: Mapping[str, str] = {
    "SQLITE_FULL": "cannot be written, there is no room left: free some, or name another --journal",
    "QUOTA_FULL": "cannot be written, this user's quota is used up: free some, or name another --journal",
    "SQLITE_READONLY": "cannot be written: let this user write it, or name another --journal",
    "SQLITE_CANTOPEN": "cannot be opened: let this user read and write it, or name another --journal",
    "SQLITE_PERM": "cannot be opened: let this user read and write it, or name another --journal",
    "SQLITE_BUSY": "is in use by another process: end that one, or name another --instance or --journal",
    "SQLITE_NOTADB": "is no journal: move it away, or name another --journal",
    "SQLITE_CORRUPT": "is damaged, or its disk fails: look after the disk and start the service again",
    "SQLITE_IOERR_SHMSIZE": "cannot be opened, there is no room left: free some, or name another --journal",
    "TOO_MANY_FILES": f"cannot be opened, {RAISE_LIMIT}",
    "SQLITE_IOERR_READ": "cannot be read, the disk fails: look after it",
    "SQLITE_IOERR": "cannot be read or written, the disk fails or is full: free some room, or look after it",
}
KINDS = {
    "SQLITE_FULL": JournalFullError,
    "QUOTA_FULL": JournalFullError,
    "SQLITE_IOERR_SHMSIZE": JournalFullError,
    "SQLITE_BUSY": JournalBusyError,
    "SQLITE_CORRUPT": JournalMalformedError,
    "SQLITE_IOERR_READ": JournalUnreadableError,
    "SQLITE_NOTADB": JournalForeignError,
}


LACKS_OF_ROOM: Mapping[int, str] = {errno.ENOSPC: "SQLITE_FULL", errno.EDQUOT: "QUOTA_FULL"}
UNDECODABLE = "Could not decode to UTF-8"  # a flipped bit makes a blob a text
UNEXPLAINED = frozenset({"SQLITE_CANTOPEN", "SQLITE_READONLY", "SQLITE_IOERR"})


@contextmanager
def map_sqlite_errors(path: Path) -> Iterator[None]:
    """Raise SQLite's errors as a JournalError that names the file and the remedy."""
    try:
        yield
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:  # the last: a message about damage, damaged
        name = getattr(error, "sqlite_errorname", "")
        if name not in REMEDIES:
            name = "_".join(name.split("_")[:2])
        if str(error).startswith(UNDECODABLE):  # Python's, without a name
            name = "SQLITE_CORRUPT"
        elif not isinstance(error, sqlite3.Error):
            name = _name_of(error) if isinstance(error, OSError) else "SQLITE_CORRUPT"
        refusal = _refused_write(path) if name in UNEXPLAINED else 0
        if name == "SQLITE_IOERR":
            name = LACKS_OF_ROOM.get(refusal, name)
        remedy = (
            _remedy_of_disk(path, name, refusal)
            or _remedy_of_neighbour(path, name)
            or REMEDIES.get(name, "cannot be used")
        )
        kind = KINDS.get(name, JournalError)
        raise kind(f"journal {path} {remedy} ({error})") from error


def _name_of(error: OSError) -> str:
    """Return SQLite's name for an error of the operating system."""
    if error.errno in TOO_MANY_FILES:
        return "TOO_MANY_FILES"
    return "SQLITE_PERM" if isinstance(error, PermissionError) else "SQLITE_IOERR"


def _refused_write(path: Path) -> int:
    """Return the error number with which the disk refuses a further file, or 0.

    SQLite has no name for a full quota, and the system may list a disk as writable that it made read-only.
    """
    try:
        with tempfile.TemporaryFile(dir=path.parent, buffering=0) as probe:
            probe.write(bytes(PROBE))
            os.fsync(probe.fileno())
    except OSError as error:
        return error.errno or 0
    return 0


def _remedy_of_disk(path: Path, name: str, refusal: int) -> str | None:
    """Return the remedy from the disk's own error if SQLite only reports that it cannot open or write the
    file. refusal: as of `_refused_write`.
    """
    if name not in UNEXPLAINED:
        return None
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        if error.errno in TOO_MANY_FILES:
            return REMEDIES["TOO_MANY_FILES"]
    try:
        disk = os.statvfs(path.parent)
    except OSError:
        return None
    if refusal == errno.EROFS:
        return "cannot be written, its disk is read-only: mount it for writing, or name another --journal"
    if disk.f_files and not disk.f_favail:
        return "cannot be opened, its disk holds no further file: delete some, or name another --journal"
    return None


def _remedy_of_neighbour(path: Path, name: str) -> str | None:
    """Return a remedy that names a file beside the journal with another owner, such as root.

    None without one.
    """
    for beside in (*files_beside(path), lock_file_of(path)) if name in UNEXPLAINED else ():
        with suppress(OSError):  # a disk that fails allows nothing, and is no matter of users
            if beside.stat().st_uid != os.geteuid() and not os.access(beside, os.R_OK | os.W_OK):
                found = "cannot be opened: let this user read and write"
                return f"{found} {beside.name}, or name another --journal"
    return None


def again(error: JournalError) -> JournalError:
    """Return a copy of an error to raise again: one object would keep every frame that it passed."""
    once_more = type(error)(*error.args)
    once_more.__cause__ = error.__cause__
    return once_more

"""Writes a recording as a file, by its suffix. Reading it again returns the same, bit for bit."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from caesura_protocol.errors import CaesuraError
from caesura_protocol.recording import Recording


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces the file only once it is complete.

    It is the path itself for a link or a device, such as /dev/stdout.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        yield path
        return
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_csv(path: Path, recording: Recording) -> None:
    """Write one column per component, options in leading comments; numbers in the shortest exact form."""
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        for key, value in recording.file_statements.items():
            stream.write(f"# {key}: {value}\n")
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(recording.columns)
        rows.writerows([map(repr, row) for row in recording.matrix().tolist()])


def write_npz(path: Path, recording: Recording) -> None:
    """Write one array per signal."""
    with whole_file(path) as part:
        recording.save(part)


WRITERS: Mapping[str, Callable[[Path, Recording], None]] = {".npz": write_npz, ".csv": write_csv}


def check_not_read(path: Path, read: Iterable[Path]) -> None:
    """Raise CaesuraError if writing a file would replace one of those from which it is made."""
    if path.exists() and any(one.exists() and path.samefile(one) for one in read):
        raise CaesuraError(f"cannot write {path}: it is the file that is read; name another file")


def check_new(path: Path) -> None:
    """Raise CaesuraError if there is such a file already; a device such as /dev/stdout is none."""
    if path.is_file():
        raise CaesuraError(f"cannot write {path}: it exists; name another file, or move it away")


def check_writable(path: Path, *others: str) -> None:
    """Raise CaesuraError for a suffix without a writer or a path without write permission.

    others: suffixes that have a writer elsewhere.
    """
    known = (*WRITERS, *others)
    if path.suffix not in known:
        raise CaesuraError(f"cannot write {path}: suffix {path.suffix!r}, expected one of {', '.join(known)}")
    directory = path.resolve().parent
    if not directory.is_dir():
        raise CaesuraError(f"cannot write {path}: no such directory")
    if path.is_dir():
        raise CaesuraError(f"cannot write {path}: it is a directory")
    if not os.access(path if path.exists() else directory, os.W_OK):
        raise CaesuraError(f"cannot write {path}: permission denied")

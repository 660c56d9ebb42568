"""Append-only bytes: the last block in memory, earlier ones in a file, in blocks of equal size.

Each process has one file, without a name, which the operating system deletes with the process. A block's
space is reused once no object refers to it. A block that cannot be written stays in memory, and is retried
one block later. Any thread may read while another one appends.
"""

from __future__ import annotations

import itertools
import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

logger = logging.getLogger(__name__)

BLOCK = 1 << 15  # [bytes]
UNREADABLE = (
    "the file beside the journal with the session's observations cannot be read: check the disk and restart "
    "the service, which rebuilds the session from the journal"
)


class OverflowFile:
    """A file of blocks, created with the first one."""

    def __init__(self, directory: Path | None = None, *, block: int = BLOCK) -> None:
        """directory: instead of the system's for temporary files. block: size [bytes]."""
        self.directory, self.block = directory, block
        self._file: _File | None = None

    def put(self, data: bytes) -> FileBlock:
        """Write a whole block into the file. Raises OSError where it cannot be written."""
        if self._file is None or self._file.process != os.getpid():
            self._file = _File(tempfile.TemporaryFile(buffering=0, dir=self.directory), self.block)  # noqa: SIM115
        return self._file.put(data)

    @property
    def size(self) -> int:
        """The size [bytes] of the file."""
        return 0 if self._file is None else os.fstat(self._file.number).st_size

    @contextmanager
    def within(self, directory: Path | None) -> Iterator[None]:
        """Make a new file in a directory while the context lasts."""
        before, self.directory = self.directory, directory
        try:
            yield
        finally:
            self.directory = before


class FileBlock:
    """A part of a file; its space is free again with the last reference to it."""

    __slots__ = ("_file", "_place")

    def __init__(self, file: _File, place: int) -> None:
        self._file, self._place = file, place

    def __del__(self) -> None:
        self._file.free.append(self._place)

    def read(self, start: int, stop: int) -> bytes:
        """Return the bytes from start to stop of the block, the stop not included. Raises OSError."""
        why = "the end of the file is missing"
        try:
            data = os.pread(self._file.number, stop - start, self._place + start)
        except OSError as error:
            data, why = b"", str(error)
        if len(data) < stop - start:
            raise OSError(f"{UNREADABLE} ({why})")
        return data


class _File:
    """An open file of blocks, with its free places.

    It needs no lock: a list gives an item to one thread only, and so does a count a number.
    """

    def __init__(self, file: BinaryIO, block: int) -> None:
        self._file = file  # closed after its last block
        self.number, self.process = file.fileno(), os.getpid()
        self.free: list[int] = []
        self._beyond = itertools.count(0, block)

    def __del__(self) -> None:
        self._file.close()

    def put(self, data: bytes) -> FileBlock:
        try:
            place = self.free.pop()
        except IndexError:
            place = next(self._beyond)
        block = FileBlock(self, place)
        if (written := os.pwrite(self.number, data, place)) < len(data):
            raise OSError(f"the disk is full: {written} of {len(data)} bytes were written")
        return block


SPOOL = OverflowFile()


class AppendLog:
    """Append-only bytes; at most two blocks of them in memory."""

    def __init__(self, spool: OverflowFile = SPOOL) -> None:
        self._spool = spool
        self._blocks: list[FileBlock] = []
        self._tail = 0, bytearray()  # the place of its first byte, and all that is in no block
        self._full = 2 * spool.block  # at which one is written

    def __len__(self) -> int:
        first, tail = self._tail
        return first + len(tail)

    def append(self, data: bytes) -> None:
        """Append bytes."""
        tail = self._tail[1]
        tail += data
        if len(tail) >= self._full:
            self._write()

    def read(self, start: int, stop: int) -> bytes:
        """Return the bytes from start to stop, the stop not included."""
        first, tail = self._tail  # as one: a block is listed before it leaves the tail
        if start >= first:
            return bytes(tail[start - first : stop - first])
        size, until = self._spool.block, min(stop, first)
        parts = [
            self._blocks[number].read(max(start - number * size, 0), min(until - number * size, size))
            for number in range(start // size, -(-until // size))
        ]
        return b"".join([*parts, tail[: stop - until]])

    def _write(self) -> None:
        """Write all blocks except the last one to the file; on an error they stay in memory."""
        (first, tail), size = self._tail, self._spool.block
        whole = (len(tail) // size - 1) * size
        try:
            self._blocks += [self._spool.put(bytes(tail[at : at + size])) for at in range(0, whole, size)]
        except OSError as error:
            if self._full == 2 * size:
                logger.warning(
                    "observations of sessions stay in memory, the overflow file cannot be written: %s", error
                )
            self._full = len(tail) + size
        else:
            self._tail, self._full = (first + whole, tail[whole:]), 2 * size

"""What a log keeps reads as it was appended, wherever it lies; memory holds only the end of it."""

from __future__ import annotations

import logging
import multiprocessing
import resource
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_service.segmentation.overflow_file import BLOCK, AppendLog, OverflowFile

SMALL = 8  # [bytes] a block


def filled(spool: OverflowFile, blocks: int, first: int = 0) -> tuple[AppendLog, bytes]:
    """A log of so many blocks and a bit, none like another, and what is in it."""
    data = b"".join((first + i).to_bytes(spool.block, "big") for i in range(blocks)) + b"end"
    log = AppendLog(spool)
    for at in range(0, len(data), 5):
        log.append(data[at : at + 5])
    return log, data


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """As on a disk that is full: this process writes no file beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@given(st.lists(st.binary(max_size=5 * SMALL), max_size=12), st.integers(0, 99), st.integers(0, 99))
def test_every_part_reads_as_it_was_appended(parts: list[bytes], start: int, count: int) -> None:
    log = AppendLog(OverflowFile(block=SMALL))
    for part in parts:
        log.append(part)
    data = b"".join(parts)
    assert len(log) == len(data)
    assert log.read(0, len(data)) == data
    assert log.read(min(start, len(data)), min(start + count, len(data))) == data[start : start + count]


def test_memory_holds_the_last_two_blocks_at_most() -> None:
    log, piece = AppendLog(OverflowFile()), bytes(1000)
    tracemalloc.start()
    try:
        for _ in range(100 * BLOCK // len(piece)):
            log.append(piece)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 3 * BLOCK


def test_a_short_log_makes_no_file() -> None:
    spool = OverflowFile(block=SMALL)
    filled(spool, 1)
    assert spool.size == 0


def test_room_is_used_again() -> None:
    spool = OverflowFile(block=SMALL)
    stays, data = filled(spool, 20)
    for first in range(100, 1000, 100):
        log, other = filled(spool, 20, first)
        assert log.read(0, len(other)) == other
        del log
    assert spool.size < 2 * len(data)
    assert stays.read(0, len(data)) == data


def test_what_no_file_takes_stays_in_memory_until_one_does(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    spool = OverflowFile(tmp_path / "missing", block=SMALL)
    with caplog.at_level(logging.WARNING):
        log, data = filled(spool, 20)
    assert len(caplog.records) == 1
    assert "missing" in caplog.text
    assert log.read(0, len(data)) == data
    spool.directory = tmp_path
    for _ in range(SMALL):
        log.append(b"more")
    assert spool.size >= len(data) - 2 * SMALL
    assert log.read(0, len(log)) == data + SMALL * b"more"


def test_nothing_is_lost_on_a_full_disk() -> None:
    spool = OverflowFile(block=SMALL)
    _before, _ = filled(spool, 3)
    with files_of_at_most(spool.size + SMALL + SMALL // 2):  # the second further block is written in part
        log, data = filled(spool, 20)
        assert log.read(0, len(data)) == data
    log.append(bytes(2 * SMALL))
    assert log.read(0, len(log)) == data + bytes(2 * SMALL)
    assert spool.size >= len(data)


def test_another_thread_reads_while_it_grows() -> None:
    log, over, wrong = AppendLog(OverflowFile(block=SMALL)), threading.Event(), list[int]()

    def read() -> None:
        while not over.is_set():
            count = len(log) // SMALL
            numbers = [log.read(i * SMALL, (i + 1) * SMALL) for i in range(max(count - 9, 0), count)]
            wrong.extend(i for i, n in enumerate(numbers, max(count - 9, 0)) if int.from_bytes(n, "big") != i)

    reader = threading.Thread(target=read)
    reader.start()
    for i in range(5000):
        log.append(i.to_bytes(SMALL, "big"))
    over.set()
    reader.join()
    assert not wrong


def _fill_later(spool: OverflowFile, now: Event) -> None:
    now.wait()
    filled(spool, 20, first=1000)


def test_a_forked_process_overwrites_nothing() -> None:
    spool, context = OverflowFile(block=SMALL), multiprocessing.get_context("fork")
    before, data = filled(spool, 20)
    now = context.Event()
    child = context.Process(target=_fill_later, args=(spool, now))
    child.start()
    after, other = filled(spool, 20, first=500)
    now.set()
    child.join()
    assert child.exitcode == 0
    assert before.read(0, len(data)) == data
    assert after.read(0, len(other)) == other


@pytest.mark.parametrize("found", [OSError(5, "Input/output error"), b"short"])
def test_what_cannot_be_read_back_is_named_with_what_to_do(found, monkeypatch) -> None:
    """A part of it was taken for all: `unpack requires a buffer of 256 bytes`."""
    log, data = filled(OverflowFile(block=SMALL), blocks=4)

    def read(*_: object) -> bytes:
        if isinstance(found, OSError):
            raise found
        return found

    with monkeypatch.context() as patch:
        patch.setattr("os.pread", read)
        with pytest.raises(
            OSError, match=r"the session's observations cannot be read.*rebuilds the session from the journal"
        ):
            log.read(0, len(data))
    assert log.read(0, len(data)) == data

"""What the journal costs a batch: appending it, and taking it with everything that a session does.

Journals take turns over the same batches in this process, the real models behind the session. Prints µs a
batch, the share of a batch's time at 50 batches a second, the ratio to a journal in memory, and how long an
acknowledgement waits for the disk. Usage: python tests/bench/journal_cost.py [DIRECTORY]
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from caesura_protocol.codec import pack_samples
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Open, SampleBatch
from caesura_protocol.recording import Recording
from caesura_service.journal import Journal, JournalSettings, MemoryJournal, Record, SqliteJournal
from caesura_service.offline_segmentation import BATCH_SAMPLES, opening_of
from caesura_service.publishing.events import Owner
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session

RECORDING = Path(__file__).resolve().parents[2] / "data" / "pick_and_place.npz"
BATCHES_PER_S = 50.0
STATION = "bench"


class NoJournal(MemoryJournal):
    """Keeps nothing."""

    def append(self, record: Record, *, now: bool = False) -> None:
        pass


def main() -> None:
    """Measure every journal."""
    table = Table("journal", "append [µs]", "batch [µs]", "p99 [µs]", "share", "ratio", "ack [ms]")
    with ExitStack() as stack:
        parent = sys.argv[1] if len(sys.argv) > 1 else None
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=parent)))
        at_once = JournalSettings(commit_s=0.0)
        journals: dict[str, Journal] = {
            "none": NoJournal(),
            "memory": MemoryJournal(),
            "50 ms": stack.enter_context(SqliteJournal(directory / "group.sqlite")),
            "at once": stack.enter_context(SqliteJournal(directory / "once.sqlite", at_once)),
        }
        appends = {name: statistics.median(appended(journal)) for name, journal in journals.items()}
        batches = taken(journals)
        base = statistics.median(batches["memory"])
        for name, journal in journals.items():
            batch = statistics.median(batches[name])
            table.add_row(
                name,
                f"{appends[name]:.1f}",
                f"{batch:.0f}",
                f"{np.quantile(batches[name], 0.99):.0f}",
                f"{batch * BATCHES_PER_S / 1e4:.1f} %",
                f"{batch / base:.2f}",
                f"{statistics.median(acknowledged(journal)) / 1e3:.2f}",
            )
    Console().print(table)


def appended(journal: Journal) -> Iterator[float]:
    """µs of each append, at the pace of a bridge: a burst would measure the queue, not the append."""
    for batch in batches_of(load_recording(RECORDING), "append"):
        time.sleep(0.001)
        record = Record(STATION, "append", 0.0, batch)
        yield microseconds(lambda record=record: journal.append(record))


def taken(journals: dict[str, Journal]) -> dict[str, list[float]]:
    """µs of each batch in a session, the journals taking turns batch by batch."""
    recording = load_recording(RECORDING)
    opening = opening_of(recording, "default").model_copy(update={"session": "session"})
    sessions = {name: session_of(opening, journal) for name, journal in journals.items()}
    spent: dict[str, list[float]] = {name: [] for name in journals}
    order = deque(sessions.items())
    for batch in batches_of(recording, "session"):
        order.rotate()  # whoever comes first pays for a cold cache
        for name, session in order:
            spent[name].append(microseconds(lambda s=session, b=batch: s.receive(b, 0.0)))
    return spent


def acknowledged(journal: Journal) -> Iterator[float]:
    """µs of a commit with some batches waiting."""
    waiting = batches_of(load_recording(RECORDING), "ack")
    for _ in range(20):
        for _ in range(5):
            journal.append(Record(STATION, "ack", 0.0, next(waiting)))
        yield microseconds(journal.commit)


def session_of(opening: Open, journal: Journal) -> Session:
    """A session with the real models."""
    pipeline = make_pipeline(opening, "default")
    owner = Owner("bench", 1)
    session = Session(STATION, opening, pipeline, owner=owner, journal=journal, limits=Limits())
    session.begin(0.0)
    return session


def batches_of(recording: Recording, session: str) -> Iterator[SampleBatch]:
    """What a bridge would send."""
    matrix = recording.matrix()
    for seq, first in enumerate(range(0, len(matrix), BATCH_SAMPLES)):
        rows = matrix[first : first + BATCH_SAMPLES]
        yield pack_samples(rows, recording.columns, session=session, epoch=0, seq=seq)


def microseconds(call: Callable[[], object]) -> float:
    """How long a call takes [µs]."""
    before = time.perf_counter()
    call()
    return 1e6 * (time.perf_counter() - before)


if __name__ == "__main__":
    main()

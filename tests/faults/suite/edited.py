"""A service is killed while a long session with many edits is open, and started again on its journal.

An operator's work must not make a restart longer than the bridges' rings. A registry with the real models
writes two journals as fast as it goes: the same demonstration with and without edits. On each a service is
started, killed and started again, and has the results of before. Then this process restores both journals in
turn. Its processor time is compared: without the start of an interpreter it holds the session alone.

    python -m faults.suite.edited 57     # minutes; the row has 5, and this takes eight minutes
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from caesura_clients import connect
from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Ack, Close, Edit, Insert, Open, Snapshot
from caesura_service.journal import SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Owner, Reply
from caesura_service.publishing.session_state import snapshot_of
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits
from faults.suite.outcome import Row
from harness.demonstrations import taught
from harness.processes import DEADLINE_S, SESSION, ServiceProcess, reaches

STATION = "cell-1"
SECONDS = 300.0  # of the demonstration
EDITS = 40
BATCH = 20
MOST = 1.5  # times the restart without edits
STARTS = 2  # of the service, on each journal
RESTORES = 4  # of each journal, of which the fastest counts
JOURNAL = "caesura-1.sqlite"


@dataclass(frozen=True)
class Restart:
    """What it took until the service was ready, and what it had then."""

    wall_s: float
    found: Snapshot
    expected: Snapshot

    @property
    def is_equal(self) -> bool:
        """Is every result what it was before?"""
        return results(self.found) == results(self.expected)


def edited_restart(directory: Path, seconds: float = SECONDS, edits: int = EDITS) -> Row:
    """The restart with edits beside that without."""
    journals = [directory / name for name in ("plain", "edited")]
    restarts = [restarted(one, seconds, count) for one, count in zip(journals, (0, edits), strict=True)]
    times = [[restore_s(one) for one in journals] for _ in range(RESTORES)]
    without_s, with_s = (min(column) for column in zip(*times, strict=True))
    equal = all(one.is_equal for one in restarts)
    edited = restarts[1]
    samples, doubled = counts(edited.found)
    sent = len(taught(0, seconds).t)
    note = f"{seconds / 60:g} min, {edits} edits: processor time {with_s:.2f} s, {without_s:.2f} s without"
    met = equal and (samples, doubled) == (sent, 0) and with_s <= MOST * without_s
    return Row(1, sent, sent - samples + doubled, doubled, "yes" if equal else "no", edited.wall_s, note, met)


def restarted(directory: Path, seconds: float, edits: int) -> Restart:
    """A service that is killed on a journal with such a session, and its next start."""
    expected = write(directory, seconds, edits)
    service = ServiceProcess(directory)
    try:
        for _ in range(STARTS):
            began = time.monotonic()
            service.start()
            wall_s = time.monotonic() - began
            with connect(service.endpoint, timeout_s=DEADLINE_S) as caesura:
                found = reaches(caesura, STATION, 1)
            service.kill()
    finally:
        service.kill()
    return Restart(wall_s, found, expected)


def restore_s(directory: Path) -> float:
    """[s] of processor time in which a registry of this process restores the journal of that directory."""
    with SqliteJournal(directory / JOURNAL) as journal:
        registry = registry_on(journal)
        began = time.thread_time()
        registry.restore()
        taken_s = time.thread_time() - began
        assert registry.index.sessions[STATION][0].has_pipeline
    return taken_s


def registry_on(journal: SqliteJournal) -> Registry:
    """A registry with the real models."""
    return Registry(
        owner=Owner("1", 1),
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )


def write(
    directory: Path, seconds: float, edits: int, *, station: str = STATION, closes: bool = False
) -> Snapshot:
    """A session on the journal of that directory, edited at equal intervals while it goes on."""
    recording = taught(0, seconds)
    rows, columns = recording.matrix(), recording.columns
    began = time.time() - seconds  # the journal keeps nothing that is too old
    directory.mkdir(exist_ok=True)
    with SqliteJournal(directory / JOURNAL) as journal:
        registry = registry_on(journal)
        registry.handle_command(
            station, Open(session=SESSION, columns=columns, wrench_source="flange_sensor"), began
        )
        made, batches = 0, len(rows) // BATCH
        for seq in range(batches):
            batch = rows[seq * BATCH : (seq + 1) * BATCH]
            t = float(batch[-1, 0])
            now = began + t
            packed = pack_samples(batch, columns, session=SESSION, epoch=0, seq=seq)
            registry.handle_samples(station, packed, now)
            if made < edits and t > 0.9 * seconds * (made + 1) / edits:
                edit = Edit(session=SESSION, revision=made, author="Ann", action=Insert(t=0.7 * t))
                (reply,) = [
                    one.reply for one in registry.handle_command(station, edit, now) if isinstance(one, Reply)
                ]
                assert isinstance(reply, Ack), reply
                made += 1
        if closes:
            registry.handle_command(station, Close(session=SESSION, last_seq=batches - 1), began + seconds)
        (standing,) = registry.index.all_states()
        return snapshot_of(standing)


def counts(snapshot: Snapshot) -> tuple[int, int]:
    """Samples that were taken, and those of them that were taken again."""
    return snapshot.status.samples, snapshot.status.repeats


def results(snapshot: Snapshot) -> tuple[object, ...]:
    """All that it shows, except who answers and how often it has spoken."""
    status, program = snapshot.status, snapshot.program
    return (
        snapshot.segments.segments,
        snapshot.changepoints.changepoints,
        snapshot.posterior and (snapshot.posterior.starts, snapshot.posterior.probabilities),
        (program.apps, program.notes, program.version, program.author, program.edited, program.complete),
        (status.samples, status.observations, status.t, status.gaps, status.state),
        (status.revision, status.undoable, status.redoable),
    )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        row = edited_restart(Path(temporary), 60.0 * float(sys.argv[1]))
    print(row)
    sys.exit(not row.met)

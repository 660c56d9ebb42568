"""Journals written directly: hours of a session in seconds, without a service."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Close, Open, Snapshot
from caesura_service.journal import JournalSettings, Outcome, Record, SqliteJournal
from clients.examples import snapshot

COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")
TURNING_COLUMNS = (*COLUMNS, "qx", "qy", "qz", "qw")
BATCH = 20
BURST = 50  # short sessions that are written together
UNLIMITED = JournalSettings(waiting_bytes=1 << 30)


@contextmanager
def journal_file(path: Path) -> Iterator[sqlite3.Connection]:
    """Open the file of a journal for changes, which are committed; close it."""
    with closing(sqlite3.connect(path)) as file, file:
        yield file


@contextmanager
def not_written(journal: SqliteJournal) -> Iterator[None]:
    """Keep the journal's thread from writing, which would put off what `enforce_retention` does."""
    with journal._writing:
        yield


def taught(seconds: float, rate_hz: float = 100.0, *, seed: int = 0) -> NDArray[np.float64]:
    """Samples (n, columns) of a hand that wanders, with noise and short peaks of force."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    rng = np.random.default_rng(seed)
    place = np.column_stack([np.sin(t / 7), np.cos(t / 11), 0.3 + 0.1 * np.sin(t)])
    force = rng.normal(0.0, 0.5, (t.size, 3))
    force[rng.integers(0, t.size, max(1, t.size // 3000)), 2] += 40.0
    return np.column_stack([t, place + rng.normal(0.0, 1e-4, place.shape), force])


def turning(seconds: float, rate_hz: float = 100.0) -> NDArray[np.float64]:
    """Samples (n, columns) as `taught`, of a tool that turns by up to 230° from the start, and tilts.

    Every third quaternion has the other sign.
    """
    matrix = taught(seconds, rate_hz)
    t = matrix[:, 0]
    half, lean = 2.0 * np.sin(t / 5.0), 0.1 * np.sin(t / 3.0)
    (s, c), (sl, cl) = (np.sin(half), np.cos(half)), (np.sin(lean), np.cos(lean))
    quaternion = np.column_stack([cl * c, cl * s, sl * s, sl * c])  # about z, and about the flange's x
    quaternion += np.random.default_rng(1).normal(0.0, 1e-4, quaternion.shape)
    quaternion[::3] *= -1.0
    return np.hstack([matrix, quaternion])


def written(
    folder: Path,
    matrix: NDArray[np.floating],
    *,
    station: str = "cell-1",
    session: str = "s1",
    instance: str = "caesura-1",
    lost: Iterable[int] = (),
    closed: Snapshot | None = None,
    columns: tuple[str, ...] = COLUMNS,
    size: int = BATCH,
) -> None:
    """A session in the journal of an instance.

    lost: batches that never came; closed: how it ended; size: samples of a batch.
    """
    opening = Open(session=session, columns=columns, wrench_source="flange_sensor", preset="default")
    gone, count = set(lost), -(-len(matrix) // size)
    folder.mkdir(exist_ok=True, parents=True)
    with SqliteJournal(folder / f"{instance}.sqlite", UNLIMITED) as journal:
        journal.append(Record(station, session, 1e9, opening))
        for seq in sorted(set(range(count)) - gone):
            rows = matrix[seq * size : (seq + 1) * size]
            batch = pack_samples(rows, columns, session=session, epoch=0, seq=seq)
            journal.append(Record(station, session, 1e9 + seq, batch))
        if closed is not None:
            journal.append(Record(station, session, 2e9, Close(session=session, last_seq=count - 1)))
            journal.store_outcome(station, Outcome(opening, count - 1, closed))


def write_short_sessions(
    folder: Path, keys: Sequence[tuple[str, str]], kinds: Sequence[str] = ("motion",)
) -> None:
    """Write closed sessions of 0.2 s (station, session), one after the other: some thousands in seconds.

    kinds: of their segments.
    """
    rows, result = taught(0.2), ended(*kinds, t=0.2)
    folder.mkdir(exist_ok=True, parents=True)
    with SqliteJournal(folder / "caesura-1.sqlite", UNLIMITED) as journal:
        for number, (station, session) in enumerate(keys):
            opening = Open(session=session, columns=COLUMNS, wrench_source="flange_sensor", preset="default")
            batch = pack_samples(rows, COLUMNS, session=session, epoch=0, seq=0)
            for message in (opening, batch, Close(session=session, last_seq=0)):
                journal.append(Record(station, session, 1e9 + number, message))
            status = result.status.model_copy(update={"station": station, "session": session})
            journal.store_outcome(station, Outcome(opening, 0, result.model_copy(update={"status": status})))
            if number % BURST == BURST - 1:
                journal.flush()


def ended(*kinds: str, t: float, station: str = "cell-1", session: str = "s1") -> Snapshot:
    """How a session of t seconds ended, with the program as it was inferred."""
    result = {"station": station, "session": session, "instance": "caesura-1", "epoch": 1, "t": t}
    made = snapshot(1, *kinds, state="closed", **result)
    return made.model_copy(
        update={"program": made.program.model_copy(update={"edits": (), "edit_revision": 0})}
    )

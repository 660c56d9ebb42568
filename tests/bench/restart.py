"""What a restart costs with and without edits, and an open beside a station's old sessions.

A person works for 57 minutes (the demonstration of `hour.py`) in a session that stays open, on a journal on
disk and with the real models; once without edits, once with 40 made while it goes on. Then another registry
takes the journal up, as a service does that is started again. Its results are compared with those before,
field by field.
Open sessions at 1 kHz with all columns are measured likewise: five tasks, each there and back.
An open is measured as its median, at a station with and without old sessions in the journal.

Usage: python tests/bench/restart.py [--minutes 57] [--edits 0 40] [--stations 5] [--open-minutes 2]
                                     [--sessions 0 5000] [--runs 3]
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path

import numpy as np
from edit_cost import edit, registry_on
from hour import COLUMNS, MINUTE_S, SESSION, STATION, Array, until
from rich.console import Console
from rich.table import Table
from service_load import BATCH, DATA, TASKS

from caesura_protocol.codec import pack_samples
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Close, Insert, Open
from caesura_service.journal import Record, SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.session_state import SessionState, program_of

OPENS = 21


def main() -> None:
    """Measure, and print two tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=57.0)
    parser.add_argument("--edits", type=int, nargs="+", default=[0, 40])
    parser.add_argument("--stations", type=int, default=5, help="with open sessions at 1 kHz")
    parser.add_argument("--open-minutes", type=float, default=2.0, help="of each of them")
    parser.add_argument("--sessions", type=int, nargs="+", default=[0, 5000])
    parser.add_argument("--runs", type=int, default=3, help="restarts of which the fastest counts")
    options = parser.parse_args()
    restarts = Table("minutes", "edits", "restart [s]", "of the processor [s]", "results as before")
    with tempfile.TemporaryDirectory() as directory:
        measure(Path(directory), 0.1, 1, 1)  # once everything is loaded and compiled
        for edits in options.edits:
            restarts.add_row(*measure(Path(directory), options.minutes, edits, options.runs))
        Console().print(restarts)
        robots = Table(
            "open sessions", "minutes each", "restart [s]", "of the processor [s]", "share of their time"
        )
        path = Path(directory) / "robots.sqlite"
        robots.add_row(*open_sessions(path, options.stations, options.open_minutes, options.runs))
        Console().print(robots)
        opens = Table("old sessions of the station", "open, median [ms]")
        for count in options.sessions:
            opens.add_row(str(count), f"{opening_ms(Path(directory) / f'old-{count}.sqlite', count):.2f}")
        Console().print(opens)


def open_sessions(path: Path, stations: int, minutes: float, runs: int) -> tuple[str, ...]:
    """Return a row of the second table: what it takes to replay the open sessions of so many stations."""
    seconds = MINUTE_S * minutes
    with SqliteJournal(path) as journal:
        registry = registry_on(journal)
        for number, task in enumerate(islice(cycle(TASKS), stations)):
            station, recording = f"cell-{number}", load_recording(DATA / f"{task}.npz")
            columns, source = recording.columns, recording.wrench_source
            registry.handle_command(
                station, Open(session=SESSION, columns=columns, wrench_source=source), 0.0
            )
            for seq, samples in enumerate(there_and_back(recording.matrix(), seconds)):
                batch = pack_samples(samples, columns, session=SESSION, epoch=0, seq=seq)
                registry.handle_samples(station, batch, float(samples[-1, 0]))
        processor_s, wall_s = min(replayed(journal)[1:] for _ in range(runs))
    share = f"1/{stations * seconds / wall_s:.0f}"
    return str(stations), f"{minutes:g}", f"{wall_s:.2f}", f"{processor_s:.2f}", share


def there_and_back(matrix: Array, seconds: float) -> Iterator[Array]:
    """Return batches of a recording that is played forwards and backwards for so long."""
    period_s = float(matrix[1, 0] - matrix[0, 0])
    both = np.concatenate([matrix, matrix[::-1]])
    rows = np.resize(both, (round(seconds / period_s) // BATCH * BATCH, matrix.shape[1]))
    rows[:, 0] = period_s * np.arange(len(rows))
    yield from np.split(rows, len(rows) // BATCH)


def replayed(journal: SqliteJournal) -> tuple[Registry, float, float]:
    """Return another registry that has taken the journal up, and what that took [s]: processor and wall."""
    began, used = time.perf_counter(), time.process_time()
    again = registry_on(journal)
    assert again.restore() == []
    return again, time.process_time() - used, time.perf_counter() - began


def measure(directory: Path, minutes: float, edits: int, runs: int) -> tuple[str, ...]:
    """A row of the first table."""
    with SqliteJournal(directory / f"{minutes}-{edits}.sqlite") as journal:
        registry = registry_on(journal)
        taught(registry, MINUTE_S * minutes, edits)
        expected = shown(registry)
        spent, found = [], []
        for _ in range(runs):
            again, *times = replayed(journal)
            spent.append(times)
            found.append(shown(again) == expected)
    processor_s, wall_s = min(spent)
    equal = "yes" if all(found) else "NO"
    return f"{minutes:g}", str(edits), f"{wall_s:.2f}", f"{processor_s:.2f}", equal


def taught(registry: Registry, seconds: float, edits: int) -> None:
    """A session with so many inserted changepoints, made at equal intervals while it goes on."""
    registry.handle_command(
        STATION, Open(session=SESSION, columns=COLUMNS, wrench_source="flange_sensor"), 0.0
    )
    due = moments(seconds, edits)
    wanted, revision = next(due, None), 0
    for seq, samples in until(seconds):
        batch = pack_samples(samples, COLUMNS, session=SESSION, epoch=0, seq=seq)
        registry.handle_samples(STATION, batch, float(samples[-1, 0]))
        if wanted is not None and samples[-1, 0] > wanted:
            edit(registry, revision, Insert(t=wanted - 3.0))
            wanted, revision = next(due, None), revision + 1


def moments(seconds: float, edits: int) -> Iterator[float]:
    """[s] when edits are made, the last one at nine tenths."""
    return (0.9 * seconds * (number + 1) / edits for number in range(edits))


def shown(registry: Registry) -> tuple[object, ...]:
    """All that a client can ask of the session, except the epoch of whoever answers."""
    (standing,) = registry.index.all_states()
    return (*fields(standing), standing.revision, standing.undoable, standing.lifecycle)


def fields(standing: SessionState) -> tuple[object, ...]:
    """Its view and its program."""
    return standing.view, program_of(standing).model_copy(update={"epoch": 0})


def opening_ms(path: Path, sessions: int) -> float:
    """[ms] of an open where the station has so many closed sessions in the journal."""
    columns = ("t", "px", "py", "pz")
    with SqliteJournal(path) as journal:
        for number in range(sessions):
            name = f"old-{number}"
            for message in (Open(session=name, columns=columns), Close(session=name, last_seq=-1)):
                journal.append(Record(STATION, name, float(number), message))
        registry = registry_on(journal)
        registry.handle_command("cell-0", Open(session="s", columns=columns, wrench_source="none"), 0.0)
        spent = []
        for number in range(OPENS):
            made = Open(session=f"new-{number}", columns=columns, wrench_source="none")
            began = time.perf_counter()
            registry.handle_command(STATION, made, float(sessions + number))
            spent.append(time.perf_counter() - began)
    return 1e3 * statistics.median(spent)


if __name__ == "__main__":
    main()

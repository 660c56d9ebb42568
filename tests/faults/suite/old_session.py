"""An old session is read and corrected while seven stations are taught: nothing of theirs is lost or late.

The session is closed and has its outcome, so an edit makes the service replay all its records. A registry of
this process that does nothing else makes the same edit on a copy of the journal. It gives the result that is
expected, and the longest slice of the work.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from caesura_clients.query import program_at_edit, samples, snapshot
from caesura_clients.session_corrections import send
from caesura_protocol.keys import SampleRange
from caesura_protocol.messages import Edit, Insert, Snapshot
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.cooperative_scheduler import Slices
from caesura_service.journal import SqliteJournal
from caesura_service.ownership.registry import REBUILDING
from caesura_service.publishing.session_state import snapshot_of
from faults.suite.edited import JOURNAL, registry_on, results, write
from faults.suite.lateness import lateness_ms
from faults.suite.neighbours import HONEST, LASTS, LIMIT_MS
from faults.suite.outcome import Disturbance, Row, Scale, played
from faults.suite.stations import CONNECT_S, TaughtStation, reached
from harness.processes import SESSION, serving

STATION = "cell-old"
SECONDS = 600.0  # of the old session: rebuilding it takes most of the time in which the others are taught
BINS = 1200


def old_session_edited(directory: Path, scale: Scale = HONEST, seconds: float = SECONDS) -> Row:
    """Queries for an old session and an edit of it, which has it rebuilt, while the others are taught."""
    live, alone = directory / "live", directory / "alone"
    write(live, seconds, 0, station=STATION, closes=True)
    shutil.copytree(live, alone)
    edit = Edit(session=SESSION, revision=0, author="Ann", action=Insert(t=0.7 * seconds))
    expected, longest_s = undisturbed(alone, edit)
    after: list[Snapshot] = []

    def disturb(stations: list[TaughtStation], disturbance: Disturbance) -> None:
        with ZenohTransport(service.endpoint, timeout_s=CONNECT_S) as transport:
            began = time.monotonic()
            snapshot(transport, STATION, SESSION)
            program_at_edit(transport, STATION, SESSION, 0)
            samples(transport, STATION, SESSION, SampleRange(0.0, seconds, BINS))
            read_s = time.monotonic() - began
            send(transport, STATION, edit)
            edited_s = time.monotonic() - began - read_s
            after.append(snapshot(transport, STATION, SESSION))
            disturbance.note = f"read in {read_s:.1f} s, edited after {edited_s:.1f} s"
        reached(stations, LASTS)

    with serving(live) as service:
        done = played(service.endpoint, live, disturb, scale=scale)
    p50, p99, most = np.percentile(lateness_ms(done), [50, 99, 100])
    is_equal = [shown(one) for one in after] == [shown(expected)]
    note = (
        f"{seconds / 60:g} min, longest slice {1e3 * longest_s:.0f} ms; results {p50:.0f} ms late (median), "
        f"{p99:.0f} ms (p99), {most:.0f} ms at most; the edit's result is {'' if is_equal else 'not '}equal"
    )
    return done.row(note=note, met=bool(p99 < LIMIT_MS) and is_equal)


def shown(snapshot: Snapshot) -> tuple[object, ...]:
    """All that it shows, except when the edit was made."""
    program = snapshot.program.model_copy(update={"edited": None})
    return results(snapshot.model_copy(update={"program": program}))


def undisturbed(directory: Path, edit: Edit) -> tuple[Snapshot, float]:
    """What comes of an edit without other stations, and its longest slice: processor time [s]."""
    slices, took_s = Slices(), list[float]()

    def sliced(lane: str, work: Callable[[], object]) -> None:
        step = partial(slices.begin, lane, work)
        is_done = False
        while not is_done:
            began = time.thread_time()
            is_done = step()
            took_s.append(time.thread_time() - began)
            step = partial(slices.go_on, lane)

    with SqliteJournal(directory / JOURNAL) as journal:
        registry = registry_on(journal)
        registry.restore()
        command = partial(registry.handle_command, STATION, edit, time.time())
        sliced(STATION, command)
        while registry.rebuilding:
            sliced(REBUILDING + STATION, partial(registry.rebuild_step, STATION))
        sliced(STATION, command)
        (state,) = registry.index.all_states()
        assert state.revision == 1
        return snapshot_of(state), max(took_s)

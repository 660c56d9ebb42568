"""What a correction costs: in a session that is in memory, and in one that has to be folded again first.

A person works for some minutes (the demonstration of `hour.py`), through registry, journal on disk and the
real models. Then a changepoint is inserted, and taken back; the session is closed, taken up from its outcome
by a registry of its own, and corrected there. An edit holds the worker up for as long as it takes, folding
again does not: it is done a record at a time. A session whose outcome is too long to be kept is folded when
the service starts ("at the start").

Usage: python tests/bench/edit_cost.py [--minutes 1 10]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from hour import COLUMNS, MINUTE_S, SESSION, STATION, until
from rich.console import Console
from rich.table import Table

from caesura_protocol.codec import pack_samples
from caesura_protocol.messages import Ack, Action, Close, Edit, Insert, Open, Undo
from caesura_service.journal import SqliteJournal
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Output, Owner, Reply
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits


def main() -> None:
    """Measure each length, and print a row for it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=int, nargs="+", default=[1, 10])
    table = Table("minutes", "segments", "insert [ms]", "undo [ms]", "folding again [s]", "insert then [ms]")
    measure(0.1)  # once everything is loaded and compiled
    for minutes in parser.parse_args().minutes:
        table.add_row(str(minutes), *measure(minutes))
    Console().print(table)


def measure(minutes: float) -> list[str]:
    """A row of the table."""
    with (
        tempfile.TemporaryDirectory() as directory,
        SqliteJournal(Path(directory) / "edit.sqlite") as journal,
    ):
        registry = registry_on(journal)
        last = teach(registry, MINUTE_S * minutes)
        middle = 0.5 * MINUTE_S * minutes + 0.33
        insert = spent_ms(lambda: edit(registry, 0, Insert(t=middle)))
        undo = spent_ms(lambda: edit(registry, 1, Undo()))
        registry.handle_command(STATION, Close(session=SESSION, last_seq=last), 0.0)
        segments = len(registry.index.all_states()[0].view.segments)
        again = registry_on(journal)
        again.restore()
        folded = again.index.sessions[STATION][0].has_pipeline
        folding = spent_ms(lambda: fold(again))
        then = spent_ms(lambda: edit(again, 2, Insert(t=middle)))
    again_s = "at the start" if folded else f"{folding / 1000:.1f}"
    return [str(segments), f"{insert:.0f}", f"{undo:.0f}", again_s, f"{then:.0f}"]


def registry_on(journal: SqliteJournal) -> Registry:
    """A registry with the real models."""
    return Registry(
        owner=Owner("bench", 1),
        pipeline_factory=make_pipeline,
        default_preset="default",
        journal=journal,
        limits=Limits(),
    )


def teach(registry: Registry, seconds: float) -> int:
    """The number of the last batch."""
    registry.handle_command(
        STATION, Open(session=SESSION, columns=COLUMNS, wrench_source="flange_sensor"), 0.0
    )
    last = -1
    for seq, samples in until(seconds):
        batch = pack_samples(samples, COLUMNS, session=SESSION, epoch=0, seq=seq)
        registry.handle_samples(STATION, batch, float(samples[-1, 0]))
        last = seq
    return last


def edit(registry: Registry, revision: int, action: Action) -> list[Output]:
    """Correct the session, or fail."""
    made = Edit(session=SESSION, revision=revision, author="bench", action=action)
    said = registry.handle_command(STATION, made, 0.0)
    (reply,) = [one.reply for one in said if isinstance(one, Reply)]
    if not isinstance(reply, Ack):
        raise reply
    return said


def fold(registry: Registry) -> None:
    """Have a session rebuilt that somebody wants to correct."""
    wanted = Edit(session=SESSION, revision=2, author="bench", action=Undo())
    registry.handle_command(STATION, wanted, 0.0)  # refused until it has been folded
    while registry.rebuilding:
        registry.rebuild_step(STATION)


def spent_ms(work: Callable[[], object]) -> float:
    """Wall clock [ms]."""
    began = time.perf_counter()
    work()
    return 1000.0 * (time.perf_counter() - began)


if __name__ == "__main__":
    main()

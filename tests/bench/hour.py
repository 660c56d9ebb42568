"""One session for an hour: does memory stay flat, and does a step cost at the end what it did at first?

An hour of samples goes through registry, journal on disk and the real models as fast as they go, and what is
said is encoded as it would be for the wire; once while a person works, once so with every column that a
session may have, once while the robot stands still. Each runs in a process of its own. A step is one batch,
and its time is that of the thread that takes it, so that other work on the machine does not count. Memory of
the last minute is compared with that of the second: the first warms up. Steps are compared with those of
another session in its second minute, with the same samples, batch by batch in turn: a machine's own speed
varies by a third.
Exits 1 where a limit does not hold.

Usage: python tests/bench/hour.py [--minutes 60] [--only varied|complete|still]
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import resource
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice, takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from caesura_protocol.codec import pack_samples
from caesura_protocol.fragments import fragment
from caesura_protocol.messages import Open
from caesura_service.journal import SqliteJournal
from caesura_service.malloc_threshold import return_large_blocks
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Owner, Publish
from caesura_service.segmentation.pipeline import make_pipeline
from caesura_service.sessions.limits import Limits

RATE_HZ = 200.0
MINUTE_S, BATCH = 60.0, 20
COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")
EVERY_COLUMN = (*COLUMNS, "qx", "qy", "qz", "qw", *(f"q{i}" for i in range(1, 8)), "gripper")
OPEN_M, CLOSED_M = 0.08, 0.03
STATION, SESSION = "cell-1", "hour"
BATCHES_PER_MINUTE = round(MINUTE_S * RATE_HZ / BATCH)
WARM_UP_S = 5.0
SHOWN_MINUTES = 10
MEMORY_LIMIT, STEP_LIMIT = 1.05, 1.2
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Minute:
    """What one minute of the demonstration cost."""

    resident_mb: float
    step_ms: float  # mean
    p99_ms: float
    segments: int


@dataclass(frozen=True)
class Hour:
    """Minute by minute; and one minute more beside another session's second, as (old, young)."""

    minutes: Sequence[Minute]
    beside: tuple[Minute, Minute]


class HourLongSession:
    """One session of a registry, under way."""

    def __init__(self, registry: Registry, station: str, kind: str, *, skipped_minutes: int = 0) -> None:
        work, columns = HOURS[kind]
        self._columns: tuple[str, ...] = columns
        self._registry, self._station = registry, station
        whole = batches(work(np.random.default_rng(0)))
        self._coming = enumerate(islice(whole, skipped_minutes * BATCHES_PER_MINUTE, None))
        registry.handle_command(
            station, Open(session=SESSION, columns=self._columns, wrench_source="flange_sensor"), 0.0
        )

    def step(self) -> float:
        """Take a batch; [ms] that it took."""
        seq, work = next(self._coming)
        rows = with_time(seq, work)
        batch = pack_samples(rows, self._columns, session=SESSION, epoch=0, seq=seq)
        before = time.thread_time()
        for said in self._registry.handle_samples(self._station, batch, float(rows[-1, 0])):
            if isinstance(said, Publish):
                deque(fragment(said.message), maxlen=0)
        return 1e3 * (time.thread_time() - before)

    def minute(self, spent: Sequence[float]) -> Minute:
        """What it comes to."""
        (session,) = self._registry.index.sessions[self._station]
        standing = session.state
        assert standing.is_open, standing.counters.last_refusal
        assert not standing.counters.refused, standing.counters.last_refusal
        p99 = float(np.quantile(spent, 0.99))
        return Minute(resident_mb(), float(np.mean(spent)), p99, len(standing.view.segments))


def main() -> int:
    """Measure all, and print a row for every tenth minute; 1 where a limit does not hold."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--only", choices=sorted(HOURS))
    options = parser.parse_args()
    holds = True
    for name in [options.only] if options.only else sorted(HOURS, reverse=True):
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            holds &= show(name, pool.apply(measure, (name, options.minutes)))
    return 0 if holds else 1


def show(name: str, hour: Hour) -> bool:
    """A table, and what it comes to; True where the limits hold."""
    minutes = hour.minutes
    table = Table("minute", "resident [MB]", "step [ms]", "p99 [ms]", "segments", title=name)
    for number, minute in enumerate(minutes, start=1):
        if number in {1, 2, len(minutes)} or number % SHOWN_MINUTES == 0:
            table.add_row(
                str(number),
                f"{minute.resident_mb:.1f}",
                f"{minute.step_ms:.2f}",
                f"{minute.p99_ms:.2f}",
                str(minute.segments),
            )
    console = Console()
    console.print(table)
    first, last = minutes[min(1, len(minutes) - 1)], minutes[-1]
    old, young = hour.beside
    memory, step = last.resident_mb / first.resident_mb, old.step_ms / young.step_ms
    flat = memory <= MEMORY_LIMIT and step <= STEP_LIMIT
    in_turn = f"step: {old.step_ms:.2f} ms beside {young.step_ms:.2f} ms of another session's second minute,"
    for what, ratio, limit in (
        ("memory: last minute over the second", memory, MEMORY_LIMIT),
        (in_turn, step, STEP_LIMIT),
    ):
        verdict = "holds" if ratio <= limit else "DOES NOT HOLD"
        console.print(f"{what} {ratio:.3f}, at most {limit:g}: {verdict}")
    return flat


def measure(kind: str, minutes: int) -> Hour:
    """An hour of one kind of work, once everything is loaded and compiled."""
    return_large_blocks()
    warm_up(kind)
    with service() as registry:
        old = HourLongSession(registry, STATION, kind)
        hour = [alternating(old)[0] for _ in range(minutes)]
        young = HourLongSession(registry, "cell-2", kind, skipped_minutes=minutes - 1)
        alternating(young)
        old_minute, young_minute = alternating(old, young)
    return Hour(hour, (old_minute, young_minute))


def warm_up(kind: str) -> None:
    """Load and compile everything."""
    with service() as registry:
        demonstration = HourLongSession(registry, STATION, kind)
        for _ in range(round(WARM_UP_S * RATE_HZ / BATCH)):
            demonstration.step()


@contextmanager
def service() -> Iterator[Registry]:
    """A registry with a journal on disk."""
    with (
        tempfile.TemporaryDirectory() as directory,
        SqliteJournal(Path(directory) / "hour.sqlite") as journal,
    ):
        yield Registry(
            owner=Owner("bench", 1),
            pipeline_factory=make_pipeline,
            default_preset="default",
            journal=journal,
            limits=Limits(),
        )


def alternating(*demonstrations: HourLongSession) -> list[Minute]:
    """A minute of each, batch by batch in turn."""
    spent = [[one.step() for one in demonstrations] for _ in range(BATCHES_PER_MINUTE)]
    gc.collect()
    return [one.minute(column) for one, column in zip(demonstrations, zip(*spent, strict=True), strict=True)]


def resident_mb() -> float:
    """Of this process, now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def batches(strokes: Iterator[Array]) -> Iterator[Array]:
    """Batches (BATCH, columns) of a stream of rows without their time."""
    rest = next(strokes)
    for stroke in strokes:
        rest = np.concatenate([rest, stroke])
        while len(rest) >= BATCH:
            yield rest[:BATCH]
            rest = rest[BATCH:]


def with_time(seq: int, rows: Array) -> Array:
    """A batch (BATCH, columns) with the time of its samples [s] as its first column."""
    return np.column_stack([(seq * BATCH + np.arange(BATCH)) / RATE_HZ, rows])


def until(seconds: float) -> Iterator[tuple[int, Array]]:
    """Numbered batches of varied work that begin within so many seconds, with their time."""
    work = enumerate(batches(varied(np.random.default_rng(0))))
    return takewhile(
        lambda made: made[1][0, 0] < seconds, ((seq, with_time(seq, rows)) for seq, rows in work)
    )


def varied(rng: np.random.Generator) -> Iterator[Array]:
    """Reach, press, carry and rest without end, in random order and of random length."""
    at, push = np.array([0.4, 0.0, 0.4]), 0.0
    while True:
        seconds = rng.uniform(0.6, 2.5)
        target = at if rng.random() < 0.35 else rng.uniform([0.3, -0.3, 0.1], [0.6, 0.3, 0.5])
        level = rng.choice([0.0, 0.0, 8.0, 14.0, -3.0])
        s = np.arange(round(seconds * RATE_HZ)) / (seconds * RATE_HZ)
        bell = (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None]
        force = np.column_stack([0 * s, 0 * s, push + bell[:, 0] * (level - push)])
        yield noisy(rng, at + bell * (target - at), force, tremor_m=3e-4)
        at, push = target, float(level)


def still(rng: np.random.Generator) -> Iterator[Array]:
    """Nothing moves but the sensor's noise."""
    rows = np.tile([0.4, 0.0, 0.4], (round(RATE_HZ), 1))
    while True:
        yield noisy(rng, rows, np.zeros_like(rows), tremor_m=2e-5)


def complete(rng: np.random.Generator) -> Iterator[Array]:
    """`varied` with an orientation, joints, and a gripper that closes on something and opens again."""
    t, width = 0.0, OPEN_M
    for rows in varied(rng):
        times = t + np.arange(len(rows)) / RATE_HZ
        t = float(times[-1]) + 1.0 / RATE_HZ
        angle = 0.5 * np.sin(0.3 * times)
        zero = np.zeros_like(angle)
        orientation = [np.cos(angle), np.sin(angle), zero, zero]
        joints = [np.sin(0.1 * (i + 1) * times) for i in range(7)]
        width = rng.choice([width, OPEN_M, CLOSED_M])
        yield np.column_stack([rows, *orientation, *joints, np.full(len(rows), width)])


def noisy(rng: np.random.Generator, position: Array, force: Array, *, tremor_m: float) -> Array:
    """(n, 6)."""
    return np.column_stack(
        [
            position + tremor_m * rng.standard_normal(position.shape),
            force + 0.2 * rng.standard_normal(force.shape),
        ]
    )


WORK: dict[str, Callable[[np.random.Generator], Iterator[Array]]] = {"varied": varied, "still": still}
HOURS = {name: (work, COLUMNS) for name, work in WORK.items()} | {"complete": (complete, EVERY_COLUMN)}


if __name__ == "__main__":
    sys.exit(main())

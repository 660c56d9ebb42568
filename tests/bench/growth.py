"""How the cost of an observation grows: with the session, its segments, its neighbours, and the rate.

Processor time of the filter, preset `default`, and of the whole way from samples to what is shown. Sessions
of every age are made first and then taken in turn over the same observations, a stretch at a time, so that
what differs is their age alone; all figures are medians over stretches, of ratios too. "still" is a robot
that stands: one segment as long as the session. At other rates than 10 Hz the filter's window and bounds keep
their seconds, and hold more samples. Usage: python tests/bench/growth.py [--hours 8] [--json DIR]
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, cycle, islice
from pathlib import Path
from typing import TypeVar

import hour
import numpy as np
from machine import machine, options, report
from numpy.typing import NDArray

from caesura_protocol.messages import Open
from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.filter_choice import make_filter
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.hazard import Refractory
from caesura_service.changepoint.preset import SEGMENTATION_HZ
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.segment_model_set import SegmentModelSet
from caesura_service.segmentation.pipeline import make_pipeline

Array = NDArray[np.float64]
Work = TypeVar("Work")

HZ = round(SEGMENTATION_HZ)
MINUTES = (1, 10, 60)  # and the longest
SEGMENT_SECONDS = (1, 4, 16)  # times as slow as `hour.varied`
SESSIONS = (1, 8, 32, 128)
RATES_HZ = (10, 50, 100)
SETTLING, STRETCH, STRETCHES = 300, 25, 36  # observations
PRESET = PRESETS["default"]
EACH = round(hour.RATE_HZ / HZ)  # samples of an observation
BATCHES = max(EACH // hour.BATCH, 1)


def main() -> None:
    """Measure each."""
    parser = options(__doc__)
    parser.add_argument("--hours", type=float, default=8.0, help="of the longest session")
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    minutes = sorted({*MINUTES, round(60 * asked.hours)})
    by_length(minutes, asked.json)
    by_segments(asked.json)
    by_sessions(asked.json)
    by_rate(asked.json)


# --- one table each -------------------------------------------------------------------------------------


def by_length(minutes: Sequence[int], directory: Path | None) -> None:
    """What an observation costs in sessions of every length."""
    rows = []
    for name, work in sorted(hour.WORK.items(), reverse=True):
        seen, probe = observations(work, 600 * HZ), observations(work, measured(), seed=1)
        filters = [aged(seen, 60 * HZ * minute) for minute in minutes]
        rows.append((f"filter, {name}", in_turn([partial(steps, online) for online in filters], probe)))
    samples, probes = sampled(hour.varied, 600 * HZ), sampled(hour.varied, measured(), seed=1)
    sessions = [aged_samples(samples, 60 * HZ * minute) for minute in minutes]
    rows.append(("all of it, varied", in_turn([one.take for one in sessions], probes)))
    reported = [(what, *np.median(taken, axis=1), np.median(taken[-1] / taken[0])) for what, taken in rows]
    columns = ("what", *(f"{minute} min" for minute in minutes), "last ÷ first")
    report("growth_length", "µs an observation, by the session's length", columns, reported, directory)


def by_segments(directory: Path | None) -> None:
    """Sessions of an hour with few and with many segments."""
    rows = []
    for slower in SEGMENT_SECONDS:
        work = partial(slowed, slower=slower)
        online = aged(observations(work, 600 * HZ), 3600 * HZ)
        cost = np.median(in_turn([partial(steps, online)], observations(work, measured(), seed=1)))
        rows.append((len(online.final), online.starts.size, cost))
    columns = ("segments", "hypotheses at the end", "µs")
    report("growth_segments", "µs an observation after an hour, by segments", columns, rows, directory)


def by_sessions(directory: Path | None) -> None:
    """So many filters in one process, each taking an observation in turn."""
    seen, probe = observations(hour.varied, 60 * HZ), observations(hour.varied, measured(), seed=1)
    groups = [[aged(seen, 60 * HZ) for _ in range(count)] for count in SESSIONS]
    costs = in_turn([partial(round_robin, group) for group in groups], probe)
    rows = [(count, np.median(cost) / count) for count, cost in zip(SESSIONS, costs, strict=True)]
    report(
        "growth_sessions",
        "µs an observation, by sessions in the process",
        ("sessions", "µs"),
        rows,
        directory,
    )


def by_rate(directory: Path | None) -> None:
    """The same demonstration looked at more often."""
    rows = []
    for hz in RATES_HZ:
        online = at_rate(hz)
        seen = observations(hour.varied, 60 * hz, hz=hz)
        steps(online, seen)
        probe = observations(hour.varied, measured(), hz=hz, seed=1)
        cost = np.median(in_turn([partial(steps, online)], probe))
        rows.append((hz, online.starts.size, cost, 1e-4 * cost * hz))
    columns = ("Hz", "hypotheses at the end", "µs", "% of a core")
    report("growth_rate", "µs an observation, by the rate of segmentation", columns, rows, directory)


# --- measuring ------------------------------------------------------------------------------------------


def in_turn(works: Sequence[Callable[[Sequence[Work]], None]], probe: Sequence[Work]) -> Array:
    """(works, stretches) µs of processor time for one of the probe; each is first in turn."""
    taken: list[list[float]] = [[] for _ in works]
    for turn, first in enumerate(range(0, len(probe), STRETCH)):
        for i in range(len(works)):
            mine = (turn + i) % len(works)
            before = time.thread_time()
            works[mine](probe[first : first + STRETCH])
            taken[mine].append(1e6 * (time.thread_time() - before) / STRETCH)
    return np.array(taken)[:, SETTLING // STRETCH :]


def measured() -> int:
    """Observations of a probe: at first the sessions still differ by what they saw before."""
    return SETTLING + STRETCH * STRETCHES


def steps(online: ChangepointFilter, seen: Iterable[ModelInput]) -> None:
    """Into one filter."""
    for observed in seen:
        online.step(observed)


def round_robin(group: Sequence[ChangepointFilter], seen: Sequence[ModelInput]) -> None:
    """Into many, an observation after the other."""
    for observed in seen:
        for online in group:
            online.step(observed)


# --- what is measured -----------------------------------------------------------------------------------


def aged(seen: Sequence[ModelInput], age: int) -> ChangepointFilter:
    """A filter that has taken so many observations, these again and again."""
    online = PRESET.online()
    steps(online, islice(cycle(seen), age))
    return online


def at_rate(hz: int) -> ChangepointFilter:
    """The preset with its seconds kept. What the models hold of neighbouring samples is not scaled."""
    times, lattice, bounds = hz / HZ, PRESET.lattice(), PRESET.filter
    channels = {
        name: replace(model, library=replace(model.library, step_s=1.0 / hz))
        if isinstance(model, ProfileModel)
        else model
        for name, model in lattice.channels.items()
    }
    more = {
        name: round(times * getattr(bounds, name))
        for name in ("keep_youngest", "cap", "window", "certain_after")
    }
    hazard = Refractory(PRESET.mean_segment_s * hz, round(PRESET.refractory_s * hz))
    return make_filter(SegmentModelSet(channels, lattice.kinds), hazard, replace(bounds, **more))


def observations(
    work: Callable[[np.random.Generator], Iterator[Array]], n: int, *, hz: int = HZ, seed: int = 0
) -> list[ModelInput]:
    """n of what somebody does, every so many rows of it."""
    rows = chain.from_iterable(work(np.random.default_rng(seed)))
    every = round(hour.RATE_HZ / hz)
    return [ModelInput(row[:3], row[3:]) for row in islice(rows, 0, n * every, every)]


class Samples:
    """A session's samples, on their way to what is shown."""

    def __init__(self) -> None:
        self._pipeline = make_pipeline(
            Open(session="growth", columns=hour.COLUMNS, wrench_source="flange_sensor"), PRESET.name
        )
        self._count = 0

    def take(self, seen: Iterable[Array]) -> None:
        """Of one observation after the other, in batches."""
        for rows in chain.from_iterable(np.split(one, BATCHES) for one in seen):
            t = (self._count + np.arange(len(rows))) / hour.RATE_HZ
            self._count += len(rows)
            self._pipeline.push(np.column_stack([t, rows]))


def aged_samples(seen: Sequence[Array], age: int) -> Samples:
    """A session that has taken so many observations, these again and again."""
    samples = Samples()
    samples.take(islice(cycle(seen), age))
    return samples


def sampled(work: Callable[[np.random.Generator], Iterator[Array]], n: int, seed: int = 0) -> list[Array]:
    """The samples of n observations, (rows, 6) each."""
    rows = chain.from_iterable(work(np.random.default_rng(seed)))
    return list(np.array(list(islice(rows, n * EACH))).reshape(n, EACH, 6))


def slowed(rng: np.random.Generator, *, slower: int) -> Iterator[Array]:
    """`hour.varied`, every row several times as long."""
    for rows in hour.varied(rng):
        last = np.arange(len(rows))
        finer = np.arange(slower * len(rows)) / slower
        smooth = np.column_stack([np.interp(finer, last, column) for column in rows.T])
        yield smooth


if __name__ == "__main__":
    main()

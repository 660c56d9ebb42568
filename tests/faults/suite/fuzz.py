"""Hostile inputs by the thousand, driven by hypothesis: into the codec, and in sequences into a registry.

What the codec takes to read one is compared with an honest message, the golden vector that costs most.
"""

from __future__ import annotations

import gc
import resource
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from caesura_protocol.codec import MESSAGE_TYPES, Encoded, encoding_of
from caesura_service.segmentation.pipeline import make_pipeline
from faults.suite.outcome import Row
from harness.hostile import GOLDEN, Hostile, Target, read_everything

INPUTS = {"codec": 45_000, "registry": 50_000, "registry, real models": 10_000}
SEQUENCE = 50
GROWTH_MB = 64  # of the process over the second half: in the first, presets and robots are loaded, once each
COST = 3.0  # times an honest message's, at most; a megabyte of integers once cost thousands of times that
TRIES = 7  # of which the quickest counts: others use the processor too
UNHURRIED = settings(
    deadline=None,
    database=None,
    phases=(Phase.generate,),
    suppress_health_check=list(HealthCheck),
)


def fuzz(directory: Path) -> Row:
    """The count of each, what was taken and refused, and how much memory it cost."""
    del directory
    done: Counter[str] = Counter()
    grown_mb = []

    honest_s = max(cost_s(Encoded(payload, encoding_of(MESSAGE_TYPES[name]))) for payload, name in GOLDEN)
    costliest_s = 0.0

    def read(hostile: Hostile) -> None:
        nonlocal costliest_s
        for _ in range(SEQUENCE):
            payload = hostile.payload()
            if once_s(payload) > max(costliest_s, honest_s):
                costliest_s = max(costliest_s, cost_s(payload))

    def attack(target: Target, hostile: Hostile) -> None:
        for _ in range(SEQUENCE):
            target.attack(hostile)
        standings = target.registry.index.all_states()
        done["batches taken"] += sum(standing.counters.batches for standing in standings)
        done["refused"] += sum(target.registry.counters.refused.values())

    ways: dict[str, Callable[[Hostile], None]] = {
        "codec": read,
        "registry": lambda hostile: attack(Target(), hostile),
        "registry, real models": lambda hostile: attack(Target(make_pipeline, "default"), hostile),
    }
    for way, inputs in INPUTS.items():
        examples = inputs // SEQUENCE
        seen = driven(ways[way], examples // 2)
        before = resident_mb()
        seen += driven(ways[way], examples - seen)
        grown_mb.append(resident_mb() - before)
        done[way] = SEQUENCE * seen
    note = ", ".join(f"{count} {what}" for what, count in done.items())
    sent = sum(done[way] for way in INPUTS)
    cost = max(costliest_s, honest_s) / honest_s
    met = sent >= sum(INPUTS.values()) and max(grown_mb) < GROWTH_MB and cost < COST
    note = (
        f"0 crashes: {note}; memory grew {max(grown_mb):.0f} MB; the costliest input took {cost:.1f} times "
    )
    note += f"an honest message's {1e3 * honest_s:.2f} ms"
    return Row(0, sent, 0, 0, "–", None, note, met)


def once_s(content: Encoded) -> float:
    """The processor time that reading takes [s]."""
    before = time.thread_time()
    read_everything(content)
    return time.thread_time() - before


def cost_s(content: Encoded) -> float:
    """The processor time that reading takes at least [s]."""
    return min(once_s(content) for _ in range(TRIES))


def driven(way: Callable[[Hostile], None], examples: int) -> int:
    """How many sequences were done. Raises the first failure, with the generator that repeats it."""
    seen = 0

    @settings(UNHURRIED, max_examples=examples)
    @given(st.randoms(use_true_random=True))
    def run(rng: object) -> None:
        nonlocal seen
        seen += 1
        way(Hostile(rng))  # type: ignore[arg-type]

    run()
    return seen


def resident_mb() -> float:
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6

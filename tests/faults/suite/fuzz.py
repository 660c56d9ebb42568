"""Hostile inputs by the thousand, driven by hypothesis: into the codec, and in sequences into a registry."""

from __future__ import annotations

import gc
import resource
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from caesura_service.segmentation.pipeline import make_pipeline
from faults.suite.outcome import Row
from harness.hostile import Hostile, Target, read_everything

INPUTS = {"codec": 45_000, "registry": 50_000, "registry, real models": 10_000}
SEQUENCE = 50
GROWTH_MB = 64  # of the process over the second half: in the first, presets and robots are loaded, once each
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

    def read(hostile: Hostile) -> None:
        for _ in range(SEQUENCE):
            read_everything(hostile.payload())

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
    met = sent >= sum(INPUTS.values()) and max(grown_mb) < GROWTH_MB
    return Row(0, sent, 0, 0, "–", None, f"0 crashes: {note}; memory grew {max(grown_mb):.0f} MB", met)


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

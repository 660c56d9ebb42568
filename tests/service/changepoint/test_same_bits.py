"""The compiled filter gives the same bits in another process, and whoever else is in it."""

from __future__ import annotations

import hashlib
import multiprocessing
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.changepoint.presets import PRESETS
from service.streams import pieces

OBSERVATIONS, NEIGHBOURS = 150, 12
NAMES = ("default", "integrated", "contact", "constant_velocity")


def made(name: str) -> CompiledRunLengthFilter:
    preset = PRESETS[name]
    return CompiledRunLengthFilter(preset.lattice(), preset.hazard, preset.filter)


def coming_and_going() -> Iterator[None]:
    """Other sessions, of every preset, each an observation further at a time; they end and begin anew."""
    rng = np.random.default_rng(1)
    while True:
        others = [made(name) for name in rng.choice(sorted(PRESETS), NEIGHBOURS)]
        for observed, boundary in pieces(rng, int(rng.integers(20, 60))):
            for other in others:
                other.step(observed, boundary=boundary)
            yield


@cache
def bits(name: str, crowded: bool) -> str:
    """A digest of all that a filter says after every observation."""
    online, evidence = made(name), hashlib.blake2b()
    neighbours = coming_and_going()
    for observed, boundary in pieces(np.random.default_rng(0), OBSERVATIONS):
        online.step(observed, boundary=boundary)
        if crowded:
            next(neighbours)
        for array in (online.starts, online.kind_log_evidence, online.log_joint, online.smoothed):
            evidence.update(array.tobytes())
    for ended in (*online.final, *online.map_path()):
        evidence.update(ended.kind_log_evidence.tobytes())
    return evidence.hexdigest()


@pytest.mark.parametrize("name", NAMES)
def test_among_other_sessions(name: str) -> None:
    assert bits(name, crowded=True) == bits(name, crowded=False)


@pytest.mark.slow
def test_in_another_process() -> None:
    here = [bits(name, crowded=False) for name in NAMES]
    assert len(set(here)) == len(NAMES)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        for crowded in (False, True):
            assert pool.starmap(bits, [(name, crowded) for name in NAMES]) == here

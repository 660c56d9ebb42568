"""What paths cost: ms to reduce one, and µs an observation of the whole program, with paths and without.

Usage: python tests/bench/path_cost.py
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from caesura_protocol.formats.read import load_recording
from caesura_service.offline_segmentation import views
from caesura_service.program.apps.paths import TOLERANCE_M, TOLERANCE_RAD, VIA_SHARE, Paths, reduced
from caesura_service.segmentation.pipeline import SegmentationPipeline

DATA = Path(__file__).parents[2] / "data"
RECORDINGS = ("pick_and_place", "dispenser", "wiping", "parkour", "three_point")


def reduction_ms(seconds: float) -> tuple[int, float]:
    """Via points of a winding way of so many seconds, and the least of ten times [ms]."""
    rng, n = np.random.default_rng(1), round(10 * seconds)
    way = 0.01 * gaussian_filter1d(np.cumsum(rng.normal(size=(n, 3)), axis=0), 5, axis=0)
    poses = np.column_stack([way, np.tile((1.0, 0.0, 0.0, 0.0), (n, 1))])
    took, via = [], 0
    for _ in range(10):
        began = time.thread_time()
        knots, _, _ = reduced(0.1 * np.arange(n), poses, VIA_SHARE * TOLERANCE_M, VIA_SHARE * TOLERANCE_RAD)
        took.append(time.thread_time() - began)
        via = len(knots) - 2
    return via, 1e3 * min(took)


def program_us() -> float:
    """Processor time of the program [µs an observation] over the recordings."""
    spent, observations = [0.0], 0
    apps = SegmentationPipeline._apps

    def timed(*arguments: object) -> object:
        began = time.thread_time()
        try:
            return apps(*arguments)  # type: ignore[arg-type]
        finally:
            spent[0] += time.thread_time() - began

    SegmentationPipeline._apps = timed  # type: ignore[method-assign, assignment]
    try:
        for name in RECORDINGS:
            *_, last = views(load_recording(DATA / f"{name}.npz"))
            observations += last.observations
    finally:
        SegmentationPipeline._apps = apps  # type: ignore[method-assign]
    return 1e6 * spent[0] / observations


def main() -> None:
    """Print what it costs."""
    for seconds in (3.0, 20.0, 60.0):
        via, took = reduction_ms(seconds)
        print(f"a winding way of {seconds:.0f} s, once it is settled: {took:.1f} ms, {via} via points")
    program_us()  # the first one compiles
    with_paths = program_us()
    between, turning = Paths.between, Paths.turning
    Paths.between = Paths.turning = lambda *_: None  # type: ignore[method-assign, assignment]
    without = program_us()
    Paths.between, Paths.turning = between, turning  # type: ignore[method-assign]
    print(f"the program: {with_paths:.0f} µs an observation, {without:.0f} without paths")


if __name__ == "__main__":
    main()

"""A whole recording at once: ours beside ruptures PELT and bayesian-changepoint-detection's recursion.

15 s and 10 min of observations at 10 Hz. PELT (linear model, jump 1) and ours see the same six signals; the
peer's recursion takes one signal, a level with Gaussian noise. Each runs in a process of its own and is
given up after `--patience` seconds. Prints seconds, processor time. Usage: python
tests/bench/offline_cost.py [--patience 300]
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import peers
from machine import options, report
from numpy.typing import NDArray
from step_cost import demonstration

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter, compile_now
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS

LENGTHS_S = (15, 600)
HZ = 10


def main() -> None:
    """Measure every method on every length."""
    parser = options(__doc__)
    parser.add_argument("--patience", type=float, default=300.0, help="[s] for one method")
    asked = parser.parse_args()
    rows = [
        (method, *(limited(run, seconds * HZ, asked.patience) for seconds in LENGTHS_S))
        for method, run in METHODS.items()
    ]
    report(
        "offline_cost", "seconds a recording", ("method", *(f"{s} s" for s in LENGTHS_S)), rows, asked.json
    )


def limited(run: Callable[[list[ModelInput]], None], n: int, patience_s: float) -> object:
    """[s] that it takes, or that it was given up."""
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.Process(target=timed, args=(run, n, there))
    process.start()
    process.join(patience_s)
    if process.is_alive():
        process.kill()
        process.join()
        return f"> {patience_s:g}"
    return here.recv() if here.poll() else "–"


def timed(run: Callable[[list[ModelInput]], None], n: int, reported: Any) -> None:
    """Tell how much processor time it takes, once what it needs is loaded."""
    run(demonstration(20))
    data = demonstration(n)
    before = time.process_time()
    run(data)
    reported.send(time.process_time() - before)


def own(data: list[ModelInput]) -> None:
    """The filter over everything: final and provisional segments are the recording's."""
    compile_now()
    preset = PRESETS["default"]
    online = CompiledRunLengthFilter(preset.lattice(), preset.hazard, preset.filter)
    for observed in data:
        online.step(observed)
    online.map_path()


def exact(data: list[ModelInput]) -> None:
    """The exact posterior of every changepoint, starts pruned."""
    preset = PRESETS["default"]
    segment_offline(preset.lattice(), preset.hazard, data, prune_ratio=1e-12)


def pelt(data: list[ModelInput]) -> None:
    """Piecewise linear, the usual penalty."""
    import ruptures  # noqa: PLC0415

    series = signals(data)
    scaled = (series - series.mean(axis=0)) / series.std(axis=0)
    penalty = 3.0 * np.log(len(series)) * scaled.shape[1]
    ruptures.Pelt(model="clinear", min_size=3, jump=1).fit(scaled).predict(pen=penalty)


def recursion(data: list[ModelInput]) -> None:
    """The peer's, on the vertical force."""
    run = peers.bcd_offline()
    if run is None:
        raise SystemExit("bayesian-changepoint-detection is not installed")
    run(signals(data)[:, -1])


def signals(data: list[ModelInput]) -> NDArray[np.float64]:
    """(n, 6) position and force."""
    return np.array([[*observed.position, *observed.force] for observed in data])


METHODS = {
    "caesura, filter": own,
    "caesura, exact posterior": exact,
    "ruptures PELT, clinear, jump 1": pelt,
    "bayesian-changepoint-detection offline": recursion,
}

if __name__ == "__main__":
    main()

"""What a step of the filter costs: compiled, in NumPy, as the thesis has it, beside peers and the roofline.

At about 10, 50 and 100 living hypotheses, all in this process, in turn over the same observations: a stretch
of some hundred steps by one, then by the next, as a recording has them. `compiled` and all ratios are of such
stretches; `after others` is a compiled step that follows one of the NumPy path, which has taken the caches.
Prints µs a step, medians, and ratios. Usage: python tests/bench/step_cost.py
[--presets a b …] [--orientation] [--torque] [--json DIR]
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import peers
import roofline
import thesis_update
from machine import machine, options, report, seconds

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.run_length_filter import RunLengthFilter

HYPOTHESES = (10, 50, 100)
WARM_UP, STRETCH, STRETCHES = 160, 100, 5
COLUMNS = (
    *("preset", "h", "compiled", "after others", "NumPy", "NumPy ×"),
    *("thesis", "thesis ×", "roofline", "roofline ×"),
)


def main() -> None:
    """Measure every preset, and what others do."""
    parser = options(__doc__)
    parser.add_argument("--presets", nargs="*", default=sorted(PRESETS), choices=sorted(PRESETS))
    parser.add_argument("--orientation", action="store_true", help="sessions report an orientation")
    parser.add_argument("--torque", action="store_true", help="and a torque")
    asked = parser.parse_args()
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    data = demonstration(WARM_UP + (STRETCHES + 1) * STRETCH)
    rows = [
        measure(name, h, data, orientation=asked.orientation or asked.torque, torque=asked.torque)
        for name in asked.presets
        for h in HYPOTHESES
    ]
    report("step_cost", "µs a step", COLUMNS, rows, asked.json)
    report(
        "peers", "µs a step, one level (Gaussian of unknown mean), 200 samples", *peers_rows(data), asked.json
    )


def measure(
    name: str, hypotheses: int, data: Sequence[ModelInput], *, orientation: bool, torque: bool
) -> tuple[object, ...]:
    """Median µs a step of each way, and how they compare."""
    preset = living(PRESETS[name], hypotheses)
    lattice = preset.lattice(orientation=orientation, torque=torque)
    compiled = CompiledRunLengthFilter(lattice, preset.hazard, preset.filter)
    reference = RunLengthFilter(lattice, preset.hazard, preset.filter)
    for online in (compiled, reference):
        take(online, data[:WARM_UP])
    work = roofline.work_of(lattice, compiled.starts.size, preset.filter.window)
    reported: dict[str, list[float]] = {"compiled": [], "NumPy": [], "thesis": [], "roofline": []}
    for stretch in stretches(data):
        reported["compiled"].append(processor_seconds(partial(take, compiled, stretch)) / STRETCH)
        reported["NumPy"].append(processor_seconds(partial(take, reference, stretch)) / STRETCH)
        reported["roofline"].append(roofline.least_seconds(work, roofline.saxpy_rates(int(work.bytes))))
        if name == "integrated":
            so_far = data[: compiled.count]
            reported["thesis"].append(processor_seconds(partial(as_in_thesis, reference, so_far)))
    step, numpy, least = (statistics.median(reported[way]) for way in ("compiled", "NumPy", "roofline"))
    cold = statistics.median(after_others(compiled, reference, data[-STRETCH:]))
    thesis = statistics.median(reported["thesis"]) if reported["thesis"] else None
    return (
        *(name, compiled.starts.size, 1e6 * step, 1e6 * cold, 1e6 * numpy, numpy / step),
        "" if thesis is None else 1e6 * thesis,
        "" if thesis is None else thesis / step,
        *(1e6 * least, step / least),
    )


def stretches(data: Sequence[ModelInput]) -> Iterator[Sequence[ModelInput]]:
    """All but the last."""
    for first in range(WARM_UP, WARM_UP + STRETCHES * STRETCH, STRETCH):
        yield data[first : first + STRETCH]


def take(online: ChangepointFilter, observations: Sequence[ModelInput]) -> None:
    """One step after the other."""
    for observed in observations:
        online.step(observed)


def processor_seconds(work: Callable[[], object]) -> float:
    """Of this thread: what others do meanwhile is not counted."""
    before = time.thread_time()
    work()
    return time.thread_time() - before


def after_others(
    compiled: ChangepointFilter, reference: ChangepointFilter, observations: Sequence[ModelInput]
) -> list[float]:
    """[s] of each compiled step, a step of the NumPy path before it.

    By the clock on the wall: asking for processor time would take longer than a step.
    """
    taken = []
    for observed in observations:
        reference.step(observed)
        taken.append(seconds(partial(compiled.step, observed)))
    return taken


def living(preset: Preset, hypotheses: int) -> Preset:
    """The same with about so many hypotheses alive, whatever the data say."""
    kept = replace(preset.filter, keep_youngest=hypotheses - 1, prune_ratio=0.9, cap=400, certain=1.0)
    return replace(preset, filter=kept)


def as_in_thesis(online: RunLengthFilter, data: Sequence[ModelInput]) -> None:
    """The thesis' update over the same hypotheses; its evidence is that of the filter."""
    position = np.array([observed.position for observed in data])
    force = np.array([observed.force for observed in data])
    reported = thesis_update.step(position, force, online.starts.tolist())
    [evidence] = online.log_evidence.T  # its kinds may repeat, so that the kind before plays no part
    np.testing.assert_allclose(reported, evidence, rtol=1e-9, atol=1e-9)


def peers_rows(data: Sequence[ModelInput]) -> tuple[Sequence[str], list[tuple[object, ...]]]:
    """Each over the same series, beside our filter with the same kind of model."""
    series = [observed.force for observed in data[:200]]
    rows = [(name, axes, 1e6 * taken / len(series)) for name, axes, taken in peers.one_level(series)]
    return ("method", "axes", "µs a step"), rows


def demonstration(n: int) -> list[ModelInput]:
    """Slow moves and presses without end."""
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(n)
    position = 0.1 * np.column_stack([np.sin(t), np.cos(0.7 * t), 0.3 * t]) + rng.normal(0, 5e-4, (n, 3))
    force = np.column_stack([0 * t, 0 * t, 8.0 * (np.sin(0.8 * t) > 0.5)]) + rng.normal(0, 0.2, (n, 3))
    rotation = 0.5 * np.column_stack([np.sin(0.4 * t), 0 * t, 0.2 * t])
    return [ModelInput(*row[:2], np.nan, row[2]) for row in zip(position, force, rotation, strict=True)]


if __name__ == "__main__":
    main()

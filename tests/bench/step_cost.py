"""What a step of the filter costs, against recomputing every hypothesis from its samples as the thesis does.

Both run in this process, alternating, over the same observations and the same living hypotheses.
Prints µs a step and the ratio. Usage: python tests/bench/step_cost.py
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable

import numpy as np
from rich.console import Console
from rich.table import Table

from caesura_service.changepoint.lattice import Lattice
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.presets import PRESETS, Preset

WARM_UP = 150
STEPS = 20


def main() -> None:
    """Measure every preset."""
    table = Table("preset", "hypotheses", "step [µs]", "recomputed [µs]", "ratio")
    for name, preset in sorted(PRESETS.items()):
        table.add_row(name, *measure(preset))
    Console().print(table)
    Console().print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")


def measure(preset: Preset) -> tuple[str, ...]:
    """Median cost of a step, and of recomputing the evidence of the same hypotheses."""
    data = demonstration(WARM_UP + STEPS)
    online = preset.online()
    for observed in data[:WARM_UP]:
        online.step(observed)
    steps, recomputed, living = [], [], []
    for now in range(WARM_UP, WARM_UP + STEPS):
        steps.append(microseconds(lambda now=now: online.step(data[now])))
        starts = online.starts.tolist()
        recomputed.append(
            microseconds(lambda now=now, starts=starts: recompute(online.lattice, data[: now + 1], starts))
        )
        living.append(len(starts))
    step, naive = statistics.median(steps), statistics.median(recomputed)
    return f"{statistics.median(living):.0f}", f"{step:.0f}", f"{naive:.0f}", f"{naive / step:.0f}"


def recompute(lattice: Lattice, data: list[Observed], starts: list[int]) -> None:
    """The evidence of every hypothesis from its samples, one after the other."""
    for start in starts:
        rows = lattice.empty()
        for observed in data[max(start - 1, 0) :]:
            rows = lattice.extend(rows, observed)
            rows = lattice.select(rows, np.array([0]))
        lattice.combine(lattice.kind_log_evidence(rows))


def demonstration(n: int) -> list[Observed]:
    """Slow moves and presses without end."""
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(n)
    position = 0.1 * np.column_stack([np.sin(t), np.cos(0.7 * t), 0.3 * t]) + rng.normal(0, 5e-4, (n, 3))
    force = np.column_stack([0 * t, 0 * t, 8.0 * (np.sin(0.8 * t) > 0.5)]) + rng.normal(0, 0.2, (n, 3))
    return [Observed(*row) for row in zip(position, force, strict=True)]


def microseconds(work: Callable[[], None]) -> float:
    """How long it takes."""
    before = time.perf_counter()
    work()
    return 1e6 * (time.perf_counter() - before)


if __name__ == "__main__":
    main()

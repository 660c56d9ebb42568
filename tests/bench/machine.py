"""What every benchmark shares: the clock, the machine, and where its figures go.

Ratios are of one run on one machine, taken in turn; seconds alone say little. `--json DIR` keeps what was
printed.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

PACKAGES = ("numpy", "scipy", "numba", "eclipse-zenoh")


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def in_turn(*works: Callable[[], object], rounds: int = 5) -> list[float]:
    """Median [s] of each, done one after the other again and again, so that all see the same machine."""
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(rounds):
        for mine, work in zip(taken, works, strict=True):
            mine.append(seconds(work))
    return [statistics.median(mine) for mine in taken]


def machine() -> Mapping[str, Any]:
    """What it ran on."""
    cpu = next(
        (line.partition(":")[2].strip() for line in _cpuinfo() if line.startswith("model name")),
        platform.processor() or platform.machine(),
    )
    return {
        "cpu": cpu,
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


def pace_ms() -> float:
    """How long a fixed piece of Python takes now [ms]: a machine varies by half, within seconds."""
    return 1e3 * min(seconds(_piece) for _ in range(7))


def _piece() -> None:
    counts: dict[int, int] = {}
    for number in range(50_000):
        counts[number % 100] = counts.get(number % 100, 0) + len(str(number))


def _cpuinfo() -> list[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


def options(description: str | None) -> argparse.ArgumentParser:
    """A command line with what all have."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="DIR", help="also write the figures there")
    return parser


def report(
    name: str, title: str, columns: Sequence[str], rows: Sequence[Sequence[object]], directory: Path | None
) -> None:
    """Print a table, and keep it with a description of the machine."""
    table = Table(*columns, title=title)
    for row in rows:
        table.add_row(*(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row))
    Console(width=120).print(table)
    if directory is not None:
        directory.mkdir(parents=True, exist_ok=True)
        figures = [dict(zip(columns, row, strict=True)) for row in rows]
        reported = {"title": title, "machine": machine(), "figures": figures}
        (directory / f"{name}.json").write_text(json.dumps(reported, indent=1, default=str) + "\n")

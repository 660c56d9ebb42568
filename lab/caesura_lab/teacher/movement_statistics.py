"""Statistics of guided movements that need no annotation.

    python -m caesura_lab.teacher.movement_statistics DIR --people 201 203

prints them for the real recordings of a directory, set by set, and for simulated people.
A movement is a stretch above 10 mm/s that no rest of 0.3 s interrupts. Those below 25 mm/s or 10 mm are
corrections and left out, as in the annotation rule.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import find_peaks

from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.scenarios import BASIC
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.constants import GRID_HZ

SMOOTH_S = 0.05
MOVING_M_PER_S, CREEP_M_PER_S = 0.010, 0.002
REST_S = 0.3
SMALL_M_PER_S, SMALL_M = 0.025, 0.010
PEAK_PROMINENCE = 0.15  # of the movement's highest speed
DIP = 0.6  # of the lesser neighbouring peak
EDGE_M_PER_S = (0.005, 0.025)  # between which a start or stop is timed
TREND_S = 0.1  # force that changes faster is noise
FREE_N = 6.0  # a rest with more force may be a contact
RIPPLE_HZ = 1.0  # speed changes slower than this are intended
STEP_TICKS, MEMORY_S = 10, 0.5  # of steps of 0.1 s, whose speed lasts for half a second
SLOW_M_PER_S, FAST_M_PER_S = (0.010, 0.025), (0.200, 0.400)  # at which innovations are read

STATISTICS: Mapping[str, str] = MappingProxyType(
    {
        "duration": "s",
        "length": "m",
        "peak_speed": "m/s",
        "mean_to_peak": "",
        "peaks_per_movement": "",
        "peaks_per_second": "1/s",
        "clear_dips_per_second": "1/s",
        "bow": "of the chord",
        "turn": "rad/m",
        "ripple": "of the speed",
        "innovation_slow": "mm an axis, at 10 to 25 mm/s",
        "innovation_fast": "mm an axis, at 200 to 400 mm/s",
        "start_edge": "s",
        "stop_edge": "s",
        "creep_share": "of the rest",
        "creep_speed": "mm/s",
        "force_noise": "N, in motion",
        "rest_force": "N, its range over rests",
    }
)


def velocity_on_grid(t: Array, position: Array) -> tuple[Array, Array]:
    """Velocity (n, 3) [m/s] on a grid (n,) [s] of 100 Hz, smoothed by a Gaussian of 50 ms. t: (m,) rising."""
    grid = np.arange(t[0], t[-1], 1.0 / GRID_HZ)
    even = np.column_stack([np.interp(grid, t, axis) for axis in position.T])
    smooth = gaussian_filter1d(even, SMOOTH_S * GRID_HZ, axis=0, mode="nearest")
    velocity: Array = np.gradient(smooth, 1.0 / GRID_HZ, axis=0)
    return grid, velocity


def movement_spans(speed: Array) -> list[tuple[int, int]]:
    """Grid indices, first to last (exclusive), of each movement in a speed (n,) [m/s]."""
    joined: list[tuple[int, int]] = []
    for first, last in _runs(speed > MOVING_M_PER_S):
        if joined and first - joined[-1][1] < REST_S * GRID_HZ:
            first = joined.pop()[0]
        joined.append((first, last))
    return [
        (a, b) for a, b in joined if speed[a:b].max() > SMALL_M_PER_S and speed[a:b].sum() / GRID_HZ > SMALL_M
    ]


def measure(t: Array, position: Array, force: Array) -> dict[str, list[float]]:
    """Measure every statistic of `STATISTICS`: one value per movement.

    Creep and rests have one value per recording, innovations one per step of 0.1 s. t: (m,) [s], rising;
    position: (m, 3) [m]; force: (m, 3) [N].
    """
    grid, velocity = velocity_on_grid(t, position)
    force_on_grid = np.column_stack([np.interp(grid, t, axis) for axis in force.T])
    speed = np.linalg.norm(velocity, axis=1)
    spans = movement_spans(speed)
    statistics: dict[str, list[float]] = {name: [] for name in STATISTICS}
    for first, last in spans:
        for name, value in _movement(velocity[first:last]).items():
            statistics[name].append(value)
    for name, side in (("start_edge", -1), ("stop_edge", 1)):
        statistics[name] = [edge for span in spans if (edge := _edge(speed, span, side)) is not None]
    statistics |= _creep(speed, spans) | _forces(force_on_grid, spans) | _innovations(velocity)
    return {name: [v for v in values if np.isfinite(v)] for name, values in statistics.items()}


def _forces(force: Array, spans: list[tuple[int, int]]) -> dict[str, list[float]]:
    """Noise of a force (n, 3) in each movement, and by how much its level differs between rests."""
    fast = force - uniform_filter1d(force, round(TREND_S * GRID_HZ), axis=0, mode="nearest")
    edges = [0, *(edge for span in spans for edge in span), len(force)]
    rests = [force[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > REST_S * GRID_HZ]
    levels = [level for r in rests if np.linalg.norm(level := np.median(r, axis=0)) < FREE_N]
    ranges = [float(np.linalg.norm(np.ptp(np.array(levels), axis=0)))] if len(levels) > 1 else []
    return {"force_noise": [float(fast[a:b].std()) for a, b in spans], "rest_force": ranges}


def _innovations(velocity: Array) -> dict[str, list[float]]:
    """Return innovations [mm] of steps u of 0.1 s, |u_t − 2ρ u_{t−1} + ρ² u_{t−2}| / √3, by speed range."""
    whole = len(velocity) // STEP_TICKS
    steps = velocity[: whole * STEP_TICKS].reshape(whole, STEP_TICKS, 3).sum(axis=1) / GRID_HZ
    rho = np.exp(-STEP_TICKS / GRID_HZ / MEMORY_S)
    new = np.linalg.norm(steps[2:] - 2.0 * rho * steps[1:-1] + rho**2 * steps[:-2], axis=1) / np.sqrt(3.0)
    speed = np.linalg.norm(steps[1:-1], axis=1) * GRID_HZ / STEP_TICKS
    speed_ranges = {"innovation_slow": SLOW_M_PER_S, "innovation_fast": FAST_M_PER_S}
    return {
        name: (1e3 * new[(speed >= low) & (speed < high)]).tolist()
        for name, (low, high) in speed_ranges.items()
    }


def _movement(velocity: Array) -> dict[str, float]:
    speed = np.linalg.norm(velocity, axis=1)
    seconds, length = len(speed) / GRID_HZ, float(speed.sum()) / GRID_HZ
    peaks, dips = speed_peaks(speed), clear_dips(speed)
    slow = gaussian_filter1d(speed, 0.19 * GRID_HZ / RIPPLE_HZ, mode="nearest")
    middle = speed > 0.3 * speed.max()
    return {
        "duration": seconds,
        "length": length,
        "peak_speed": float(speed.max()),
        "mean_to_peak": float(speed.mean() / speed.max()),
        "peaks_per_movement": float(peaks),
        "peaks_per_second": peaks / seconds,
        "clear_dips_per_second": len(dips) / seconds,
        "bow": _bow(velocity, dips),
        "turn": _turn(velocity),
        "ripple": float(np.std((speed / slow)[middle])),
    }


def speed_peaks(speed: Array) -> int:
    """Count the peaks of a speed (n,); lesser ones count if they stand out by 15 % of the highest."""
    padded = np.concatenate([[0.0], speed, [0.0]])
    return len(find_peaks(padded, prominence=PEAK_PROMINENCE * speed.max())[0])


def clear_dips(speed: Array) -> list[int]:
    """Indices of the lowest speed between two peaks that are clearly faster, by the annotation rule."""
    minima: list[int] = []
    peak, low = 0.0, 0
    for index, value in enumerate(speed.tolist()):
        if value < speed[low]:
            low = index
        elif speed[low] < DIP * min(peak, value) and min(peak, value) > SMALL_M_PER_S:
            minima.append(low)
            peak, low = value, index
        if value > peak:
            peak, low = value, index
    return minima


def _bow(velocity: Array, dips: list[int]) -> float:
    """Largest distance from the chord as a share of the chord, of the longest stroke between clear dips."""
    path = np.cumsum(velocity, axis=0) / GRID_HZ
    edges = [0, *dips, len(path) - 1]
    first, last = max(pairwise(edges), key=lambda e: _way(path[e[0] : e[1] + 1]))
    stroke = path[first : last + 1] - path[first]
    chord = float(np.linalg.norm(stroke[-1]))
    if chord < SMALL_M:
        return np.nan
    along = stroke @ (stroke[-1] / chord)
    aside = stroke - along[:, None] * stroke[-1] / chord
    return float(np.linalg.norm(aside, axis=1).max() / chord)


def _turn(velocity: Array) -> float:
    """Change of direction [rad] a metre, where the speed exceeds 25 mm/s."""
    speed = np.linalg.norm(velocity, axis=1)
    fast = (speed[1:] > SMALL_M_PER_S) & (speed[:-1] > SMALL_M_PER_S)
    cosine = np.sum(velocity[1:] * velocity[:-1], axis=1) / np.maximum(speed[1:] * speed[:-1], 1e-12)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))[fast].sum()
    return float(angle / max(speed[1:][fast].sum() / GRID_HZ, 1e-9))


def _edge(speed: Array, span: tuple[int, int], side: int) -> float | None:
    """Time [s] between 5 and 25 mm/s at the start (-1) or stop (1) of a movement; None where cut off."""
    first, last = span
    inside = np.flatnonzero(speed[first:last] > EDGE_M_PER_S[1])
    outside = np.flatnonzero(speed[:first] < EDGE_M_PER_S[0]) if side < 0 else None
    if outside is None:
        after = np.flatnonzero(speed[last:] < EDGE_M_PER_S[0])
        return (last - first + after[0] - inside[-1]) / GRID_HZ if after.size else None
    return (first + inside[0] - outside[-1]) / GRID_HZ if outside.size else None


def _creep(speed: Array, spans: list[tuple[int, int]]) -> dict[str, list[float]]:
    """Measure the share of the rest that creeps (2 to 10 mm/s), and its median speed [mm/s]."""
    rest = np.ones(speed.size, dtype=bool)
    for first, last in spans:
        rest[first:last] = False
    creeping = rest & (speed > CREEP_M_PER_S) & (speed < MOVING_M_PER_S)
    if rest.sum() < REST_S * GRID_HZ:
        return {"creep_share": [], "creep_speed": []}
    speeds = [float(1e3 * np.median(speed[creeping]))] if creeping.any() else []
    return {"creep_share": [float(creeping.sum() / rest.sum())], "creep_speed": speeds}


def _way(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def real_statistics(directory: Path) -> dict[str, dict[str, list[float]]]:
    """Measure the recordings of a directory; set → statistic → values. A file's first word names its set."""
    found: dict[str, dict[str, list[float]]] = {}
    for file in sorted(directory.glob("*.npz")):
        recording = load_recording(file)
        _collect(found.setdefault(file.stem.split("_")[0], {}), recording)
    return found


def simulated_statistics(seeds: Sequence[int], *, natural: bool) -> dict[str, list[float]]:
    """Measure every scenario by people, the hand in the wrench; statistic → values."""
    # Pinocchio takes a second to load: only for who teaches.
    from caesura_lab.teacher.simulated_teaching import teach  # noqa: PLC0415

    found: dict[str, list[float]] = {}
    for scenario in BASIC:
        for seed in seeds:
            taught = teach(scenario, seed=seed, wrench_source="flange_sensor_with_hand", natural=natural)
            _collect(found, taught.recording)
    return found


def _collect(found: dict[str, list[float]], recording: Recording) -> None:
    t, first = np.unique(recording.t, return_index=True)
    signals = recording.signals
    for name, values in measure(t, signals["pos"][first], signals["force"][first]).items():
        found.setdefault(name, []).extend(values)


def main(arguments: Sequence[str]) -> None:
    """Print the statistics of real recordings and simulated people as a Markdown table."""
    parser = ArgumentParser(description="Statistics of guided movements: median (10 % to 90 %).")
    parser.add_argument("directory", type=Path, help="Directory of real recordings (.npz).")
    parser.add_argument("--people", type=int, nargs=2, default=(201, 203), help="First and last seed.")
    options = parser.parse_args(arguments)
    seeds = range(options.people[0], options.people[1] + 1)
    columns = real_statistics(options.directory)
    columns["ideal"] = simulated_statistics(seeds, natural=False)
    columns["habits"] = simulated_statistics(seeds, natural=True)
    sys.stdout.write("\n".join(_lines(columns)) + "\n")


def _lines(columns: Mapping[str, Mapping[str, list[float]]]) -> Iterator[str]:
    yield "| " + " | ".join(["statistic", *columns]) + " |"
    yield "|---" * (1 + len(columns)) + "|"
    for name, unit in STATISTICS.items():
        cells = [_cell(statistics[name]) for statistics in columns.values()]
        yield "| " + " | ".join([f"{name} [{unit}]" if unit else name, *cells]) + " |"


def _cell(values: Sequence[float]) -> str:
    if not values:
        return "–"
    low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
    return f"{middle:.2g} ({low:.2g}–{high:.2g})"


if __name__ == "__main__":
    main(sys.argv[1:])

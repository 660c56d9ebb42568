"""Statistics of a demonstration, by which real hand-guided recordings are described.

    python -m caesura_lab.teacher.annotated_recording_statistics data/*.npz

measures recordings that have their annotation (`.ann.json`) beside them, real ones too. A statistic that does
not apply to a recording (a contact in a motion without one) is missing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.constants import GRID_HZ

MARGIN_S = 0.15  # kept away from boundaries when noise is measured
TREND_S = 0.1  # slower than this is signal, faster is noise
IMPACT_S = 0.15
RELEASE_S = 0.8  # looked at before the end of a contact
RISE_TO_N = 8.0

# Unit, and the range in real recordings (the statistics of several robots that this simulation was built to).
STATISTICS: dict[str, tuple[str, str]] = {
    "position_noise": ("µm", "2 to 15"),
    "force_noise_rest": ("N", "0.02 to 0.2"),
    "force_noise_motion": ("N", "0.1 to 1"),
    "peak_speed": ("m/s", "0.02 to 0.4"),
    "move": ("s", "0.3 to 3.4, median 1.4"),
    "pause": ("s", "0.13 to 4.6, median 1.3"),
    "rise_to_8N": ("s", "0.1"),
    "release": ("s", "0.2 to 0.4"),
    "impact": ("N", "25 to 118"),
    "wander": ("N", "2.3 median"),
    "half_power": ("Hz", "0.8"),
    "power_90": ("Hz", "5.5"),
}


def measure(recording: Recording, truth: dict[str, Any]) -> dict[str, list[float]]:
    """Return the values of each statistic of `STATISTICS` that applies, by name, one for each occurrence."""
    t, pos = _gridded(recording.t, recording.signals["pos"])
    rests = [s for s in truth["segments"] if s["cls"] in ("steady", "hold")]
    moves = [s for s in truth["segments"] if s["cls"] in ("motion", "transport", "sliding")]
    speed = np.linalg.norm(savgol_filter(pos, 11, 2, deriv=1, delta=1 / GRID_HZ, axis=0), axis=1)
    statistics = {
        "position_noise": [1e6 * _noise(pos[_inside(t, s)]) for s in rests],
        "peak_speed": [float(speed[_inside(t, s, 0.0)].max()) for s in moves],
        "move": _lengths(moves),
        "pause": _lengths(rests),
    }
    if "force" in recording.signals:
        statistics |= _forces(recording, truth, rests, moves)
    return {name: [v for v in values if np.isfinite(v)] for name, values in statistics.items()}


def _forces(
    recording: Recording, truth: dict[str, Any], rests: list[dict[str, Any]], moves: list[dict[str, Any]]
) -> dict[str, list[float]]:
    t, force = recording.t, recording.signals["force"]
    free = [s for s in moves + rests if s["cls"] in ("motion", "steady")]
    statistics = {
        "force_noise_rest": [_fast(t, force, s) for s in rests],
        "force_noise_motion": [_fast(t, force, s) for s in moves if s["cls"] != "sliding"],
    }
    if truth.get("hand_force_in_wrench"):
        return statistics | dict(zip(("half_power", "power_90"), _power(t, force), strict=True))
    levels = np.array([np.median(force[_inside(t, s)], axis=0) for s in free if _inside(t, s).any()])
    statistics["wander"] = [float(np.linalg.norm(np.ptp(levels, axis=0)))]
    for contact in truth.get("forces", []):
        statistics.setdefault("impact", []).append(_impact(t, force, contact))
        statistics.setdefault("rise_to_8N", []).append(_rise(t, force, contact))
        statistics.setdefault("release", []).append(_release(t, force, contact))
    return statistics


def _impact(t: Array, force: Array, contact: dict[str, float]) -> float:
    """Highest force [N] in the first moments of a contact."""
    first = (t >= contact["t0"]) & (t < contact["t0"] + IMPACT_S)
    return float(np.linalg.norm(force[first], axis=1).max())


def _rise(t: Array, force: Array, contact: dict[str, float]) -> float:
    """Time [s] from the touch to 8 N."""
    size = np.linalg.norm(force, axis=1)
    reached = np.flatnonzero((t >= contact["t0"]) & (t < contact["t1"]) & (size > RISE_TO_N))
    return float(t[reached[0]] - contact["t0"]) if reached.size else np.nan


def _release(t: Array, force: Array, contact: dict[str, float]) -> float:
    """Time [s] that the force at the end of a contact takes to go."""
    end = (t > contact["t1"] - RELEASE_S) & (t < contact["t1"])
    size = np.linalg.norm(force[end], axis=1)
    held = np.flatnonzero(size > 0.9 * np.quantile(size, 0.9))
    return float(contact["t1"] - t[end][held[-1]])


def _power(t: Array, force: Array) -> tuple[list[float], list[float]]:
    """Frequencies [Hz] below which half and 90 % of the power of the force lie, its mean left out."""
    _, even = _gridded(t, force)
    power = np.sum(np.abs(np.fft.rfft(even - even.mean(axis=0), axis=0)) ** 2, axis=1)
    share, hertz = np.cumsum(power) / np.sum(power), np.fft.rfftfreq(len(even), 1 / GRID_HZ)
    half, most = (float(np.interp(s, share, hertz)) for s in (0.5, 0.9))
    return [half], [most]


def _fast(t: Array, force: Array, segment: dict[str, Any]) -> float:
    """Standard deviation [N] an axis of what changes faster than the trend."""
    part = force[_inside(t, segment)]
    if len(part) < 0.2 / np.median(np.diff(t)):
        return np.nan
    trend = uniform_filter1d(part, round(TREND_S / float(np.median(np.diff(t)))), axis=0, mode="nearest")
    return float((part - trend).std(axis=0).mean())


def _noise(values: Array) -> float:
    """Standard deviation of white noise [unit] on a slow signal, from its second differences."""
    if len(values) < GRID_HZ // 5:
        return np.nan
    return float(np.median(np.abs(np.diff(values, 2, axis=0))) / 0.6745 / np.sqrt(6.0))


def _inside(t: Array, segment: dict[str, Any], margin: float = MARGIN_S) -> Any:
    return (t >= segment["t0"] + margin) & (t <= segment["t1"] - margin)


def _lengths(segments: list[dict[str, Any]]) -> list[float]:
    return [s["t1"] - s["t0"] for s in segments]


def _gridded(t: Array, values: Array) -> tuple[Array, Array]:
    """Nearest samples on a grid of 100 Hz."""
    grid = np.arange(t[0], t[-1], 1 / GRID_HZ)
    return grid, values[np.searchsorted(t, grid)]


def _rows(statistics: dict[str, list[float]]) -> Iterable[tuple[str, ...]]:
    for name, (unit, real) in STATISTICS.items():
        if values := statistics.get(name):
            low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
            yield f"{name} [{unit}]", f"{low:.3g} to {high:.3g}, median {middle:.3g}", real


def main(files: list[str]) -> None:
    """Print the statistics of all files together beside those of real recordings."""
    together: dict[str, list[float]] = {}
    for file in map(Path, files):
        truth = json.loads(file.with_suffix(".ann.json").read_text(encoding="utf-8"))
        for name, values in measure(load_recording(file), truth).items():
            together.setdefault(name, []).extend(values)
    table = Table("statistic", "measured", "real recordings")
    for row in _rows(together):
        table.add_row(*map(Text, row))
    Console().print(table)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Degrades a recording as poorer sensors and clocks would: lower rate, noise, steps and delays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.formats.episode_frames import values_at
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]
POSE = ("pos", "quat", "q")
WRENCH = ("force", "torque")
JITTER_S = 0.05  # for which a time that is off stays off
STALLS_PER_S = 0.5
GRID_HZ = 100.0
ROUNDED_S = 1e-9  # of times that are equal


def _as_recorded(recording: Recording, _: np.random.Generator) -> Recording:
    return recording


def _begun_later(later_s: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Leave out the first samples, which changes the phase of the grid."""
    first = int(np.searchsorted(recording.t, recording.t[0] + later_s))
    return rows_of(recording, np.arange(first, len(recording.t)))


def _at_rate(rate_hz: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Keep the first sample at or after each tick."""
    t = recording.t
    return rows_of(recording, np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 1.0 / rate_hz))))


def _without_some(share: float, recording: Recording, rng: np.random.Generator) -> Recording:
    return rows_of(recording, np.flatnonzero(rng.random(len(recording.t)) >= share))


def _with_noise(
    signals: Sequence[str], deviation: float, recording: Recording, rng: np.random.Generator
) -> Recording:
    return _changed(recording, signals, lambda values: values + deviation * rng.standard_normal(values.shape))


def _in_steps(signals: Sequence[str], step: float, recording: Recording, _: np.random.Generator) -> Recording:
    return _changed(recording, signals, lambda values: step * np.round(values / step))


def _late_wrench(delay_s: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Delay the wrench."""
    rows = np.searchsorted(recording.t, recording.t - delay_s - ROUNDED_S)
    return _changed(recording, WRENCH, lambda values: values[rows])


def _with_drift(drift_n: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Let each axis of the force drift linearly from beginning to end."""
    share = (recording.t - recording.t[0]) / max(float(np.ptp(recording.t)), 1e-9)
    return _changed(recording, ("force",), lambda values: values + drift_n * share[:, None])


def _with_jitter(deviation_s: float, recording: Recording, rng: np.random.Generator) -> Recording:
    """Add autoregressive errors with a time constant of `JITTER_S` to the times of samples."""
    steps = np.diff(recording.t, prepend=recording.t[0])
    kept = np.exp(-np.maximum(steps, 0.0) / JITTER_S)
    off, fresh = np.zeros(len(kept)), rng.standard_normal(len(kept))
    for i in range(1, len(kept)):
        off[i] = kept[i] * off[i - 1] + np.sqrt(1.0 - kept[i] ** 2) * fresh[i]
    return replace(recording, signals=_read(recording, recording.t + deviation_s * off, recording.signals))


def _with_stalls(duration_s: float, recording: Recording, rng: np.random.Generator) -> Recording:
    """Let the pose freeze for a while, `STALLS_PER_S` times a second at random."""
    first, last = float(recording.t[0]), float(recording.t[-1])
    measured_s = recording.t.copy()
    for begun in rng.uniform(first, last, rng.poisson(STALLS_PER_S * (last - first))):
        measured_s[(recording.t >= begun) & (recording.t < begun + duration_s)] = begun
    return replace(recording, signals=dict(recording.signals) | _read(recording, measured_s, POSE))


def _with_held_pose(read_hz: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Let a clock of `GRID_HZ` repeat a pose that is read more seldom; the wrench is read at each tick."""
    first, last = float(recording.t[0]), float(recording.t[-1])
    ticks = np.arange(first, last, 1.0 / GRID_HZ)
    read_s = first + np.floor((ticks - first) * read_hz + ROUNDED_S) / read_hz
    signals = _read(recording, ticks, recording.signals) | _read(recording, read_s, POSE)
    return replace(recording, t=ticks, signals=signals)


def _read(recording: Recording, times: Array, names: Iterable[str]) -> dict[str, Array]:
    """Return the existing signals at other times [s] within the recording."""
    within = np.clip(times, recording.t[0], recording.t[-1])
    return {
        name: values_at(within, recording.t, recording.signals[name], name)
        for name in names
        if name in recording.signals
    }


def rows_of(recording: Recording, rows: NDArray[np.int64]) -> Recording:
    """Return a recording of only these samples. rows: their indices."""
    signals = {name: values[rows] for name, values in recording.signals.items()}
    return replace(recording, t=recording.t[rows], signals=signals)


def _changed(recording: Recording, names: Sequence[str], change: Callable[[Array], Array]) -> Recording:
    signals = {
        name: change(values) if name in names else values for name, values in recording.signals.items()
    }
    return replace(recording, signals=signals)


# What is done to a recording, by name; positions are in metres.
CONDITIONS: Mapping[str, Callable[[Recording, np.random.Generator], Recording]] = {
    "as recorded": _as_recorded,
    "begun 25 ms later": partial(_begun_later, 0.025),
    "begun 50 ms later": partial(_begun_later, 0.05),
    "begun 75 ms later": partial(_begun_later, 0.075),
    "50 Hz": partial(_at_rate, 50.0),
    "20 Hz": partial(_at_rate, 20.0),
    "10 Hz": partial(_at_rate, 10.0),
    "a tenth of the samples lost": partial(_without_some, 0.1),
    "position noise 0.5 mm": partial(_with_noise, ("pos",), 0.0005),
    "position noise 1 mm": partial(_with_noise, ("pos",), 0.001),
    "position in steps of 1 mm": partial(_in_steps, ("pos",), 0.001),
    "times off by 10 ms": partial(_with_jitter, 0.01),
    "pose stands still for 0.1 s": partial(_with_stalls, 0.1),
    "pose read at 15 Hz, held at 100 Hz": partial(_with_held_pose, 15.0),
    "wrench 0.1 s late": partial(_late_wrench, 0.1),
    "force noise 1 N": partial(_with_noise, ("force",), 1.0),
    "force in steps of 0.5 N": partial(_in_steps, ("force",), 0.5),
    "force drifts by 2 N": partial(_with_drift, 2.0),
}

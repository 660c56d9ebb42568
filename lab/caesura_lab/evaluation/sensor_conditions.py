"""A recording as poorer sensors would have made it: at a lower rate, with noise, steps and delays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import Recording

Array = NDArray[np.float64]
WRENCH = ("force", "torque")
ROUNDED_S = 1e-9  # of times that are equal


def _as_recorded(recording: Recording, _: np.random.Generator) -> Recording:
    return recording


def _at_rate(rate_hz: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Keep the first sample at or after each tick."""
    t = recording.t
    return _rows(recording, np.unique(np.searchsorted(t, np.arange(t[0], t[-1], 1.0 / rate_hz))))


def _without_some(share: float, recording: Recording, rng: np.random.Generator) -> Recording:
    return _rows(recording, np.flatnonzero(rng.random(len(recording.t)) >= share))


def _with_noise(
    signals: Sequence[str], deviation: float, recording: Recording, rng: np.random.Generator
) -> Recording:
    return _changed(recording, signals, lambda values: values + deviation * rng.standard_normal(values.shape))


def _in_steps(signals: Sequence[str], step: float, recording: Recording, _: np.random.Generator) -> Recording:
    return _changed(recording, signals, lambda values: step * np.round(values / step))


def _late_wrench(delay_s: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Show the wrench of a time ago."""
    rows = np.searchsorted(recording.t, recording.t - delay_s - ROUNDED_S)
    return _changed(recording, WRENCH, lambda values: values[rows])


def _with_drift(drift_n: float, recording: Recording, _: np.random.Generator) -> Recording:
    """Let each axis of the force drift evenly from beginning to end."""
    share = (recording.t - recording.t[0]) / max(float(np.ptp(recording.t)), 1e-9)
    return _changed(recording, ("force",), lambda values: values + drift_n * share[:, None])


def _rows(recording: Recording, rows: NDArray[np.int64]) -> Recording:
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
    "50 Hz": partial(_at_rate, 50.0),
    "20 Hz": partial(_at_rate, 20.0),
    "10 Hz": partial(_at_rate, 10.0),
    "a tenth of the samples lost": partial(_without_some, 0.1),
    "position noise 0.5 mm": partial(_with_noise, ("pos",), 0.0005),
    "position noise 1 mm": partial(_with_noise, ("pos",), 0.001),
    "position in steps of 1 mm": partial(_in_steps, ("pos",), 0.001),
    "wrench 0.1 s late": partial(_late_wrench, 0.1),
    "force noise 1 N": partial(_with_noise, ("force",), 1.0),
    "force in steps of 0.5 N": partial(_in_steps, ("force",), 0.5),
    "force drifts by 2 N": partial(_with_drift, 2.0),
}

"""A part of a demonstration, as where a recording was begun or cut late: in motion, or in contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from caesura_lab.annotations import MeasuredQuantity, ScrewStroke, TrueSegment, Truth
from caesura_lab.evaluation.sensor_conditions import rows_of
from caesura_protocol.recording import Recording

Stretch = TypeVar("Stretch", TrueSegment, MeasuredQuantity, ScrewStroke)
# From which share of a demonstration to which.
WINDOWS: Mapping[str, tuple[float, float]] = {
    "whole": (0.0, 1.0),
    "from a quarter on": (0.25, 1.0),
    "from the half on": (0.5, 1.0),
    "until three quarters": (0.0, 0.75),
    "the middle half": (0.25, 0.75),
}


def in_window(recording: Recording, truth: Truth, window: str) -> tuple[Recording, Truth]:
    """Return recording and truth in one of WINDOWS."""
    begun, lasts = float(recording.t[0]), float(recording.t[-1] - recording.t[0])
    low, high = (begun + share * lasts for share in WINDOWS[window])
    inside = np.flatnonzero((recording.t >= low) & (recording.t <= high))
    low, high = max(low, truth.window[0]), min(high, truth.window[1])
    left = replace(
        truth,
        window=(low, high),
        points=tuple(one for one in truth.points if low <= one.t <= high),
        spans=_within(truth.spans, low, high),
        loads=_within(truth.loads, low, high),
        forces=_within(truth.forces, low, high),
        phases=_within(truth.phases, low, high),
        screws=_within(truth.screws, low, high),
    )
    return rows_of(recording, inside), left


def _within(stretches: Sequence[Stretch], low: float, high: float) -> tuple[Stretch, ...]:
    """What of some stretches lies between two times [s]."""
    return tuple(
        replace(one, t0=max(one.t0, low), t1=min(one.t1, high))
        for one in stretches
        if one.t0 < high and one.t1 > low
    )

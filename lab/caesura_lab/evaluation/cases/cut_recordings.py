"""Parts of a demonstration, as if the recording began or ended in motion or in contact."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from caesura_lab.evaluation.cases.sensor_conditions import rows_of
from caesura_lab.ground_truth import Truth
from caesura_protocol.recording import Recording

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
    return rows_of(recording, inside), truth.within(low, high)

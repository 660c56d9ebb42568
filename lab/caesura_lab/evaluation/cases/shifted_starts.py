"""Demonstrations that begin a moment later, so that their observations, ten a second, are at other times.

The phase of the observations is arbitrary, so a result should not depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from caesura_lab.evaluation.cases.sensor_conditions import rows_of
from caesura_lab.ground_truth import Truth
from caesura_protocol.recording import Recording

STARTS: Mapping[str, float] = {  # by how much it begins later [s]
    "at once": 0.0,
    "20 ms later": 0.02,
    "40 ms later": 0.04,
    "60 ms later": 0.06,
    "80 ms later": 0.08,
}


def with_shifted_start(recording: Recording, truth: Truth, start: str) -> tuple[Recording, Truth]:
    """Return recording and truth without what lies before one of STARTS."""
    begins = float(recording.t[0]) + STARTS[start]
    return rows_of(recording, np.flatnonzero(recording.t >= begins)), truth.within(begins, float("inf"))

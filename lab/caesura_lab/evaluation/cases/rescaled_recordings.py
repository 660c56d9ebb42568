"""Changes the tempo and size of a demonstration, as persons with other habits would.

It is slower or faster, smaller or larger.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from caesura_lab.ground_truth import Truth
from caesura_protocol.recording import Recording

# How much longer it takes, and how much larger its path is.
TEMPI: Mapping[str, tuple[float, float]] = {
    "half the time": (0.5, 1.0),
    "two thirds of the time": (2.0 / 3.0, 1.0),
    "as recorded": (1.0, 1.0),
    "1.25 times the time": (1.25, 1.0),
    "1.5 times the time": (1.5, 1.0),
    "half the size": (1.0, 0.5),
    "twice the size": (1.0, 2.0),
}


def in_tempo(recording: Recording, truth: Truth, tempo: str) -> tuple[Recording, Truth]:
    """Return recording and truth in one of TEMPI.

    The wrench is unchanged, joints of a scaled path are removed. Joints without positions are the path, and
    are scaled.
    """
    duration, size = TEMPI[tempo]
    begun = float(recording.t[0])

    def time_of(t: float) -> float:
        return begun + duration * (t - begun)

    signals = dict(recording.signals)
    if size != 1.0:
        path = "pos" if "pos" in signals else "q"
        middle = signals[path].mean(axis=0)
        signals[path] = middle + size * (signals[path] - middle)
        if path == "pos":
            signals.pop("q", None)
    retimed = replace(recording, t=begun + duration * (recording.t - begun), signals=signals)
    return retimed, truth.at_times(time_of)

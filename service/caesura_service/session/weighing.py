"""The load of a stretch: its vertical force against that of free space before and after.

A sensor's bias wanders by newtons within a recording, a 60 g object weighs 0.6 N: so the force while
something is carried is compared with free space on either side of it, not with zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from caesura_service.changepoint.levels import GRAVITY
from caesura_service.changepoint.segments import Stretch
from caesura_service.session.history import History

LEAST_BASELINE = 3  # observations of free space that a baseline needs
EDGE = 2  # observations at either end of a stretch that belong to the transition
DEPENDENT = 4.0  # forces stay alike for 0.2 s, so that many observations count as one
BIAS_N = 1.5  # what the bias may be where there is no free space to compare with
WANDER_N = 0.5  # what it may have wandered by where there is free space on one side only


@dataclass(frozen=True)
class Load:
    """What is carried [kg], and the standard deviation of that."""

    kg: float
    sd_kg: float


def is_baseline(stretch: Stretch) -> bool:
    """Is this enough free space to compare with?"""
    return stretch.verdict.kind.contact == "free" and stretch.end - stretch.start >= LEAST_BASELINE


def weigh(stretches: Sequence[Stretch], index: int, history: History) -> Load | None:
    """The load of a stretch in which something is carried; None for any other."""
    if stretches[index].verdict.kind.contact != "transport":
        return None
    mean, variance = _vertical(stretches[index], history)
    sides = (stretches[:index][::-1], stretches[index + 1 :])
    nearest = [next((s for s in side if is_baseline(s)), None) for side in sides]
    baselines = [_vertical(s, history) for s in nearest if s is not None]
    zero = float(np.mean([m for m, _ in baselines])) if baselines else 0.0
    noise = variance + float(np.mean([v for _, v in baselines])) if baselines else variance
    sd = np.sqrt(noise + _bias_sd([m for m, _ in baselines]) ** 2)
    return Load(max(-(mean - zero) / GRAVITY, 0.0), float(sd) / GRAVITY)


def _bias_sd(means: list[float]) -> float:
    match means:
        case []:
            return BIAS_N
        case [_]:
            return WANDER_N
    return float(abs(means[1] - means[0]) / np.sqrt(12.0))


def _vertical(stretch: Stretch, history: History) -> tuple[float, float]:
    """Mean vertical force [N] away from the edges, and the variance of that mean [N²]."""
    edge = EDGE if stretch.end - stretch.start > 3 * EDGE else 0
    start, end = stretch.start + edge, stretch.end - edge
    mean, variance = history.vertical_force(start, end)
    return mean, variance * DEPENDENT / (end - start)

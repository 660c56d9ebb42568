"""Estimates the load of a segment from its vertical force relative to free space before and after.

A sensor's bias drifts by newtons within a recording, and a 60 g object weighs 0.6 N. So the force during a
carry is compared with free space on either side of it, not with zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from caesura_service.changepoint.segments import InferredSegment
from caesura_service.constants import GRAVITY
from caesura_service.program.interpretation.carried_loads import HANGING_ASIDE, HANGING_N
from caesura_service.segmentation.observation_store import ObservationStore

LEAST_BASELINE = 3  # observations of free space that a baseline needs
EDGE = 2  # observations at either end of a stretch that belong to the transition
DEPENDENT = 4.0  # forces stay alike for 0.2 s, so that many observations count as one
MOST_BIASES = 1.3  # free space that reads more than this many scales of the bias is something else
WANDER_N = 0.5  # what it may have wandered by where there is free space on one side only


@dataclass(frozen=True)
class Load:
    """A load that is carried [kg], and its standard deviation [kg]."""

    kg: float
    sd_kg: float


def is_baseline(stretch: InferredSegment, history: ObservationStore, bias_n: float) -> bool:
    """Return whether a segment is free space with which a load can be compared.

    It has at least LEAST_BASELINE observations, and no force beyond a bias of scale bias_n [N].
    """
    if stretch.verdict.kind.contact != "free" or stretch.end - stretch.start < LEAST_BASELINE:
        return False
    return abs(_vertical(stretch, history)[0]) <= MOST_BIASES * bias_n


def weigh(
    stretches: Sequence[InferredSegment], index: int, history: ObservationStore, bias_n: float
) -> Load | None:
    """Return the load of a segment in which something is carried; None for any other.

    bias_n [N]: scale of the force in free space.
    """
    if stretches[index].verdict.kind.contact != "transport":
        return None
    mean, variance = _vertical(stretches[index], history)
    sides = (reversed(stretches[:index]), stretches[index + 1 :])
    nearest = [next((s for s in side if is_baseline(s, history, bias_n)), None) for side in sides]
    beside = [s for s in nearest if s is not None]
    if len(beside) > 1 and history.holding_states(stretches[index].start, stretches[index].end) is None:
        beside = _without_hidden_load(beside, history)
    baselines = [_vertical(s, history) for s in beside]
    means, variances = [m for m, _ in baselines], [v for _, v in baselines]
    zero, noise = (sum(values) / max(len(values), 1) for values in (means, variances))
    sd = math.hypot(math.sqrt(variance + noise), _bias_sd(means, bias_n))
    return Load(max(-(mean - zero) / GRAVITY, 0.0), sd / GRAVITY)


def _without_hidden_load(
    beside: Sequence[InferredSegment], history: ObservationStore
) -> list[InferredSegment]:
    """Return the free space on both sides of a load, without a side on which a light load hangs.

    Without a gripper's state a light load is shown as free space. It hangs straight down, compared with the
    other side; a bias wanders in any direction.
    """
    low, high = sorted(beside, key=lambda one: _vertical(one, history)[0])
    down_n = _vertical(high, history)[0] - _vertical(low, history)[0]
    apart = history.mean_force(high.start, high.end) - history.mean_force(low.start, low.end)
    aside_n = math.sqrt(max(float(apart @ apart) - down_n * down_n, 0.0))
    hangs = down_n >= HANGING_N and aside_n <= HANGING_ASIDE * down_n
    return [high] if hangs else [*beside]


def _bias_sd(means: list[float], bias_n: float) -> float:
    match means:
        case []:
            return bias_n
        case [_]:
            return WANDER_N
    return abs(means[1] - means[0]) / math.sqrt(12.0)


def _vertical(stretch: InferredSegment, history: ObservationStore) -> tuple[float, float]:
    """Return the mean vertical force [N] away from the edges, and the variance of that mean [N²]."""
    edge = EDGE if stretch.end - stretch.start > 3 * EDGE else 0
    start, end = stretch.start + edge, stretch.end - edge
    mean, variance = history.vertical_force(start, end)
    return mean, variance * DEPENDENT / (end - start)

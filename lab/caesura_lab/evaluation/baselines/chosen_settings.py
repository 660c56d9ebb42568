"""Settings of the baselines that have no principle for them, chosen on the simulated teacher.

    python -m caesura_lab.evaluation.baselines.baseline_settings_search --seeds 20 --first-seed 500

chose them when simulated people had no habits, and states their F1 beside those that it finds now. No real
recording is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class GaussianSettings:
    """Settings of Bayesian online changepoint detection on log speed and log force.

    Floors: smaller values are not distinguished. mean_weight, degrees: of the prior, in observations;
    speed_spread, force_spread: the prior's standard deviation of a logarithm within a segment;
    mean_segment_s: of the hazard; least_s: of a segment.
    """

    floor_m_per_s: float = 0.005
    floor_n: float = 1.0
    mean_weight: float = 0.1
    degrees: float = 4.0
    speed_spread: float = 0.5
    force_spread: float = 0.5
    mean_segment_s: float = 2.0
    least_s: float = 0.3


@dataclass(frozen=True)
class StudentSettings:
    """Settings of Bayesian online changepoint detection on speed alone, or on its logarithm.

    unit_m_per_s: the floor of the logarithm, or the divisor of speed; the rest as in `GaussianSettings`.
    """

    scale: Literal["log", "linear"] = "log"
    unit_m_per_s: float = 0.005
    mean_weight: float = 0.1
    degrees: float = 2.0
    spread: float = 0.5
    mean_segment_s: float = 2.0
    least_s: float = 0.3


@dataclass(frozen=True)
class KernelSettings:
    """Settings of kernel changepoint detection.

    signals: `log` speed and force, or velocity and force divided by their floors; gamma: of the Gaussian
    kernel, None for the median heuristic; penalty: of a changepoint, times log n.
    """

    signals: Literal["log", "vectors"] = "log"
    floor_m_per_s: float = 0.01
    floor_n: float = 1.0
    gamma: float | None = None
    penalty: float = 0.5
    least_s: float = 0.3


GAUSSIAN = GaussianSettings(
    floor_m_per_s=0.001,
    floor_n=0.5,
    mean_weight=1.0,
    degrees=128.0,  # the most that is tried, hardly less than a known covariance
    speed_spread=0.7,
    force_spread=0.5,
    mean_segment_s=4.0,
    least_s=0.2,
)
STUDENT = StudentSettings(
    scale="log",
    unit_m_per_s=0.001,
    mean_weight=0.3,
    degrees=16.0,
    spread=1.0,
    mean_segment_s=4.0,
    least_s=0.1,
)
KERNEL = KernelSettings(signals="log", floor_m_per_s=0.002, floor_n=0.5, gamma=0.1, penalty=0.2, least_s=0.1)

"""One step of the thesis' filter as it is written down: the evidence of every segment from all its samples.

Thesis 3.4, steps 3 to 5: for every possible start the segment's samples are looked at again, under each of 30
motion profiles (3.25)–(3.35), each of 21 force rates (3.36)–(3.45), rest, free space and a load (3.52),
(3.60); over profiles and models the best counts (3.39), (3.64). Straightforward: a loop over starts, models
and profiles, arrays over samples and axes. The numbers are those of the preset `integrated`, which the
benchmark checks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from caesura_service.changepoint.preset import STEP_S
from caesura_service.changepoint.thesis_presets import thesis_force_library, thesis_motion_library

Array = NDArray[np.float64]

GRAVITY, LEAST_KG = 9.81, 0.2
MOTION_PROFILES = thesis_motion_library().profiles
FORCE_PROFILES = thesis_force_library().profiles


def step(position: Array, force: Array, starts: list[int]) -> Array:
    """(h,) log evidence of the segments from each start to the last sample; position, force: (n, 3)."""
    return np.array([segment(position[start:], force[start:]) for start in starts])


def segment(position: Array, force: Array) -> float:
    """Log evidence of samples as one segment of the best of three kinds."""
    moving = profiled(position - position[0], MOTION_PROFILES, 1.0, 0.025)
    still = marginal(position - position[0], 1.0, 0.025).sum()
    untouched = marginal(force, 1.0, 0.5).sum()
    pressed = profiled(force, FORCE_PROFILES, 10.0, 1.25)
    weight = np.array([0.0, 0.0, min(float(force[:, 2].mean()), -LEAST_KG * GRAVITY)])
    loaded = marginal(force - weight, 1.0, 0.5).sum()
    kinds = np.array([moving + untouched, still + pressed, moving + loaded])
    return float(kinds.max() - np.log(kinds.size))


def profiled(y: Array, profiles: list, nu0: float, scale: float) -> float:  # type: ignore[type-arg]
    """The best profile on each axis, the last sample being the target (3.27)."""
    t = STEP_S * np.arange(len(y))
    reported = [marginal(y - profile(t)[:, None] * y[-1], nu0, scale) for profile in profiles]
    return float(np.max(reported, axis=0).sum())


def marginal(residuals: Array, nu0: float, scale: float) -> Array:
    """(3,) log marginal likelihood of residuals (n, 3), the variance integrated out. (3.31)."""
    n, prior = len(residuals), nu0 * scale**2
    constant = gammaln(0.5 * (nu0 + n)) - gammaln(0.5 * nu0) - 0.5 * n * np.log(np.pi)
    reported: Array = (
        constant + 0.5 * nu0 * np.log(prior) - 0.5 * (nu0 + n) * np.log(prior + (residuals**2).sum(axis=0))
    )
    return reported

"""The bias of an estimated wrench, tracked from the past only.

An estimate from joint torques has the error of the robot's model. One part wanders with the pose. Another one
is the joints' friction, which depends on the direction of the movement and stays where the arm stops (Dahl,
"A solid friction model", 1968). A robot without a hand on it is in contact or not, so every force is drawn
from one of these densities:

    N(Xᵀφ, (φᵀPφ + b²) I)               in free space
    N(0, c² I)                          in a contact that begins
    (1 − q) N(0, c² I) + q N(F′, f² I)  in a contact that goes on, after the force F′

The mean of free space is a bias and the friction of a direction u: φ = (1, u), and the columns of X have the
posterior covariance P in common. Contact and free space are a Markov chain that stays with probability q. A
step of length Δ in direction d renews the share h = 1 − exp(−Δ/s) of the friction, with the presliding
distance s: u becomes u + h (d − u). With the probability r of free space, given the forces so far,

    X ← X + r g (F − Xᵀφ)ᵀ,   P ← P − r g φᵀP,   g = Pφ / (φᵀPφ + b²/(h w))
    b² = (ν b0² + w Σ r |F − Xᵀφ|²) / (ν + 3 w Σ r)

where each residual has the X of its time. w < 1, because errors are correlated over a second, so ten
observations a second are not ten independent ones. Without a step the error stays, so a rest teaches nothing
of it, and a light press at rest is no bias. b is bounded below by the model's error in motion, which a long
rest does not show, and above by half the scale of contact. Xᵀφ is subtracted from the force, which is tared,
and b is the scale of free space. See ARCHITECTURE.md, "Where `default` differs from the thesis' models".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

AXES = 3
TRACKED_BIAS_N = 1.5  # scale of free space, and of an axis of its bias, before any observation
LEAST_SCALE_N = 1.0  # by which an estimate errs in motion, however quiet a rest was
MOST_LOG_ODDS = 500.0  # against free space, beyond which a force says nothing of it


class BiasState(NamedTuple):
    """The posterior of bias and friction, and sums over the observations so far.

    coefficients: X (4, 3) [N]; covariance: P (4, 4) [N²]; regressors: φ (4,); position (3,) [m] and force
    (3,) [N] of the last observation; free: r; weight: Σ r; squares: Σ r |F − Xᵀφ|² [N²].
    """

    coefficients: Array
    covariance: Array
    regressors: Array
    position: Array
    force: Array
    free: float
    weight: float
    squares: float


@dataclass(frozen=True)
class BiasTracker:
    """Free space with bias and friction, and contact, as a Markov chain.

    scale_n [N]: b0, and of an axis of the bias; friction_n [N]: f, and of an entry of the friction;
    presliding_m [m] s; contact_n [N] c; stays q; prior_scale ν [observations]; weight w.
    """

    scale_n: float
    friction_n: float = 3.0  # the error of an estimate, as robots are reported to have it
    presliding_m: float = 0.002
    contact_n: float = 10.0
    stays: float = 0.95  # 2 s on average
    prior_scale: float = 10.0
    weight: float = 0.1

    def initial_state(self, position: Array) -> BiasState:
        """Return the state before the first observation, which is at this position (3,) [m]."""
        return BiasState(
            coefficients=np.zeros((1 + AXES, AXES)),
            covariance=np.diag([self.scale_n**2, *[self.friction_n**2] * AXES]),
            regressors=np.eye(1 + AXES)[0],
            position=position,
            force=np.zeros(AXES),
            free=1.0,
            weight=0.0,
            squares=0.0,
        )

    def estimate(self, state: BiasState) -> tuple[Array, float]:
        """Return the mean (3,) and the scale of free space [N], from the observations so far."""
        mean: Array = state.regressors @ state.coefficients
        return mean, self._scale_n(state)

    def advance(self, state: BiasState, force: Array, position: Array) -> BiasState:
        """Return the state after a force (3,) [N], tared, at a position (3,) [m]."""
        regressors, renewed = self._regressors(state, position)
        scale2 = self._scale_n(state) ** 2
        projected = state.covariance @ regressors
        uncertain = float(regressors @ projected)
        off = force - regressors @ state.coefficients
        share = self._free_probability(state, off, uncertain + scale2, force)
        moved = state._replace(regressors=regressors, position=position, force=force, free=share)
        if share == 0.0:
            return moved
        weight = renewed * self.weight
        gain = share * weight / (weight * uncertain + scale2) * projected
        return moved._replace(
            coefficients=state.coefficients + np.outer(gain, off),
            covariance=state.covariance - np.outer(gain, projected),
            weight=state.weight + share,
            squares=state.squares + share * float(off @ off),
        )

    def _regressors(self, state: BiasState, position: Array) -> tuple[Array, float]:
        """Return φ at a position, and the share h of the friction that the way there has renewed."""
        step = position - state.position
        way = math.sqrt(float(step @ step))
        if way == 0.0:
            return state.regressors, 0.0
        renewed = -math.expm1(-way / self.presliding_m)
        direction = state.regressors[1:]
        return np.r_[1.0, direction + renewed * (step / way - direction)], renewed

    def _scale_n(self, state: BiasState) -> float:
        squares = self.prior_scale * self.scale_n**2 + self.weight * state.squares
        scale = math.sqrt(squares / (self.prior_scale + AXES * self.weight * state.weight))
        return min(max(scale, LEAST_SCALE_N), 0.5 * self.contact_n)

    def _free_probability(self, state: BiasState, off: Array, variance: float, force: Array) -> float:
        """Return r; off: the force minus the mean of free space; variance: of an axis in free space [N²]."""
        was_free, stays = state.free, self.stays
        free = math.log(was_free * stays + (1.0 - was_free) * (1.0 - stays)) + _log_density(off, variance)
        lasting = (1.0 - was_free) * stays
        anew = (was_free + lasting) * (1.0 - stays)
        touched = math.log(anew) + _log_density(force, self.contact_n**2)
        if lasting > 0.0:
            goes_on = _log_density(force - state.force, self.friction_n**2)
            touched = float(np.logaddexp(touched, math.log(lasting * stays) + goes_on))
        return 1.0 / (1.0 + math.exp(touched - free)) if touched - free < MOST_LOG_ODDS else 0.0


def _log_density(off: Array, variance: float) -> float:
    """Return the log density of a normal distribution with this variance of each axis, but for a constant."""
    return -0.5 * (AXES * math.log(variance) + float(off @ off) / variance)

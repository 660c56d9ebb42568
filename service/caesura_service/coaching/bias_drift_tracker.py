"""The bias of a tared force, tracked while it drifts.

A bias drifts slowly, and contacts begin and end fast. So the bias is a random walk m with variance v of each
axis. Each force has one of these densities, with free movement and contact as two persistent states:

    free                p(F) = N(m, v + R)
    a contact begins    p(F) = N(m, c² I)
    a contact lasts     p(F) = N(F before, s² I)

A Kalman filter is updated with each free force: m ← m + K (F − m), K = v / (v + R). During a contact v grows,
so that the filter follows a drift that happened meanwhile. Often only later forces show whether a force was
free: when a tool leaves a surface, the force is close to a possible bias. So both alternatives are kept as
hypotheses with their probability (Reid 1979), and the bias is that of the most probable one. A single
hypothesis could not be revised: a contact mistaken for bias would make every later free force a contact.

While the fingers hold something, its weight and the bias add up on the vertical axis. Then only the two
horizontal axes are tracked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

Vector = tuple[float, float, float]

AXES, LEVEL_AXES = 3, 2  # of a force; those that are not upright, which come first
MOST_HYPOTHESES = 8
LOG_LEAST = 50.0  # below the most probable one by so much, a hypothesis is given up
LIKE_N2 = 0.25  # [N²] of a difference that the noise of a force hides


class BiasHypothesis(NamedTuple):
    """One assignment of forces to free movement or contact, with the resulting bias and its probability."""

    mean: Vector = (0.0, 0.0, 0.0)  # [N]
    variance: Vector = (0.0, 0.0, 0.0)  # [N²]
    log_weight: float = 0.0  # relative to the most probable one
    contact: Vector | None = None  # [N] the force of the contact that lasts; None: movement is free


class DriftState(NamedTuple):
    """The hypotheses of the bias, the most probable one first."""

    hypotheses: tuple[BiasHypothesis, ...] = (BiasHypothesis(),)

    @property
    def mean(self) -> Vector:
        """The bias (3,) [N] of the most probable hypothesis."""
        return self.hypotheses[0].mean

    @property
    def variance(self) -> Vector:
        """The variance (3,) [N²] of each axis, of the most probable hypothesis."""
        return self.hypotheses[0].variance


@dataclass(frozen=True)
class DriftTracker:
    """Parameters of the filter; `advance` maps a state and a force to the next state.

    walk_n2_per_s: variance that the bias gains in a second; most_n2: its variance at most [N²]; noise_n [N]
    R½ of a force; contact_n [N] scale c of a contact; contact_step_n [N] s, by which the force of a contact
    varies from one observation to the next; lasting_share: probability that free movement or a contact lasts.
    """

    walk_n2_per_s: float
    most_n2: float = math.inf
    noise_n: float = 0.5  # of a force in movement, as in the models of segments
    contact_n: float = 10.0
    contact_step_n: float = 2.0  # 0.4 to 2.3 on an axis in real recordings (delft, icsc, kit, kul)
    lasting_share: float = 0.95  # two seconds

    def wait(self, state: DriftState, dt: float) -> DriftState:
        """Return the state after a time dt [s] without a force that is known to be free."""
        gained, most = self.walk_n2_per_s * dt, self.most_n2
        waited = [
            BiasHypothesis(m, (min(x + gained, most), min(y + gained, most), min(z + gained, most)), w, f)
            for m, (x, y, z), w, f in state.hypotheses
        ]
        return DriftState(tuple(waited))

    def advance(self, state: DriftState, force: Vector, dt: float, *, laden: bool = False) -> DriftState:
        """Return the state after a force [N], dt [s] after the last one; laden: the fingers hold a load."""
        found: list[BiasHypothesis] = []
        for one in self.wait(state, dt).hypotheses:
            found += self._branches(one, force, laden=laden)
        found.sort(key=_log_weight, reverse=True)
        best = found[0].log_weight
        kept: list[BiasHypothesis] = []
        for one in found:
            if one.log_weight - best < -LOG_LEAST or len(kept) == MOST_HYPOTHESES:
                break
            if not any(_is_like(one, other) for other in kept):
                kept.append(BiasHypothesis(one.mean, one.variance, one.log_weight - best, one.contact))
        return DriftState(tuple(kept))

    def _branches(
        self, one: BiasHypothesis, force: Vector, *, laden: bool
    ) -> tuple[BiasHypothesis, BiasHypothesis]:
        """Return a hypothesis with the force as free, and one with the force as a contact."""
        noise2, contact2 = self.noise_n * self.noise_n, self.contact_n * self.contact_n
        step2 = self.contact_step_n * self.contact_step_n
        lasts, changes = math.log(self.lasting_share), math.log(1.0 - self.lasting_share)
        free, contact = (lasts, changes) if one.contact is None else (changes, lasts)
        mean, variance = [*one.mean], [*one.variance]
        for axis in range(LEVEL_AXES if laden else AXES):
            off, spread = force[axis] - one.mean[axis], one.variance[axis] + noise2
            gain = one.variance[axis] / spread
            mean[axis] += gain * off
            variance[axis] *= 1.0 - gain
            free += _log_normal(off, spread)
            contact += (
                _log_normal(off, max(contact2, spread))
                if one.contact is None
                else _log_normal(force[axis] - one.contact[axis], step2)
            )
        return (
            BiasHypothesis(_vector(mean), _vector(variance), one.log_weight + free),
            BiasHypothesis(one.mean, one.variance, one.log_weight + contact, force),
        )


def _log_weight(one: BiasHypothesis) -> float:
    return one.log_weight


def _log_normal(off: float, variance: float) -> float:
    """Return the log density of an axis of a force, off [N] from its mean, without a constant."""
    return -0.5 * (off * off / variance + math.log(variance))


def _vector(axes: Sequence[float]) -> Vector:
    x, y, z = axes
    return x, y, z


def _is_like(one: BiasHypothesis, other: BiasHypothesis) -> bool:
    """Return whether two hypotheses are so close that the next forces do not distinguish them."""
    if (one.contact is None) != (other.contact is None):
        return False
    (ax, ay, az), (bx, by, bz) = one.mean, other.mean
    apart2 = (ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz)
    return apart2 < min(*one.variance, *other.variance) + LIKE_N2

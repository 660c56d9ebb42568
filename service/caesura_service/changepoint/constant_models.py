"""Channels that keep one value: rest, free space, a carried load, and the gripper's holding state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    Channel,
    ModelInput,
    Noise,
    Origin,
    Rows,
    append,
    log_absence,
    signal,
)
from caesura_service.changepoint.profile_model import origin_of
from caesura_service.constants import GRAVITY

Array = NDArray[np.float64]

_Z = 2
_LEAST_SHARE = float(np.finfo(float).tiny)  # of a state or a change that a chain excludes


@dataclass(frozen=True)
class ConstantLevel:
    """The channel keeps a known value: that of its start (steady) or zero (no contact).

    Thesis (3.60), (3.65); origins as in ProfileModel.
    """

    channel: Channel
    noise: Noise
    origin: Origin = "first"

    def empty(self) -> Rows:
        """Return empty rows: n, origin, y, Σy²."""
        return np.zeros(0, np.int64), *(np.zeros((0, AXES)) for _ in range(3))

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z = signal(observed, self.channel)
        start = append(rows[1], origin_of(self.origin, rows, z))
        n, before, squares = (append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 3))
        y = z - start
        return n + 1, start, y, squares + self.noise.fresh(y, before, n, self.origin) ** 2

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        n, _, _, squares = rows
        whitened = n - 1 + int(self.origin == "previous")
        total: Array = self.noise.log_evidence(n, squares, whitened=whitened).sum(axis=1)
        return total


@dataclass(frozen=True)
class FreeSpaceForce:
    """Free space with a real sensor: an unknown constant force with a prior of scale `bias` [N].

    The mean and the deviations from it are independent: the deviations have the noise's density over n − 1
    values, the mean is normal with variance bias² + floor²/n. Mean and deviations are those of whitened
    values, by generalised least squares.

    `absence` [N] is the scale of a factor on every sample, exp(−z²/2 absence²), the complement of a contact's
    presence: a press is not a bias, even if it is constant. The factor is at most 1. z is the force less the
    weight of a load between `least_kg` and `most_kg`. A load is not a contact either: the mean distinguishes
    it from free space once, and the factor does not do so again at every sample.
    """

    noise: Noise
    bias: float
    absence: float = 0.0
    least_kg: float = 0.0
    most_kg: float = 0.0

    def empty(self) -> Rows:
        """Return empty rows: n, f, Σ w², Σ w c, Σ c², Σ log absence.

        w: the whitened force; c: the whitened constant.
        """
        n, vector, scalar = np.zeros(0, np.int64), np.zeros((0, AXES)), np.zeros(0)
        return n, vector, vector, vector, scalar, scalar

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        n, before, squares, total, weight = (append(rows[i], np.zeros(rows[i].shape[1:])) for i in range(5))
        force = np.broadcast_to(observed.force, before.shape)
        w = self.noise.fresh(force, before, n, "zero")
        c = self.noise.fresh(np.ones(n.size), np.ones(n.size), n, "zero")
        beyond = weightless(observed.force, self.least_kg, self.most_kg)
        absent = append(rows[5], 0.0) + log_absence(beyond @ beyond, self.absence)
        return n + 1, np.array(force), squares + w**2, total + w * c[:, None], weight + c**2, absent

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        n, _, squares, total, weight, absent = rows
        mean, ssr = total / weight[:, None], np.maximum(squares - total**2 / weight[:, None], 0.0)
        deviations = self.noise.log_evidence(n - 1, ssr, whitened=n - 1).sum(axis=1)
        density = self.mean_log_density(mean, self.noise.floor**2 / weight[:, None])
        result: Array = deviations - 0.5 * AXES * np.log(weight) + density + absent
        return result

    def mean_log_density(self, mean: Array, variance: Array) -> Array:
        """Return (h,) log density of the mean force (h, 3) [N], estimated with a variance (h, 1) [N²]."""
        total: Array = _normal(mean, self.bias**2 + variance).sum(axis=1)
        return total

    def unexplained(self, mean: Array) -> Array:
        """Return (h, 3) the part of the mean force (h, 3) [N] that has to be a bias."""
        return mean

    def log_likeness(self, rows: Rows) -> Array:
        """Return (h,) the log of a weight of at most 1: how far the forces look like this contact state.

        It is the absence of contact, and the density of the mean's `unexplained` part divided by its peak.
        """
        _, _, _, total, weight, absent = rows
        bias = self.unexplained(total / weight[:, None])
        weighed: Array = absent - 0.5 * (bias**2).sum(axis=1) / (self.bias**2 + self.noise.floor**2 / weight)
        return weighed


@dataclass(frozen=True)
class LoadForce(FreeSpaceForce):
    """A load hangs on the gripper: the force is its weight, (0, 0, −m g), plus the sensor's bias.

    The load is log-uniform between `least_kg` and `most_kg`, with normal shoulders as wide as the bias.
    """

    least_kg: float = 0.2
    most_kg: float = 3.0

    def mean_log_density(self, mean: Array, variance: Array) -> Array:
        """Return (h,) log density: horizontally that of free space, vertically that of the load."""
        sideways = _normal(mean[:, :_Z], self.bias**2 + variance).sum(axis=1)
        down, lowest, highest = -mean[:, _Z], self.least_kg * GRAVITY, self.most_kg * GRAVITY
        inside = np.clip(down, lowest, highest)
        shoulder2 = self.bias**2 + variance[:, 0]
        mass = np.log(highest / lowest) + np.sqrt(0.5 * np.pi * shoulder2) * (1.0 / lowest + 1.0 / highest)
        density: Array = sideways - np.log(inside) - np.log(mass) - 0.5 * (down - inside) ** 2 / shoulder2
        return density

    def unexplained(self, mean: Array) -> Array:
        """Return (h, 3) the mean force (h, 3) [N] less the weight of the load that explains most of it."""
        return np.array([weightless(force, self.least_kg, self.most_kg) for force in mean])


@dataclass(frozen=True)
class ThesisLoadForce:
    """The thesis' transport: the weight of a load of max(m_min, mean), without uncertainty. (3.52),
    (3.60).
    """

    noise: Noise
    least_kg: float

    def empty(self) -> Rows:
        """Return empty rows: n, Σf, Σf²."""
        return np.zeros(0, np.int64), np.zeros((0, AXES)), np.zeros((0, AXES))

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        n, total, squares = (append(array, np.zeros(array.shape[1:])) for array in rows)
        return n + 1, total + observed.force, squares + observed.force**2

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        n, total, squares = rows
        weight = np.minimum(total[:, _Z] / n, -self.least_kg * GRAVITY)
        ssr = squares.copy()
        ssr[:, _Z] += n * weight**2 - 2.0 * weight * total[:, _Z]
        result: Array = self.noise.log_evidence(n, np.maximum(ssr, 0.0)).sum(axis=1)
        return result


class HoldingStates(NamedTuple):
    """The known states of a gripper in a segment: the first one, and how often the next one is the same."""

    first: float  # 1 it holds something, 0 it does not
    stays: int
    changes: int


@dataclass(frozen=True)
class GripperHoldingChain:
    """A two-state Markov chain of whether the gripper holds something.

    probability: that it holds something when the segment starts; change: that this changes from one
    observation to the next. So a long segment is one piece of evidence, not one per sample. An unknown state
    is no evidence.
    """

    probability: float
    change: float = 0.005

    def empty(self) -> Rows:
        """Return empty rows: log evidence, the last known state (nan before one)."""
        return np.zeros(0), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        evidence, before = append(rows[0], 0.0), append(rows[1], np.nan)
        if np.isnan(observed.holding):
            return evidence, before
        first = self.probability if observed.holding else 1.0 - self.probability
        flip = np.where(before == observed.holding, 1.0 - self.change, self.change)
        likelihood = np.where(np.isnan(before), first, flip)
        return evidence + np.log(likelihood), np.full(before.size, observed.holding)

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        return np.asarray(rows[0], np.float64)

    def log_likelihood(self, states: HoldingStates) -> float:
        """Return the same of one segment, from the states that were known in it."""
        first = self.probability if states.first else 1.0 - self.probability
        shares = (1, first), (states.stays, 1.0 - self.change), (states.changes, self.change)
        return sum(count * math.log(max(share, _LEAST_SHARE)) for count, share in shares)


def weightless(force: Array, least_kg: float, most_kg: float) -> Array:
    """Return the force (3,) [N] less the weight of the load, least_kg to most_kg, that minimises the rest."""
    weight = np.clip(-force[_Z], least_kg * GRAVITY, most_kg * GRAVITY)
    left: Array = force + np.array([0.0, 0.0, weight])
    return left


def _normal(value: Array, variance: Array) -> Array:
    density: Array = -0.5 * (value**2 / variance + np.log(2.0 * np.pi * variance))
    return density

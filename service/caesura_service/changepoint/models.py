"""Segment models over a batch of hypotheses, and the contract that a third party's model meets.

A hypothesis is a possible start of the current segment. A model keeps a few sums for each, its rows, and
from them tells the log evidence of every hypothesis at once. Rows are a tuple of arrays whose first axis
counts the hypotheses, oldest first; whoever holds them may drop any with `select`. The work a step and
hypothesis is constant, however long the segment has become.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import (
    known_mean_log_evidence,
    log_mean_exp,
    normal_log_density,
    unknown_mean_log_factor,
    unknown_mean_ssr,
)
from caesura_service.changepoint.profiles import ProfileLibrary, whiten

Array = NDArray[np.float64]
Rows = tuple[NDArray[np.generic], ...]
Choice = Literal["mixture", "maximum"]

AXES = 3
GRAVITY = 9.81  # [m/s²], as the thesis has it
_Z = 2


class Observed(NamedTuple):
    """What a model sees of one moment, in the base frame."""

    position: Array  # (3,) [m]
    force: Array  # (3,) [N] of the environment on the robot
    holding: float = np.nan  # 1 the gripper holds something, 0 it does not, nan unknown


class ChannelModel(Protocol):
    """What one channel of the observation does during a segment."""

    def empty(self) -> Rows:
        """Rows of no hypothesis."""

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Rows after one more observation, with a hypothesis that starts at it appended."""

    def log_evidence(self, rows: Rows) -> Array:
        """(h,) log evidence of everything since each hypothesis' start."""


def select(rows: Rows, index: NDArray[np.generic]) -> Rows:
    """The rows of some hypotheses."""
    return tuple(array[index] for array in rows)


def _born(array: NDArray[np.generic], row: object) -> NDArray[np.generic]:
    return np.concatenate([array, np.asarray(row, dtype=array.dtype)[None]])


def _signal(observed: Observed, channel: Literal["position", "force"]) -> Array:
    return observed.position if channel == "position" else observed.force


@dataclass(frozen=True)
class Noise:
    """Prior of the residuals' variance: scaled inverse chi-squared.

    Their scale [unit] is `floor`, what sensor and hand leave at rest, joined by `share` of how far the
    segment goes: a person's path leaves any profile by a few per cent of its length (signal-dependent
    noise, Harris & Wolpert 1998). `joint` pools the three axes, which makes the model turn with the base frame.
    """

    nu0: float
    floor: float
    share: float = 0.0
    joint: bool = False
    correlation: float = 0.0

    def fresh(self, now: Array, before: Array) -> Array:
        return whiten(now, before, self.correlation)

    def log_jacobian(self, n):
        return -0.5 * AXES * np.log(1.0 - self.correlation**2) * (n - 1)

    def log_evidence(self, n: NDArray[np.int64], ssr: Array, extent2: Array | float = 0.0) -> Array:
        """Sum over axes of the log evidence of residuals with known mean.

        n: (h,) samples; ssr: (h, 3, …) [unit²]; extent2: (h,) [unit²] squared length. Returns (h, …) where
        axes are pooled, else (h, 3, …).
        """
        extent2 = np.asarray(extent2, float)
        n_shape = (-1,) + (1,) * (ssr.ndim - 1)
        scale2 = self.floor**2 + self.share**2 * extent2
        if self.joint:
            pooled = ssr.sum(axis=1)
            shape = (-1,) + (1,) * (pooled.ndim - 1)
            return known_mean_log_evidence(AXES * n.reshape(shape), pooled, self.nu0, scale2.reshape(shape))
        return known_mean_log_evidence(n.reshape(n_shape), ssr, self.nu0, scale2.reshape(n_shape))


@dataclass(frozen=True)
class Profiled:
    """The channel goes from where the segment starts to where it is now along one profile of a library.

    y_j = y_n φ_k(j) + residual, with y counted from the segment's first sample (`origin="first"`) or from
    zero (`origin="zero"`, the force model of the thesis). Second order model: thesis (3.22)–(3.35). Force
    model: (3.36)–(3.45). As the target is the last sample (3.27), a naive evaluation is linear in the
    segment's length; SSR_k = Σy² − 2 y_n Σ y_j φ_k(j) + y_n² Σ φ_k(j)² needs only running sums.

    `reach` [unit] is the scale of the target and, where `charge_start` says so, of the start: their
    densities take the place of those of the samples that they explain by construction, and keep a profile
    from being chosen where nothing happens. None leaves them out, as the thesis does.
    """

    channel: Literal["position", "force"]
    library: ProfileLibrary
    noise: Noise
    choice: Choice = "mixture"
    origin: Literal["first", "zero"] = "first"
    reach: float | None = None
    charge_start: bool = False

    def empty(self) -> Rows:
        """Rows: n, first sample, y, Σy², Σyφ."""
        k = len(self.library)
        vectors = [np.zeros((0, AXES)) for _ in range(3)]
        return (np.zeros(0, np.int64), *vectors, np.zeros((0, AXES, k)))

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Take one observation."""
        z = _signal(observed, self.channel)
        n = _born(rows[0], 0)
        first = _born(rows[1], z)
        y = np.asarray(z - first if self.origin == "first" else np.broadcast_to(z, first.shape))
        fresh = self.noise.fresh(y, _born(rows[2], np.zeros(AXES)))
        squares = _born(rows[3], np.zeros(AXES)) + fresh**2  # type: ignore[operator]
        moments = _born(rows[4], np.zeros((AXES, len(self.library))))
        moments = moments + fresh[:, :, None] * self.library.values(n)[:, None, :]  # type: ignore[operator,arg-type]
        return n + 1, first, y, squares, moments  # type: ignore[operator,return-value]

    def residuals(self, rows: Rows) -> Array:
        """(h, 3, profiles) sum of squared residuals [unit²] under each profile."""
        n, _, y, squares, moments = rows
        norms = self.library.sums_of_squares(n - 1)[:, None, :]  # type: ignore[operator]
        y, squares = y[:, :, None], squares[:, :, None]
        ssr: Array = squares - 2.0 * y * moments + y**2 * norms  # type: ignore[operator]
        return np.maximum(ssr, 0.0)

    def log_evidence(self, rows: Rows) -> Array:
        """(h,) over all profiles: mixture (thesis (3.39) put right) or maximum (as printed)."""
        n, first, y = (np.asarray(array) for array in rows[:3])
        ends2 = (y**2).sum(axis=1)
        starts2 = (first**2).sum(axis=1) if self.charge_start else np.zeros_like(ends2)
        explained = np.zeros_like(n) if self.reach is None else (n > 1) + np.int64(self.charge_start)
        each = self.noise.log_evidence(n - explained, self.residuals(rows), ends2 + starts2)
        best = each.max(axis=-1) if self.choice == "maximum" else log_mean_exp(each)
        result = _over_axes(best) + self.noise.log_jacobian(n)
        if self.reach is None:
            return result
        target = np.where(n > 1, normal_log_density(ends2, AXES, self.reach**2), 0.0)
        start = normal_log_density(starts2, AXES, self.reach**2) if self.charge_start else 0.0
        return result + target + start


@dataclass(frozen=True)
class Constant:
    """The channel keeps one value: where it started (`origin="first"`, steady) or zero (no contact).

    Thesis (3.60), (3.65). With `bias` [unit] the value is unknown, with a prior of that scale about zero,
    and integrated out: real sensors have one. Without, it is known exactly.
    """

    channel: Literal["position", "force"]
    noise: Noise
    origin: Literal["first", "zero"] = "first"
    bias: float | None = None

    def empty(self) -> Rows:
        """Rows: n, first sample, Σy, Σy²."""
        vectors = [np.zeros((0, AXES)) for _ in range(4)]
        return (np.zeros(0, np.int64), *vectors, np.zeros(0))

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Take one observation."""
        z = _signal(observed, self.channel)
        first = _born(rows[1], z if self.origin == "first" else np.zeros(AXES))
        y = z - first  # type: ignore[operator]
        n = _born(rows[0], 0)
        before, total, squares = (_born(array, np.zeros(AXES)) for array in rows[2:5])
        w = self.noise.fresh(y, before)
        one = self.noise.fresh(1.0, (n>0)*1.0)
        return n + 1, first, y, total + w*one[:,None], squares + w**2, _born(rows[5],0.0)+one**2  # type: ignore[operator,return-value]

    def log_evidence(self, rows: Rows) -> Array:
        """(h,) sum over axes."""
        n, _, _, total, squares, ones = (np.asarray(array) for array in rows)
        if self.bias is None:
            return _over_axes(self.noise.log_evidence(n, squares)) + self.noise.log_jacobian(n)
        kappa0 = (self.noise.floor / self.bias) ** 2
        ssr = unknown_mean_ssr(ones[:, None], total, squares, kappa0)
        return _over_axes(self.noise.log_evidence(n, ssr)) + AXES * unknown_mean_log_factor(ones, kappa0)+ self.noise.log_jacobian(n)


@dataclass(frozen=True)
class Carried:
    """The force is the weight of a load of at least `least_kg`: (0, 0, −m g). Thesis (3.52), (3.60).

    m is the mean of the segment. With `bias` [N] the sideways force has an unknown mean, and the load a
    density of scale `heaviest_kg`, in place of being known for certain.
    """

    noise: Noise
    least_kg: float
    bias: float | None = None
    heaviest_kg: float = 3.0

    def empty(self) -> Rows:
        """Rows: n, Σf, Σf²."""
        return np.zeros(0, np.int64), np.zeros((0, AXES)), np.zeros((0, AXES))

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Take one observation."""
        total, squares = (_born(array, np.zeros(AXES)) for array in rows[1:])
        f = observed.force
        return _born(rows[0], 0) + 1, total + f, squares + f**2  # type: ignore[operator,return-value]

    def load_kg(self, rows: Rows) -> Array:
        """(h,) load of each hypothesis [kg]."""
        n, total, _ = (np.asarray(array) for array in rows)
        load: Array = np.maximum(self.least_kg, -total[:, _Z] / n / GRAVITY)
        return load

    def log_evidence(self, rows: Rows) -> Array:
        """(h,) sum over axes."""
        n, total, squares = (np.asarray(array) for array in rows)
        weight = -self.load_kg(rows) * GRAVITY
        ssr = squares.copy()
        ssr[:, _Z] += -2.0 * weight * total[:, _Z] + n * weight**2
        if self.bias is None:
            return _over_axes(self.noise.log_evidence(n, np.maximum(ssr, 0.0)))
        kappa0 = (self.noise.floor / self.bias) ** 2
        sideways = unknown_mean_ssr(n[:, None], total[:, :_Z], squares[:, :_Z], kappa0)
        ssr = np.column_stack([sideways, np.maximum(ssr[:, _Z], 0.0)])
        width = self.heaviest_kg * GRAVITY / self.noise.floor
        chosen = -0.5 * np.log(n) - np.log(width) + 0.5 * np.log(2.0 * np.pi)
        factors = _Z * unknown_mean_log_factor(n, kappa0) + chosen
        return _over_axes(self.noise.log_evidence(n, ssr)) + factors


@dataclass(frozen=True)
class Held:
    """Whether the gripper holds something: a coin of known bias `probability` at every observation."""

    probability: float

    def empty(self) -> Rows:
        """Rows: log evidence so far."""
        return (np.zeros(0),)

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Take one observation; unknown says nothing."""
        p = self.probability
        told = 0.0 if np.isnan(observed.holding) else float(np.log(p if observed.holding else 1.0 - p))
        return (_born(rows[0], 0.0) + told,)  # type: ignore[operator]

    def log_evidence(self, rows: Rows) -> Array:
        """(h,)."""
        return np.asarray(rows[0], float)


def _over_axes(each: Array) -> Array:
    return each if each.ndim == 1 else each.sum(axis=1)

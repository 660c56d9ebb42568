"""The interface of a segment's channel models, of Caesura and of third parties.

A hypothesis is a possible start of the current segment. A model keeps a few sums per hypothesis, its rows,
and computes from them the log evidence of all hypotheses at once. Rows are a tuple of arrays whose first axis
is the hypothesis, oldest first; the filter may drop any with `select`. The work per step and hypothesis does
not depend on the segment's length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_service.changepoint.evidence import known_mean_log_evidence, log_mean_exp
from caesura_service.changepoint.profile_library import whiten

Array = NDArray[np.float64]
Rows = tuple[NDArray[Any], ...]
Choice = Literal["mixture", "maximum"]
Channel = Literal["position", "force", "rotation"]
Origin = Literal["previous", "first", "zero"]

AXES = 3
UNTURNED = np.zeros(AXES)  # the rotation of a pose without an orientation
UNTURNED.setflags(write=False)


class ModelInput(NamedTuple):
    """The conditioned signals of one observation, the input of a model, in the base frame.

    Gravity points along −z. For a tilted base all vectors are rotated by the least rotation to that frame.
    """

    position: Array  # (3,) [m]
    force: Array  # (3,) [N] of the environment on the robot
    holding: float = np.nan  # 1 the gripper holds something, 0 it does not, nan unknown
    rotation: Array = UNTURNED  # (3,) [rad] sum of the rotations so far, each a vector in the base frame
    torsion: Array = UNTURNED  # (3,) [Nm] of the environment's torque, the part along the force


class ChannelModel(Protocol):
    """The model of one channel of the observation during a segment."""

    def empty(self) -> Rows:
        """Return the rows of no hypothesis."""

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation, with a hypothesis that starts at it appended."""

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of all observations since each hypothesis' start."""


def select(rows: Rows, index: NDArray[Any]) -> Rows:
    """Return the rows of some hypotheses."""
    return tuple(array[index] for array in rows)


def append(array: NDArray[Any], row: ArrayLike) -> NDArray[Any]:
    """Return an array with one more hypothesis."""
    return np.concatenate([array, np.asarray(row, dtype=array.dtype)[None]])


def log_presence(squared: ArrayLike, least: float) -> Array:
    """Return the log of the weight 1 − exp(−z²/2 least²) of a quantity that must differ from 0.

    squared: z². The log weight is 0 if `least` is 0.
    """
    if not least:
        return np.zeros_like(np.asarray(squared, float))
    weight: Array = -np.expm1(-0.5 * np.asarray(squared, float) / least**2)
    return np.log(np.maximum(weight, np.finfo(float).tiny))


def log_absence(squared: ArrayLike, most: float) -> Array:
    """Return the log of the weight exp(−z²/2 most²) of a quantity that must be near 0.

    squared: z². The log weight is 0 if `most` is 0.
    """
    if not most:
        return np.zeros_like(np.asarray(squared, float))
    weight: Array = -0.5 * np.asarray(squared, float) / most**2
    return weight


def signal(observed: ModelInput, channel: Channel) -> Array:
    """Return the channel's values (3,) in an observation."""
    value: Array = getattr(observed, channel)
    return value


@dataclass(frozen=True)
class Noise:
    """Prior of the residuals: Student-t about the model, with the variance integrated out.

    Their scale [unit] combines `floor`, the residual of sensor and hand at rest, with a share of the
    segment's displacement: a person's path differs from any profile by a few per cent of its length
    (signal-dependent noise, Harris & Wolpert 1998). Persons differ: `shares` are equally likely, and the
    evidence is their mixture. nu0: degrees of freedom of the prior scale.

    `joint` pools the three axes, which makes the model invariant to rotations of the base frame.
    `correlation` is that of residuals one sample apart: a person's error lasts for a while, and white noise
    would count it again at every sample.
    """

    nu0: float
    floor: float
    shares: tuple[float, ...] = (0.0,)
    joint: bool = False
    correlation: float = 0.0

    def fresh(self, now: Array, before: Array, n: NDArray[np.int64], origin: Origin) -> Array:
        """Return the whitened innovation of values `now` (h, …), given those before; n: (h,) samples before.

        If a hypothesis has no sample before and does not start at one, its first value is not whitened.
        """
        whitened = whiten(now, before, self.correlation)
        if origin == "previous":
            return whitened
        first = (n == 0).reshape((-1,) + (1,) * (now.ndim - 1))
        return np.where(first, now, whitened)

    def log_evidence(
        self,
        n: ArrayLike,
        ssr: Array,
        *,
        extent2: ArrayLike = 0.0,
        whitened: ArrayLike = 0,
        log_scale: ArrayLike = 0.0,
    ) -> Array:
        """Return the log evidence of whitened residuals over all axes.

        n: (h,) values per axis; ssr: (h, 3, …) [unit²]; extent2: (h,) [unit²] squared displacement;
        whitened: (h,) number of whitened values per axis; log_scale: (h, 1, …) Σ log of the scales by which
        the values of an axis were divided. Returns (h, 3 or 1, …): one entry per axis, or one if pooled.
        """
        shape = (-1,) + (1,) * (ssr.ndim - 1)
        count, extent2, jacobian = (np.asarray(a, float).reshape(shape) for a in (n, extent2, whitened))
        jacobian = -0.5 * np.log1p(-(self.correlation**2)) * jacobian - np.asarray(log_scale)
        if self.joint:
            count, jacobian, ssr = AXES * count, AXES * jacobian, ssr.sum(axis=1, keepdims=True)
        scales2 = [self.floor**2 + share**2 * extent2 for share in self.shares]
        each = [known_mean_log_evidence(count, ssr, self.nu0, scale2) for scale2 in scales2]
        result: Array = (log_mean_exp(np.stack(each), axis=0) if len(each) > 1 else each[0]) + jacobian
        return result

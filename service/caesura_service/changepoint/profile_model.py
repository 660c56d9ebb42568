"""Channels that change from one value to another along a profile: movements, and forces that rise or fall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    Channel,
    Choice,
    ModelInput,
    Noise,
    Origin,
    Rows,
    append,
    log_presence,
    signal,
)
from caesura_service.changepoint.evidence import log_mean_exp, normal_log_density
from caesura_service.changepoint.profile_library import ProfileLibrary

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DisplacementPrior:
    """Prior of a segment's displacement: normal, except near zero, where a rest explains it.

    reach [unit]: standard deviation per axis; least [unit]: displacement of a rest. The density at y is that
    of the normal, times 1 − exp(−y²/2 least²), normalised: a movement is a displacement that no resting hand
    makes.
    """

    reach: float
    least: float

    def log_density(self, moved: Array) -> Array:
        """Return (h,) log density of displacements (h, 3) [unit]."""
        moved2 = (moved**2).sum(axis=1)
        left_out = (self.least**2 / (self.reach**2 + self.least**2)) ** (AXES / 2)
        normal = normal_log_density(moved2, AXES, self.reach**2)
        density: Array = normal + log_presence(moved2, self.least) - np.log1p(-left_out)
        return density


@dataclass(frozen=True)
class ProfileModel:
    """The channel follows one profile of a library, from the segment's start to its current value.

    y_j = y_n φ_k(j) + residual, with y counted from the segment's first sample (`origin="first"`), from the
    sample before it (`"previous"`: values do not jump between segments, so that a short segment explains no
    change without evidence) or from zero (`"zero"`, the thesis' force model). Second order model: thesis
    (3.22)–(3.35). Force model: (3.36)–(3.45). As the target is the last sample (3.27), a naive evaluation is
    linear in the segment's length; SSR_k = Σwy² − 2 y_n Σ w y_j φ_k(j) + y_n² Σ w φ_k(j)² needs only running
    sums, w = w_k(j) being the library's precisions. They are kept of whitened values, the target is not
    whitened.

    `target` is the target's prior: its density replaces that of the last sample, which the target explains by
    construction, so that a rest is not taken for a movement. None omits it, as in the thesis. `pace` [unit]
    weighs every step by 1 − exp(−step²/2 pace²): a moving hand does not rest. The weight is at most 1, so it
    never favours a movement.
    """

    channel: Channel
    library: ProfileLibrary
    noise: Noise
    choice: Choice = "mixture"
    origin: Origin = "first"
    target: DisplacementPrior | None = None
    pace: float = 0.0

    def __post_init__(self) -> None:
        if self.library.correlation != self.noise.correlation:
            raise ValueError(
                f"library is whitened for correlation {self.library.correlation}, "
                f"noise has {self.noise.correlation}"
            )

    @property
    def _offset(self) -> int:
        """The index in the library of a segment's first sample."""
        return int(self.origin == "previous")

    def empty(self) -> Rows:
        """Return empty rows: n, origin, y, Σwy², Σwyφ, Σ log pace."""
        vectors, moments = np.zeros((0, AXES)), np.zeros((0, AXES, len(self.library)))
        return np.zeros(0, np.int64), vectors, vectors, moments, moments, np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z = signal(observed, self.channel)
        start = append(rows[1], origin_of(self.origin, rows, z))
        n, before, squares, moments, paced = (
            append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, *range(2, 6))
        )
        y = z - start
        fresh = self.noise.fresh(y, before, n, self.origin)[:, :, None]
        phi, precision = (
            table(n + self._offset)[:, None, :] for table in (self.library.values, self.library.precisions)
        )
        weighed = fresh * precision
        paced = paced + self._log_pace(rows, z)
        return n + 1, start, y, squares + fresh * weighed, moments + phi * weighed, paced

    def _log_pace(self, rows: Rows, z: Array) -> float:
        """Return the log weight of the last step, to value z (3,); it is the same for every hypothesis."""
        if not self.pace or not len(rows[0]):
            return 0.0
        step = z - rows[1][-1] - rows[2][-1]
        return float(log_presence(step @ step, self.pace))

    def residuals(self, rows: Rows) -> Array:
        """Return (h, 3, profiles) precision-weighted sums of squared residuals [unit²] under each profile."""
        n, _, y, squares, moments, _ = rows
        norms = self.library.sums_of_squares(n - 1 + self._offset)[:, None, :]
        y = y[:, :, None]
        return np.maximum(squares - 2.0 * y * moments + y**2 * norms, 0.0)

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence over profiles: mixture (thesis (3.39), corrected), or maximum as
        printed.
        """
        n, _, y = rows[:3]
        explained = 0 if self.target is None else 1
        last = n - 1 + self._offset - explained
        each = self.noise.log_evidence(
            n - explained,
            self.residuals(rows),
            extent2=(y**2).sum(axis=1),
            whitened=last,
            log_scale=self.library.log_scales(np.maximum(last, 0))[:, None, :],
        )
        best = each.max(axis=-1) if self.choice == "maximum" else log_mean_exp(each)
        total: Array = best.sum(axis=1) + rows[5]
        return total if self.target is None else total + self.target.log_density(y)


def origin_of(origin: Origin, rows: Rows, z: Array) -> Array:
    """Return the origin (3,) of a newborn hypothesis; rows[1] and rows[2] are origins and values since."""
    if origin == "zero":
        return np.zeros(AXES)
    if origin == "previous" and len(rows[0]):
        previous: Array = rows[1][-1] + rows[2][-1]
        return previous
    return z

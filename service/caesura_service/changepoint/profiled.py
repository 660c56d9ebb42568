"""Channels that go from one value to another along a profile: movements, and forces that rise or fall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_mean_exp, normal_log_density
from caesura_service.changepoint.models import (
    AXES,
    Channel,
    Choice,
    Noise,
    Observed,
    Origin,
    Rows,
    append,
    signal,
)
from caesura_service.changepoint.profiles import ProfileLibrary

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """Prior of where a segment goes: normal about its start, but not so near zero that nothing explains it.

    reach [unit]: standard deviation an axis; least [unit]: what rest or a sensor's bias comes to. The
    density at z is that of the normal, times 1 − exp(−z²/2 least²), normalised: a movement is a
    displacement that no resting hand makes, a contact a force that no bias accounts for.
    """

    reach: float
    least: float

    def log_density(self, start: Array, moved: Array) -> Array:
        """(h,) of start + moved, both (h, 3) [unit]."""
        start2, moved2, end2 = ((v**2).sum(axis=1) for v in (start, moved, start + moved))
        both = self.reach**2 + self.least**2
        left_out = (self.least**2 / both) ** (AXES / 2) * np.exp(-0.5 * start2 / both)
        something = -np.expm1(-0.5 * end2 / self.least**2)
        normal = normal_log_density(moved2, AXES, self.reach**2)
        density: Array = normal + np.log(np.maximum(something, np.finfo(float).tiny)) - np.log1p(-left_out)
        return density


@dataclass(frozen=True)
class Profiled:
    """The channel goes from where the segment starts to where it is now along one profile of a library.

    y_j = y_n φ_k(j) + residual, with y counted from the segment's first sample (`origin="first"`), from
    the sample before it (`"previous"`: nothing jumps between segments, so that a short segment explains
    nothing for free) or from zero (`"zero"`, the thesis' force model). Second order model: thesis
    (3.22)–(3.35). Force model: (3.36)–(3.45). As the target is the last sample (3.27), a naive evaluation
    is linear in the segment's length; SSR_k = Σy² − 2 y_n Σ y_j φ_k(j) + y_n² Σ φ_k(j)² needs only
    running sums. They are kept of whitened values, the target is not whitened.

    `target` is the target's prior: its density takes the place of that of the last sample, which the
    target explains by construction, so that a movement is not chosen where nothing moves. None leaves it
    out, as the thesis does. `presence` [unit] weighs every sample by 1 − exp(−z²/2 presence²): a contact
    is there all the time, and does not last on into free space because its release explains that too.
    The weight is at most 1, so that a contact is never overrated.
    """

    channel: Channel
    library: ProfileLibrary
    noise: Noise
    choice: Choice = "mixture"
    origin: Origin = "first"
    target: Target | None = None
    presence: float = 0.0

    def __post_init__(self) -> None:
        if self.library.correlation != self.noise.correlation:
            raise ValueError(
                f"library is whitened for correlation {self.library.correlation}, "
                f"noise has {self.noise.correlation}"
            )

    @property
    def _offset(self) -> int:
        """Index in the library of a segment's first sample."""
        return int(self.origin == "previous")

    def empty(self) -> Rows:
        """Rows: n, origin, y, Σy², Σyφ, Σ log presence."""
        vectors = [np.zeros((0, AXES)) for _ in range(3)]
        return np.zeros(0, np.int64), *vectors, np.zeros((0, AXES, len(self.library))), np.zeros(0)

    def extend(self, rows: Rows, observed: Observed) -> Rows:
        """Take one observation."""
        z = signal(observed, self.channel)
        start = append(rows[1], origin_of(self.origin, rows, z))
        n, before, squares = (append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 3))
        y = z - start
        fresh = self.noise.fresh(y, before, n, self.origin)
        phi = self.library.values(n + self._offset)
        moments = append(rows[4], np.zeros(rows[4].shape[1:])) + fresh[:, :, None] * phi[:, None, :]
        present = append(rows[5], 0.0) + self._log_presence(z)
        return n + 1, start, y, squares + fresh**2, moments, present

    def _log_presence(self, z: Array) -> float:
        if not self.presence:
            return 0.0
        beyond = -np.expm1(-0.5 * float(z @ z) / self.presence**2)
        return float(np.log(max(beyond, np.finfo(float).tiny)))

    def residuals(self, rows: Rows) -> Array:
        """(h, 3, profiles) sum of squared residuals [unit²] under each profile."""
        n, _, y, squares, moments, _ = rows
        norms = self.library.sums_of_squares(n - 1 + self._offset)[:, None, :]
        y, squares = y[:, :, None], squares[:, :, None]
        return np.maximum(squares - 2.0 * y * moments + y**2 * norms, 0.0)

    def log_evidence(self, rows: Rows) -> Array:
        """(h,) over all profiles: mixture (thesis (3.39) put right) or maximum (as printed)."""
        n, start, y = rows[:3]
        moved2 = (y**2).sum(axis=1)
        level2 = (start**2).sum(axis=1) if self.channel == "force" else 0.0
        explained = 0 if self.target is None else 1
        each = self.noise.log_evidence(
            n - explained,
            self.residuals(rows),
            extent2=moved2 + level2,
            whitened=n - 1 + self._offset - explained,
        )
        best = each.max(axis=-1) if self.choice == "maximum" else log_mean_exp(each)
        total: Array = best.sum(axis=1) + rows[5]
        if self.target is None:
            return total
        given = start if self.channel == "force" else np.zeros_like(start)
        return total + self.target.log_density(given, y)


def origin_of(origin: Origin, rows: Rows, z: Array) -> Array:
    """(3,) where a newborn hypothesis counts from; rows[1] and rows[2] are origins and values since."""
    if origin == "zero":
        return np.zeros(AXES)
    if origin == "previous" and len(rows[0]):
        previous: Array = rows[1][-1] + rows[2][-1]
        return previous
    return z

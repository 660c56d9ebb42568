"""Constant velocity: a straight line through time, by conjugate regression. Thesis (3.12)–(3.21)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ConstantVelocity:
    """x(t) = β₀ + β₁ t + ε on each axis, β ~ N(0, σ²/κ₀ I), σ² ~ scaled inverse chi-squared(ν₀, σ₀²).

    The thesis states no units, and its zero-mean prior of β₀ makes the result depend on the origin. So each
    segment is centred on its first sample, and positions are in units of `length_unit_m` [m].

    β* = (ΦᵀΦ + κ₀ I)⁻¹ Φᵀ x (the thesis has a minus). The determinant of the prior precision is κ₀ to the
    number of coefficients, on top, not below (3.17).
    """

    nu0: float
    sigma2: float  # [length_unit²]
    kappa0: float
    length_unit_m: float
    step_s: float

    def empty(self) -> Rows:
        """Return empty rows: n, first sample, Σy, Σty, Σy²."""
        return np.zeros(0, np.int64), *(np.zeros((0, AXES)) for _ in range(4))

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        first = append(rows[1], observed.position)
        n, total, moment, squares = (append(rows[i], np.zeros(rows[i].shape[1:])) for i in (0, 2, 3, 4))
        y = (observed.position - first) / self.length_unit_m
        t = self.step_s * n[:, None]
        return n + 1, first, total + y, moment + t * y, squares + y**2

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence, summed over axes; a density in length_unit_m, as in the thesis."""
        n, _, total, moment, squares = rows
        # ΦᵀΦ + κ₀ I = [[a, b], [b, c]] with Σt and Σt² of t = 0, step, …, (n − 1) step.
        b = self.step_s * 0.5 * n * (n - 1)
        c = self.step_s**2 * n * (n - 1) * (2 * n - 1) / 6.0 + self.kappa0
        a = n + self.kappa0
        determinant = a * c - b**2
        explained = (
            c[:, None] * total**2 - 2.0 * b[:, None] * total * moment + a[:, None] * moment**2
        ) / determinant[:, None]
        scale = self.nu0 * self.sigma2 + np.maximum(squares - explained, 0.0)
        nu_n = self.nu0 + n
        constant = gammaln(0.5 * nu_n) - gammaln(0.5 * self.nu0) - 0.5 * n * np.log(np.pi)
        constant = constant + np.log(self.kappa0) - 0.5 * np.log(determinant)
        constant = constant + 0.5 * self.nu0 * np.log(self.nu0 * self.sigma2)
        result: Array = AXES * constant - 0.5 * nu_n * np.log(scale).sum(axis=1)
        return result

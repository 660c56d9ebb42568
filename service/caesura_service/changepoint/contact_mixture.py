"""The thesis' contact model: every force is drawn from one of three states, in estimated proportions.

Predictive density Σ_k (α_k + c_k)/(Σα + n) N_k(f), with c_k the expected count of state k in the segment so
far: thesis (3.46)–(3.58), whose hard argmax in (3.54), (3.57) is no density. The states are free space,
contact and transport of a load of max(m_min, mean of the segment so far).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.constants import GRAVITY

Array = NDArray[np.float64]

FREE, CONTACT, TRANSPORT = range(3)
STATES = 3
_Z = 2


@dataclass(frozen=True)
class ContactMixture:
    """Model of a force whose contact state varies within a segment: free, in contact, or with a load.

    Its log evidence is that of the mixture of the three states, plus the log share of one of them (`state`).
    The shares of the three states add up to one. The evidence is multiplied by the number of states, because
    a model set weighs its kinds equally, and the three states are one model rather than alternatives.
    """

    state: int
    sensor2: float = 0.75  # [N²]
    contact2: float = 20.0  # [N²]
    transport2: float = 0.0  # [N²]
    least_kg: float = 0.2
    alpha: tuple[float, float, float] = (10.0, 10.0, 10.0)

    def empty(self) -> Rows:
        """Return empty rows: n, Σf_z, c, log evidence."""
        return np.zeros(0, np.int64), np.zeros(0), np.zeros((0, STATES)), np.zeros(0)

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        n, total, counts, weighed = (append(array, np.zeros(array.shape[1:])) for array in rows)
        shares = counts + np.asarray(self.alpha)
        shares /= shares.sum(axis=1, keepdims=True)
        joint = np.log(shares) + self._log_densities(observed.force, n, total)
        predictive = log_sum_exp(joint, axis=1)
        counts = counts + np.exp(joint - predictive[:, None])
        return n + 1, total + observed.force[_Z], counts, weighed + predictive

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        shares = rows[2] + np.asarray(self.alpha)
        share = np.log(shares[:, self.state] / shares.sum(axis=1))
        result: Array = rows[3] + share + np.log(STATES)
        return result

    def _log_densities(self, force: Array, n: NDArray[np.int64], total: Array) -> Array:
        """Return (h, 3) log density of a force [N] in each state."""
        mean = np.divide(total, n, out=np.zeros_like(total), where=n > 0)
        weight = np.minimum(mean, -self.least_kg * GRAVITY)
        sideways2 = float(force[:_Z] @ force[:_Z])
        squares = np.column_stack(
            [
                np.full(n.size, sideways2 + force[_Z] ** 2),
                np.full(n.size, sideways2 + force[_Z] ** 2),
                sideways2 + (force[_Z] - weight) ** 2,
            ]
        )
        variances = self.sensor2 + np.array([0.0, self.contact2, self.transport2])
        densities: Array = -0.5 * (squares / variances + AXES * np.log(2.0 * np.pi * variances))
        return densities

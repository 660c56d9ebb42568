"""A penalty on a segment in free space, or with a load, that begins with a rise of the force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, ModelInput, Rows, append
from caesura_service.changepoint.constant_models import weightless

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoContactRise:
    """A weight of at most 1 on the start of free space: exp(−rise²/2 scale²).

    The rise is the increase of the force [N], within `reach` observations after the first, over that of the
    observation before the start; 0 for a decrease. A bias may be large, and drifts slowly. So free space may
    have the force of a light contact, and still not begin where the force rises. Before the first
    observation of a recording its own force counts.

    scale [N]: variation of the force of a free movement within these observations. most_kg [kg]: the weight
    of a load up to this is subtracted from the force, because a load appears without a contact.
    """

    scale: float
    reach: int = 3
    most_kg: float = 0.0

    def empty(self) -> Rows:
        """Return empty rows: n, force before the start, largest rise, last force."""
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros((0, AXES))

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        force = weightless(observed.force, 0.0, self.most_kg)
        last = rows[3][-1] if len(rows[0]) else force
        n, before = append(rows[0], 0), append(rows[1], np.sqrt(last @ last))
        risen = append(rows[2], 0.0)
        risen = np.where(n <= self.reach, np.maximum(risen, np.sqrt(force @ force) - before), risen)
        return n + 1, before, risen, np.tile(force, (len(n), 1))

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        weight: Array = -0.5 * (rows[2] / self.scale) ** 2
        return weight

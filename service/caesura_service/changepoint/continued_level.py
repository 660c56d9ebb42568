"""A level of the force that may go on from before the start of the segment."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import (
    AXES,
    ModelInput,
    Noise,
    Rows,
    append,
    log_presence,
    select,
)
from caesura_service.changepoint.constant_models import FreeSpaceForce

Array = NDArray[np.float64]

_FRESH, _GOING_ON = 2, 8  # places of the rows of either level


@dataclass(frozen=True)
class ContinuedLevel:
    """A mixture of a new level and of the one before the start, which goes on.

    A hand that turns a corner changes neither the bias of the sensor nor the load, nor how the force varies
    about them. With y the forces of the segment, x the `memory` forces directly before its start, and m the
    evidence of `level`, the evidence is

        (1 − q) m(y) + q m(x, y)/m(x),  q = probability · w(x) · v.

    w(x), at most 1, is how far x looks like the contact state of `level` (`FreeSpaceForce.log_likeness`): a
    level goes on only where there was one. v, at most 1, is the presence of a movement before the start: its
    displacement during x is weighed against `away` [m], because the force of a resting arm varies less. Where
    fewer than `memory` observations precede the start, q = 0.

    With a new level alone, a start under a steady force costs the more the steadier it is, because its mean
    and its scale have to be learnt again: 5 nats where it varies by 0.5 N, 20 where it varies by 0.05 N.
    With this mixture and a probability of 0.05 a movement's start costs 3 and 10.
    """

    level: FreeSpaceForce
    probability: float
    memory: int
    away: float = 0.0

    @property
    def noise(self) -> Noise:
        """The prior of the residuals about either level."""
        return self.level.noise

    def empty(self) -> Rows:
        """Return empty rows: last forces and positions (nan before the first), log odds, and both levels."""
        past = np.zeros((0, self.memory, 2 * AXES))
        return past, np.zeros((0, 2)), *self.level.empty(), *self.level.empty()

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        past = rows[0][-1] if len(rows[0]) else np.full((self.memory, 2 * AXES), np.nan)
        log_odds = append(rows[1], (0.0, -np.inf))
        fresh = self.level.extend(rows[_FRESH:_GOING_ON], observed)
        going_on = self.level.extend(rows[_GOING_ON:], observed)
        if np.isfinite(past).all():
            forces, way = past[:, :AXES], past[-1, AXES:] - past[0, AXES:]
            seen = (observed._replace(force=force) for force in forces)
            before = select(reduce(self.level.extend, seen, self.level.empty()), np.array([0]))
            log_q = np.log(self.probability) + self.level.log_likeness(before)[0]
            log_q += log_presence(way @ way, self.away)
            log_odds[-1] = np.log1p(-np.exp(log_q)), log_q - self.level.log_evidence(before)[0]
            newest = select(self.level.extend(before, observed), np.array([0]))
            going_on = tuple(
                np.concatenate([array[:-1], row]) for array, row in zip(going_on, newest, strict=True)
            )
        last = np.concatenate([past[1:], [[*observed.force, *observed.position]]])
        return np.tile(last, (len(log_odds), 1, 1)), log_odds, *fresh, *going_on

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        fresh = self.level.log_evidence(rows[_FRESH:_GOING_ON])
        going_on = self.level.log_evidence(rows[_GOING_ON:])
        result: Array = np.logaddexp(rows[1][:, 0] + fresh, rows[1][:, 1] + going_on)
        return result

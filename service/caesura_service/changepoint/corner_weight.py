"""Corners: where a movement turns while its speed dips, the next movement begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, Channel, ModelInput, Rows, append, signal

Array = NDArray[np.float64]

LENGTH_FLOOR = 1e-9  # below which a displacement has no direction


@dataclass(frozen=True)
class CornerWeight:
    """A weight on the start of a movement, above 1 where the path has a corner.

    The log weight is γ(v) S((turn − 45°)/15°) S((0.6 − r)/0.08), with S the logistic function. `turn` is the
    angle between the path over `chord` observations before the start and the path since. r is the speed at
    the start, divided by the lesser of the peaks within `reach` observations before and after. So what only
    curves, or only slows down, starts no movement: it is a via point of the path.

    The weight is 0 for the first `chord` observations of a segment, follows the path up to `reach`, and
    stays. It needs no look at what comes after the segment, so a segment's evidence remains its own.

    γ(v) is what a start costs the movement that begins at speed v: `standing` + (`gamma` − `standing`)
    min(1, v²/`fast`²). At standstill that is what any start costs, its hazard, its kind and its burst. A
    movement that does not begin at rest pays for its speed too. So a corner takes no rest's place.

    gamma, standing [nats]; fast [unit] a step, 0 for `gamma` at any speed. pace [unit]: least step at a peak,
    since a hand at rest has no corners. channel: the position [m], or the rotation [rad], where a turn back,
    or a turn about another axis, is a corner.
    """

    gamma: float
    pace: float
    turn_deg: float = 45.0
    turn_width_deg: float = 15.0
    dip: float = 0.6
    dip_width: float = 0.08
    chord: int = 3
    reach: int = 5
    channel: Channel = "position"
    standing: float = 0.0
    fast: float = 0.0

    @property
    def memory(self) -> int:
        """Positions that a start looks back on, its own included."""
        return self.reach + 2

    def empty(self) -> Rows:
        """Rows: n, last values, value at the start, path before, step at it, peaks, log weight."""
        vectors, scalars = np.zeros((0, AXES)), np.zeros(0)
        past = np.zeros((0, self.memory, AXES))
        return np.zeros(0, np.int64), past, vectors, vectors, scalars, scalars, scalars, scalars

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Take one observation."""
        z = signal(observed, self.channel)
        past = np.concatenate([rows[1][-1][1:], z[None]]) if len(rows[0]) else np.tile(z, (self.memory, 1))
        steps = np.sqrt((np.diff(past, axis=0) ** 2).sum(axis=1))
        n = append(rows[0], 0)
        start = append(rows[2], z)
        before = append(rows[3], past[-2] - past[-2 - self.chord])
        speed = append(rows[4], steps[-1])
        peak_before = append(rows[5], steps[:-1].max())
        young = n <= self.reach
        peak_after = append(rows[6], 0.0)
        peak_after = np.where((n > 0) & young, np.maximum(peak_after, steps[-1]), peak_after)
        peak = np.minimum(peak_before, peak_after)
        weight = np.where(
            (n >= self.chord) & young,
            self._log_weight(before, z - start, speed, peak),
            append(rows[7], 0.0),
        )
        every = np.tile(past, (len(n), 1, 1))
        return n + 1, every, start, before, speed, peak_before, peak_after, weight

    def _log_weight(self, before: Array, after: Array, speed: Array, peak: Array) -> Array:
        """(h,) of displacements (h, 3) [unit] before and after, the step at the start and the lesser peak."""
        lengths = np.sqrt((before**2).sum(axis=1)), np.sqrt((after**2).sum(axis=1))
        known = (peak > self.pace) & (lengths[0] > LENGTH_FLOOR) & (lengths[1] > LENGTH_FLOOR)
        cosine = (before * after).sum(axis=1) / np.where(known, lengths[0] * lengths[1], 1.0)
        turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        turned = (turn - self.turn_deg) / self.turn_width_deg
        dipped = (self.dip - speed / np.where(known, peak, 1.0)) / self.dip_width
        flight = np.minimum(speed**2 / self.fast**2, 1.0) if self.fast else 1.0
        gamma = self.standing + (self.gamma - self.standing) * flight
        weight: Array = np.where(known, gamma * _logistic(turned) * _logistic(dipped), 0.0)
        return weight

    def log_evidence(self, rows: Rows) -> Array:
        """(h,)."""
        return np.asarray(rows[7], np.float64)


def _logistic(x: Array) -> Array:
    """S(x) = 1/(1 + exp(−x)); the argument of the exponential is bounded, so that nothing overflows."""
    result: Array = 1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0)))
    return result

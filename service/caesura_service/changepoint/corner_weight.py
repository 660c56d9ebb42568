"""The weight of a corner: a movement starts where the path turns while its speed dips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import AXES, Channel, ModelInput, Rows, append, signal

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CornerWeight:
    """A weight on the start of a movement, above 1 where the path has a corner.

    The log weight is γ(v) T(turn) S((0.6 − r)/0.08), with T(turn) = (S((turn − 45°)/15°) − S(−3)) / (1 −
    S(−3)) and S the logistic function. `turn` is the angle between the path over `chord` observations before
    the start and the path since. r is the speed at the start, divided by the lesser of the peaks within
    `reach` chords before and after. So a curve without a dip, or a dip without a turn, starts no movement: it
    is a via point of the path. T is 0 without a turn, because S alone would leave 5 % of γ.

    A corner lies between two straight sections: the weight is multiplied by S((q − `straight`)/0.03) for
    each, with q the ratio of its chord to its length. So a turn as long as the sections is a curve, and a
    turn beside a corner is not a second corner.

    A fast hand turns in less time than a slow one, so a corner has no fixed duration. Several `chords` are
    evaluated, and the largest weight counts (scale space: Lindeberg 1998).

    A hand's steps err by `noise`, so the direction of a way of k steps and length L has an error of √k
    noise/L. `turn` is what the errors of both ways do not explain: the sum of their squares is taken from its
    square. A slow line bends by 30° and more without a corner.

    The log weight of a chord is 0 for the first `chord` observations of a segment, is updated up to `reach`,
    and then stays constant. It does not depend on observations after the segment.

    γ(v) compensates the log evidence that a start at speed v costs a movement: `standing` + (`gamma` −
    `standing`) min(1, v²/`fast`²). At standstill this is the cost of any start: hazard, kind and burst. A
    movement that does not begin at rest has an additional cost for its speed. So a corner does not replace a
    rest. v is the least speed from `chord` observations before the start to the last one: that at the bottom
    of the dip. A start on the flank of a dip has no higher γ, so a movement that speeds up after a slow touch
    does not begin a second time.

    gamma, standing [nats]; fast [unit] a step, 0 for `gamma` at any speed. pace [unit]: least step at a peak,
    and least mean step of the straight section on either side, because a hand at rest has no corners. After
    the start it is also the least mean step of the first `chord` observations: a hand that goes on later has
    rested. noise [unit] of a step, 0 for exact directions. channel: the position [m], or the rotation [rad],
    where a turn back, or a turn about another axis, is a corner.
    """

    gamma: float
    pace: float
    turn_deg: float = 45.0
    turn_width_deg: float = 15.0
    dip: float = 0.6
    dip_width: float = 0.08
    straight: float = 0.0  # 0: its ways may be curved
    straight_width: float = 0.03
    noise: float = 0.0
    chords: tuple[int, ...] = (2, 3, 4)
    reach: float = 5.0 / 3.0
    channel: Channel = "position"
    standing: float = 0.0
    fast: float = 0.0

    @property
    def reaches(self) -> tuple[int, ...]:
        """The number of observations within which the peaks of each chord lie."""
        return tuple(round(self.reach * chord) for chord in self.chords)

    @property
    def memory(self) -> int:
        """The number of values that the weight of a start depends on."""
        return 2 * max(self.reaches) + 2

    def empty(self) -> Rows:
        """Return empty rows: n, last values, log weight of each chord."""
        return np.zeros(0, np.int64), np.zeros((0, self.memory, AXES)), np.zeros((0, len(self.chords)))

    def extend(self, rows: Rows, observed: ModelInput) -> Rows:
        """Return the rows after one more observation."""
        z = signal(observed, self.channel)
        past = np.concatenate([rows[1][-1][1:], z[None]]) if len(rows[0]) else np.tile(z, (self.memory, 1))
        n, weights = append(rows[0], 0), append(rows[2], np.zeros(len(self.chords)))
        for which, (chord, reach) in enumerate(zip(self.chords, self.reaches, strict=True)):
            for age in range(chord, reach + 1):
                weights[n == age, which] = self._log_weight(past, age, chord, reach)
        return n + 1, np.tile(past, (len(n), 1, 1)), weights

    def _log_weight(self, past: Array, age: int, chord: int, reach: int) -> float:
        """Return the log weight of the start `age` observations ago, at one chord.

        past: (memory, 3) the last values [unit]; chord, reach: in observations.
        """
        before, after = past[-2 - age] - past[-2 - age - chord], past[-1] - past[-1 - age]
        begun = past[-1 - age + chord] - past[-1 - age]
        lengths = [float(np.sqrt((way**2).sum())) for way in (before, after, begun)]
        steps = np.sqrt((np.diff(past[-2 - age - reach :], axis=0) ** 2).sum(axis=1))
        speed, peak = steps[reach], min(steps[:reach].max(), steps[reach + 1 :].max())
        if min(peak, lengths[0] / chord, lengths[1] / age, lengths[2] / chord) <= self.pace:
            return 0.0
        turn = np.arccos(np.clip((before * after).sum() / (lengths[0] * lengths[1]), -1.0, 1.0))
        by_chance2 = self.noise**2 * (chord / lengths[0] ** 2 + age / lengths[1] ** 2)
        dipped = (self.dip - speed / peak) / self.dip_width
        slowest = float(steps[reach - chord :].min())
        flight = min(slowest**2 / self.fast**2, 1.0) if self.fast else 1.0
        gamma = self.standing + (self.gamma - self.standing) * flight
        turned = self._turned(np.degrees(np.sqrt(max(turn**2 - by_chance2, 0.0))))
        weight = gamma * turned * _logistic(dipped)
        if self.straight:
            weight *= self._straightness(lengths[0], steps[reach - chord : reach])
            weight *= self._straightness(lengths[1], steps[reach + 1 :])
        return float(weight)

    def _turned(self, turn: float) -> float:
        """Return a factor near 1 for a clear turn [degrees], and 0 without one."""
        share, unturned = (_logistic((t - self.turn_deg) / self.turn_width_deg) for t in (turn, 0.0))
        return (share - unturned) / (1.0 - unturned)

    def _straightness(self, chord_length: float, steps: Array) -> float:
        """Return a factor near 1 for a straight section, near 0 for a curved one; steps: their lengths."""
        return _logistic((chord_length / float(steps.sum()) - self.straight) / self.straight_width)

    def log_evidence(self, rows: Rows) -> Array:
        """Return (h,) log evidence of each hypothesis."""
        weight: Array = rows[2].max(axis=1)
        return weight


def _logistic(x: float) -> float:
    """Return S(x) = 1/(1 + exp(−x)); the exponent is bounded to avoid overflow."""
    return float(1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0))))

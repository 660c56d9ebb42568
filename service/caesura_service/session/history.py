"""What a session's observations were, kept compactly: one row of numbers each."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.models import Observed
from caesura_service.program import Moment
from caesura_service.signals import Observation

Array = NDArray[np.float64]

_T, _POSITION, _FORCE = 0, slice(1, 4), slice(4, 7)
_SUM, _SUM2, _HOLDING, _AFTER_GAP, _COLUMNS = 7, 8, 9, 10, 11
_PARTS = {"orientation": 4, "joints": 7, "gripper_width": 1}  # of a pose, which only some sessions have
PRESS_SHARE, PRESS_LOOKS = 0.7, 600
EMPTY_GRIPPER_M = 0.003  # fingers that settle closer than this hold nothing


class History:
    """Rows of observations, with running sums of the vertical force so that any mean costs the same."""

    def __init__(self) -> None:
        self._rows = np.empty((256, _COLUMNS))
        self._parts: dict[str, Array] = {}  # those of _PARTS that there are
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def t_last(self) -> float:
        """[s] the last observation; −inf before the first."""
        return float(self._rows[self._count - 1, _T]) if self._count else -np.inf

    def append(self, observation: Observation) -> None:
        """Keep one more observation."""
        if self._count == len(self._rows):
            self._rows = _grown(self._rows)
            self._parts = {name: _grown(rows) for name, rows in self._parts.items()}
        row = self._rows[self._count]
        row[_T] = observation.t
        row[_POSITION], row[_FORCE] = observation.position_base, observation.force_base
        row[_HOLDING], row[_AFTER_GAP] = holding(observation), observation.after_gap
        before, before2 = self._sums(self._count)
        fz = float(observation.force_base[2])
        row[_SUM], row[_SUM2] = before + fz, before2 + fz * fz
        self._append_parts(observation)
        self._count += 1

    def _append_parts(self, observation: Observation) -> None:
        for name, width in _PARTS.items():
            part = getattr(observation, name)
            if part is not None and name not in self._parts:
                self._parts[name] = np.full((len(self._rows), width), np.nan)
            if name in self._parts:
                self._parts[name][self._count] = np.nan if part is None else part

    def observed(self, index: int) -> Observed:
        """What the segment models see of an observation."""
        row = self._rows[index]
        return Observed(row[_POSITION].copy(), row[_FORCE].copy(), float(row[_HOLDING]))

    def after_gap(self, index: int) -> bool:
        """Are samples missing before it?"""
        return bool(self._rows[index, _AFTER_GAP])

    def t(self, index: int) -> float:
        """[s] time of an observation."""
        return float(self._rows[index, _T])

    def position(self, index: int) -> tuple[float, float, float]:
        """[m] flange position."""
        x, y, z = self._rows[index, _POSITION].tolist()
        return x, y, z

    def force(self, index: int) -> tuple[float, float, float]:
        """[N] tared force on the robot."""
        x, y, z = self._rows[index, _FORCE].tolist()
        return x, y, z

    def press(self, start: int, end: int) -> tuple[float, float, float]:
        """[N] median of the force from start to end, the end not included, while it was strong.

        Strong is PRESS_SHARE of what a tenth of the time exceeds: touching and letting go are left out. At
        most PRESS_LOOKS observations are looked at, evenly spread.
        """
        stride = -(-(end - start) // PRESS_LOOKS)
        forces = self._rows[start:end:stride, _FORCE]
        sizes = np.sqrt(np.square(forces) @ np.ones(3))
        strong = np.sort(forces[sizes >= PRESS_SHARE * _upper_decile(sizes)], axis=0)
        x, y, z = (0.5 * (strong[(len(strong) - 1) // 2] + strong[len(strong) // 2])).tolist()
        return x, y, z

    def vertical_force(self, start: int, end: int) -> tuple[float, float]:
        """Mean [N] and variance [N²] of the vertical force from start to end, the end not included."""
        before, before2 = self._sums(start)
        until, until2 = self._sums(end)
        mean, mean2 = (until - before) / (end - start), (until2 - before2) / (end - start)
        return mean, max(mean2 - mean * mean, 0.0)

    def _sums(self, end: int) -> tuple[float, float]:
        """Of the vertical force [N] and its square [N²] before an observation."""
        if not end:
            return 0.0, 0.0
        total, total2 = self._rows[end - 1, _SUM : _SUM2 + 1].tolist()
        return total, total2

    def moment(self, t: float) -> Moment:
        """The pose at the observation nearest to a time [s]."""
        if not self._count:
            raise IndexError("no observation yet")
        times, last = self._rows[: self._count, _T], self._count - 1
        after = min(max(bisect_left(times, t), 1), last)
        index = after - 1 if after and t - times[after - 1] <= times[after] - t else after
        return self.moment_at(index)

    def moment_at(self, index: int) -> Moment:
        """The pose at an observation."""
        width = self._part("gripper_width", index)
        return Moment(
            position=self.position(index),
            orientation=self._part("orientation", index),
            joints=self._part("joints", index),
            gripper_width=None if width is None else width[0],
            force=self.force(index),
        )

    def _part(self, name: str, index: int) -> Any:
        rows = self._parts.get(name)
        part = None if rows is None else tuple(rows[index].tolist())
        return None if part is None or math.isnan(part[0]) else part


def _upper_decile(values: Array) -> float:
    """What a tenth of them exceeds: as np.quantile says, which takes twenty times as long for a few."""
    ordered = np.sort(values)
    below, share = divmod(0.9 * (len(ordered) - 1), 1.0)
    low, high = ordered[int(below)], ordered[min(int(below) + 1, len(ordered) - 1)]
    return float(low + share * (high - low))


def _grown(rows: Array) -> Array:
    """An eighth more. Not twice as many: large arrays are of huge pages, which exist whole once touched."""
    grown = np.empty((len(rows) + max(len(rows) // 8, 256), rows.shape[1]))
    grown[: len(rows)] = rows
    return grown


def holding(observation: Observation) -> float:
    """1 the gripper holds something, 0 it does not, nan unknown."""
    if observation.gripper_closed is None:
        return np.nan
    empty = observation.gripper_width is not None and observation.gripper_width <= EMPTY_GRIPPER_M
    return float(observation.gripper_closed and not empty)

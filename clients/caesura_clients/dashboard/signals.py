"""Position, speed and force for the plot, as means over cells of 1/25 s.

A ring holds the newest SPAN_S of one session. Who draws asks for what came after the rows it has.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import COLUMNS_OF_SIGNAL

RATE_HZ = 25.0
SPAN_S = 60.0
CAPACITY = round(RATE_HZ * SPAN_S)  # rows a station
LONGEST_STEP_S = 0.5  # between rows that belong together; a longer one is drawn as a hole
FARTHEST_S = 1e10  # a session time beyond it is none; a service refuses it as well
SCALE = {"m": 1.0, "cm": 0.01, "mm": 0.001}

Array = NDArray[np.float64]


class CellMeans(NamedTuple):
    """Means over one cell of the grid; None where the robot does not say."""

    t: float  # [s] session time, the middle of the cell
    position: tuple[float, float, float] | None  # [m]
    speed: float | None  # [m/s], or [rad/s] of all joints together where there is no position
    force: tuple[float, float, float] | None  # [N] as measured


class Rows(NamedTuple):
    """The rows of a ring that a browser has not received yet."""

    session: str
    unit: str  # of the speed
    next: int  # to be given the next time
    rows: tuple[CellMeans, ...]


class SignalRing:
    """The newest rows of one station; written by one thread, read by others."""

    def __init__(self) -> None:
        self._rows: deque[CellMeans] = deque(maxlen=CAPACITY)
        self._lock = threading.Lock()
        self._decimator = Decimator()
        self._session, self._unit = "", "m/s"
        self._columns: tuple[str, ...] = ()
        self._count = 0  # rows ever made of this session

    def receive(self, session: str, columns: tuple[str, ...], matrix: Array) -> None:
        """Take samples (n, columns), session time [s] first. Another session begins anew."""
        with self._lock:
            if session != self._session:
                self._rows.clear()
                self._decimator, self._session, self._count = Decimator(), session, 0
            elif columns != self._columns:
                self._decimator = Decimator()
            self._columns = columns
            self._unit = "m/s" if "px" in columns else "rad/s"
            made = self._decimator.receive(columns, matrix)
            self._rows.extend(made)
            self._count += len(made)

    def after(self, seen: int = 0, session: str | None = None) -> Rows:
        """The rows that are held of those from number `seen` on; of all, if that was another session's."""
        with self._lock:
            seen = seen if session in {None, self._session} else 0
            missing = min(max(0, self._count - seen), len(self._rows))
            rows = tuple(self._rows)[len(self._rows) - missing :]
            return Rows(self._session, self._unit, self._count, rows)


class Decimator:
    """Samples of one session into rows: a fold that holds back the cell that may still get samples."""

    def __init__(self) -> None:
        self._cell = -(1 << 62)  # the one that is being filled
        self._sum: Array | None = None  # of its samples, which have no end while time stands still
        self._samples = 0
        self._before: tuple[float, Array] | None = None  # time and place of the last row

    def receive(self, columns: tuple[str, ...], matrix: Array) -> list[CellMeans]:
        """The rows that are complete. What comes late or again is left out."""
        matrix = matrix[np.abs(matrix[:, 0]) < FARTHEST_S]
        cells = np.floor(matrix[:, 0] * RATE_HZ).astype(np.int64)
        rows = []
        for cell in np.unique(cells[cells >= self._cell]).tolist():
            if cell > self._cell:
                rows += self._finish(columns)
                self._cell = cell
            some = matrix[cells == cell]
            total = some.sum(axis=0)
            self._sum = total if self._sum is None else self._sum + total
            self._samples += len(some)
        return rows

    def _finish(self, columns: tuple[str, ...]) -> list[CellMeans]:
        if self._sum is None:
            return []
        mean = self._sum / self._samples
        self._sum, self._samples = None, 0
        named = dict(zip(columns, mean.tolist(), strict=True))
        t = (self._cell + 0.5) / RATE_HZ
        place = _vector(named, "pos")
        joints = _vector(named, "q")
        where = place if place is not None else joints
        speed = None if where is None else self._speed(t, np.array(where))
        return [CellMeans(t, _three(place), speed, _three(_vector(named, "force")))]

    def _speed(self, t: float, where: Array) -> float | None:
        before, self._before = self._before, (t, where)
        if before is None or t - before[0] > LONGEST_STEP_S or before[1].shape != where.shape:
            return None
        return float(np.linalg.norm(where - before[1])) / (t - before[0])


def _vector(named: Mapping[str, float], signal: str) -> tuple[float, ...] | None:
    columns = COLUMNS_OF_SIGNAL[signal]
    return tuple(named[column] for column in columns) if set(columns) <= named.keys() else None


def _three(values: tuple[float, ...] | None) -> tuple[float, float, float] | None:
    return None if values is None else (values[0], values[1], values[2])


def drawn(row: CellMeans, scale: float = 1.0) -> list[Any]:
    """A row as the browser takes it: t, x, y, z [m], speed, fx, fy, fz [N]. scale: of lengths, to metres."""
    position = (None,) * 3 if row.position is None else tuple(round(v * scale, 4) for v in row.position)
    force = (None,) * 3 if row.force is None else tuple(round(v, 2) for v in row.force)
    metres = scale if row.position is not None else 1.0
    speed = None if row.speed is None else round(row.speed * metres, 4)
    return [round(row.t, 3), *position, speed, *force]

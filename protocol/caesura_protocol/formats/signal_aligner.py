"""Joins signals of different messages and times into rows of one matrix.

A row is made for every value of the leading signal (`pos`, or else `q`). Each other signal has its newest
value at or before that time, never a later one, which does not exist in a live stream. If a signal pauses for
longer than MAX_AGE_S, no rows are made until it continues, and the service has a gap. A gripper may pause
without a limit, because it publishes when it moves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from caesura_protocol.columns import columns_of
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, JOINTS

NS = 10**9
MAX_AGE_S = 0.5
HELD = 20_000  # values of a signal that wait for the leader, live
FOREVER = float("inf")
Row = list[float]
Values = Sequence[float]


class SignalAligner:
    """Joins values with their stamps [ns] to rows (t, …); t [s] counts from the leading signal's first stamp.

    signals: those of a row; patience_s: how long a row waits for a delayed signal. It must be short for a
    live stream, and may be FOREVER for a file.
    """

    def __init__(self, signals: Sequence[str], *, patience_s: float = FOREVER, joints: int = JOINTS) -> None:
        self.signals = tuple(name for name in COLUMNS_OF_SIGNAL if name in signals)
        self.leader = "pos" if "pos" in self.signals else "q"
        self.columns = columns_of(self.signals, joints)
        self.skipped = 0  # values of the leader for which another signal was not there
        self.latest_s = 0.0  # the newest row
        self._patience_ns = patience_s * NS
        self._first: int | None = None
        self._led: deque[tuple[int, Values]] = deque()
        self._others: dict[str, deque[tuple[int, Values]]] = {
            name: deque() for name in self.signals if name != self.leader
        }
        self._now: dict[str, tuple[int, Values]] = {}  # the newest of each at or before the row

    def push(self, stamp: int, values: Mapping[str, Values]) -> list[Row]:
        """Add the values of one message; return the rows that are complete."""
        for name, value in values.items():
            if name == self.leader:
                self._led.append((stamp, value))
            elif name in self._others:
                self._hold(name, stamp, value)
        return self._rows(self._patience_ns)

    def _hold(self, name: str, stamp: int, value: Values) -> None:
        queue = self._others[name]
        queue.append((stamp, value))
        if self._patience_ns != FOREVER and len(queue) > HELD:
            self._now[name] = queue.popleft()

    def flush(self) -> list[Row]:
        """Return the rows that still wait, at the end of the input."""
        return self._rows(-1.0)

    def _rows(self, patience_ns: float) -> list[Row]:
        rows = []
        while self._led and self._is_ready(patience_ns):
            row = self._row(*self._led.popleft())
            if row is None:
                self.skipped += 1
            else:
                rows.append(row)
                self.latest_s = row[0]
        return rows

    def _is_ready(self, patience_ns: float) -> bool:
        stamp, newest = self._led[0][0], self._led[-1][0]
        if newest - stamp > patience_ns:
            return True
        waited = self._others.items()
        if patience_ns != FOREVER:
            waited = {name: queue for name, queue in waited if name != "gripper"}.items()
        return all(queue and queue[-1][0] >= stamp for _, queue in waited)

    def _row(self, stamp: int, value: Values) -> Row | None:
        for name, queue in self._others.items():
            while queue and queue[0][0] <= stamp:
                self._now[name] = queue.popleft()
        if self._first is None:
            if self._now.keys() != self._others.keys():
                return None
            self._first = stamp
        for name, (reported, _) in self._now.items():
            if name != "gripper" and stamp - reported > MAX_AGE_S * NS:
                return None
        row = [(stamp - self._first) / NS]
        for name in self.signals:
            row.extend(value if name == self.leader else self._now[name][1])
        return row

"""Converts times of a session for display: times of day are shown relative to the session's start.

Most sessions count from 0. If samples have the time of day, as in a rosbag2, tables show seconds from the
first segment on, and the date of it. Typed times are read in the same way. Files and messages keep the clock
of the samples.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

from caesura_protocol.messages import Segment
from caesura_protocol.number_words import LONG, fixed, interval

_DECIMAL = re.compile(r"(?<![\w.-])\d+\.(\d+)(?!\w|\.\d)")  # no part of a name, nor of a version
NEWEST = 3  # stretches of time that a line names
OF_DAY_S = 1e8  # from here on a time is one of day: no robot has counted seconds for three years


class SessionClock(NamedTuple):
    """start_s: the session time [s] that is displayed as 0."""

    start_s: float = 0.0

    def shown(self, t: float, decimals: int = 2) -> str:
        """Return a time [s] of the session as displayed."""
        return fixed(t - self.start_s, decimals)

    def interval(self, t0: float, tn: float, between: str = "–") -> str:
        """Return two times [s] of the session as displayed, as `number_words.interval`."""
        return interval(t0 - self.start_s, tn - self.start_s, 2, between)

    def newest(self, stretches: Sequence[tuple[float, float]], count: int) -> str:
        """Return text with the times [s] of the newest of `count` stretches.

        stretches: the last of them, in time order.

        >>> SessionClock().newest([(5.0, 5.25)], 1), SessionClock().newest([(5.0, 5.25)], 9)
        ('at 5.00–5.25 s', 'the newest at 5.00–5.25 s')
        """
        times = ", ".join(self.interval(t0, tn) for t0, tn in stretches[-NEWEST:])
        return f"{'the newest at' if count > NEWEST else 'at'} {times} s"

    def brief(self, t: float) -> str:
        """Return a time [s] as displayed, without trailing zeros."""
        return f"{t - self.start_s:g}"

    def read(self, t: float) -> float:
        """Return a typed time [s] on the session's clock; a time of day is unchanged."""
        return t if is_of_day(t) else t + self.start_s

    def text(self, note: str) -> str:
        """Return a sentence, such as a note of a program, with its times of day as displayed.

        >>> SessionClock(1700000001.25).text("Not observed: 1700000003.00–1700000003.75 s, before 2.50 s")
        'Not observed: 1.75–2.50 s, before 2.50 s'
        """
        return _DECIMAL.sub(self._shown_of_day, note) if self.start_s else note

    def _shown_of_day(self, found: re.Match[str]) -> str:
        t, decimals = float(found[0]), len(found[1])
        return self.shown(t, decimals) if is_of_day(t) else found[0]

    @property
    def words(self) -> str:
        """Text on the time that is displayed as 0; empty if displayed times are those of the session's clock.

        >>> SessionClock(1700000001.25).words, SessionClock().words
        ('times [s] from 2023-11-14 22:13:21 UTC on, the start', '')
        """
        return f"times [s] from {moment(self.start_s)} UTC on, the start" if self.start_s else ""


NO_OFFSET = SessionClock()


def clock_from(t: float) -> SessionClock:
    """Return the clock of a session that begins at t [s]: from there on for a time of day, else from 0."""
    return SessionClock(t if is_of_day(t) else 0.0)


def clock_of(segments: Sequence[Segment]) -> SessionClock:
    """Return the clock of a session from its segments."""
    return clock_from(segments[0].t0) if segments else NO_OFFSET


def is_of_day(t: float) -> bool:
    """Return whether a time [s] is a time of day."""
    return OF_DAY_S <= t < LONG / 10


def moment(t: float) -> str:
    """Return a time of day [s] as a date, UTC."""
    return f"{datetime.fromtimestamp(t, UTC):%Y-%m-%d %H:%M:%S}"


def local_moment(t: float) -> str:
    """Return a time of day [s] as local date and time, to the minute."""
    return f"{datetime.fromtimestamp(t):%Y-%m-%d %H:%M}"

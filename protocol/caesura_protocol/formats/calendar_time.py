"""Converts times of day in a file, ISO 8601 or numpy's, to seconds from the first sample.

A time without a zone is taken as UTC. A file that mixes times with and without a zone is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import BEGAN
from caesura_protocol.session_time_display import is_of_day

Array = NDArray[np.float64]

NS = 1e-9  # [s]
EXPECTED = "a date with a time, such as 2026-11-24T09:00:00.250 (ISO 8601)"


class CalendarTimes(NamedTuple):
    """Times [s] from the first one, the text of the first one in the file, and its time of day [s] (UTC).

    began_s: None for times that have no date; has_zone: whether the file states their zone.
    """

    t: Array
    first: str
    began_s: float | None
    has_zone: bool = False

    @property
    def in_words(self) -> str:
        """A sentence on what the times were, and what is assumed of them."""
        assumed = "" if self.has_zone or self.began_s is None else ", taken as UTC"
        return f"Times are seconds from the first sample, which is at {self.first}{assumed}."

    @property
    def options(self) -> dict[str, str]:
        """The time of day as an option of a file; empty without one, or before 1973."""
        is_known = self.began_s is not None and is_of_day(self.began_s)
        return {BEGAN: repr(self.began_s)} if is_known else {}


def is_calendar_time(cell: str) -> bool:
    """Return whether a cell contains a date with a time.

    >>> is_calendar_time("2026-11-24T18:04:32.5Z"), is_calendar_time("20261124"), is_calendar_time("1.5")
    (True, False, False)
    """
    return _parsed(cell) is not None


def seconds_of(cells: Sequence[str], places: Sequence[str]) -> CalendarTimes:
    """Convert the times of all samples. places: their names in errors.

    Raises ValueError for an invalid one.
    """
    times: list[datetime] = []
    for place, cell in zip(places, cells, strict=True):
        time = _parsed(cell)
        if time is None:
            raise ValueError(f"{place}: t is {cell!r}, expected {EXPECTED} as before")
        if times and (time.tzinfo is None) != (times[0].tzinfo is None):
            raise ValueError(
                f"{place}: t is {cell!r}, and the first one is {cells[0]!r}: expected a time zone in "
                "all or in none"
            )
        times.append(time)
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    has_zone = times[0].tzinfo is not None
    first = times[0] if has_zone else times[0].replace(tzinfo=UTC)
    return CalendarTimes(seconds, cells[0], first.timestamp(), has_zone)


def seconds_of_array(values: NDArray[np.generic]) -> CalendarTimes:
    """Convert times of type `datetime64` or `timedelta64`. Raises ValueError for an invalid one."""
    if np.isnat(values).any():
        row = int(np.isnat(values).argmax())
        raise ValueError(
            f"sample {row}: t is {values[row]}, expected a time: leave out the samples that have none"
        )
    nanoseconds = (values - values[0]).astype("timedelta64[ns]").astype(np.float64)
    began_s = None
    if values.dtype.kind == "M":
        whole_s, rest_ns = divmod(int(values[0].astype("datetime64[ns]").astype(np.int64)), 10**9)
        began_s = whole_s + rest_ns * NS
    return CalendarTimes(nanoseconds * NS, str(values[0]), began_s)


def _parsed(cell: str) -> datetime | None:
    """Return the date of a cell; None for a number, such as 20261124, or other text."""
    try:
        float(cell)
    except ValueError:
        try:
            return datetime.fromisoformat(cell.strip())
        except ValueError:
            return None
    return None

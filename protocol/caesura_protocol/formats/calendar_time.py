"""Times of day in a file, ISO 8601 or numpy's, as seconds from the first sample.

A time without a zone is taken as it stands. Times with and without one, mixed in a file, are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NS = 1e-9  # [s]
EXPECTED = "a date with a time, such as 2026-11-24T09:00:00.250 (ISO 8601)"
CALENDAR = "Times are seconds from the first sample, which is at {}."


class CalendarTimes(NamedTuple):
    """Times [s] from the first one, and the first one as it stands in the file."""

    t: Array
    first: str


def is_calendar_time(cell: str) -> bool:
    """Whether a cell holds a date with a time.

    >>> is_calendar_time("2026-11-24T18:04:32.5Z"), is_calendar_time("20261124"), is_calendar_time("1.5")
    (True, False, False)
    """
    return _parsed(cell) is not None


def seconds_of(cells: Sequence[str], places: Sequence[str]) -> CalendarTimes:
    """Times of all samples. places: their names in errors. Raises ValueError for the first wrong one."""
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
    return CalendarTimes(np.array([(time - times[0]).total_seconds() for time in times]), cells[0])


def seconds_of_array(values: NDArray[np.generic]) -> CalendarTimes:
    """Times of numpy's kind `datetime64` or `timedelta64`. Raises ValueError for one that is not a time."""
    if np.isnat(values).any():
        row = int(np.isnat(values).argmax())
        raise ValueError(
            f"sample {row}: t is {values[row]}, expected a time: leave out the samples that have none"
        )
    nanoseconds = (values - values[0]).astype("timedelta64[ns]").astype(np.float64)
    return CalendarTimes(nanoseconds * NS, str(values[0]))


def _parsed(cell: str) -> datetime | None:
    """The date of a cell; None where it is a number, such as 20261124, or no date."""
    try:
        float(cell)
    except ValueError:
        try:
            return datetime.fromisoformat(cell.strip())
        except ValueError:
            return None
    return None

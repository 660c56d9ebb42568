"""Retention: which closed sessions are deleted, by age, size and number.

Age counts time of use: a pause without records counts as at most PAUSE_S. So no session expires early because
a clock was years ahead, a copy was restored, or the service did not run.

Stations share its size fairly. A station's part is the size to which the largest stations have to shrink so
that all of them fit. Past the size, the largest station over its part loses its oldest closed sessions; a
station within its part loses nothing to another. Open sessions are never deleted for their size:
`station_quota` bounds them. The number of sessions of a station is bounded too, because the search for
sessions to delete takes time for each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

DAY_S = 86400.0
GB = 10**9
PAUSE_S = 7 * DAY_S


@dataclass(frozen=True)
class JournalSettings:
    """The delay of writing records, and the limits of the journal's content. Raises ValueError below 0."""

    commit_s: float = 0.05  # 0: each is written at once
    waiting_bytes: int = 1 << 26  # that wait to be written; past that, appends are refused
    age_s: float = 30 * DAY_S  # since a session was last touched, in time of use
    size_bytes: int = 10 * GB  # of all sessions
    sessions: int = 20_000  # of a station

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value < 0:
                raise ValueError(f"{name} is {value}, expected 0 or more")


class StationUsage(NamedTuple):
    """The size and number of one station's sessions in a journal."""

    station: str
    size: int  # [bytes]
    sessions: int
    closed: int  # of these
    touched: float  # [s] the session that was not written to for longest


class Excess(NamedTuple):
    """Closed sessions of a station that must be deleted, the oldest first, and the reason."""

    station: str
    size: int  # [bytes] in all, or 0
    sessions: int  # or 0
    why: str


def expiry(touched: Iterable[float], now: float, age_s: float) -> float:
    """Return the time of day [s] before which sessions are too old; -inf if none is.

    touched: times [s] at which records were written, the newest first, at least one in each PAUSE_S of use.
    """
    age = 0.0
    for earlier in touched:
        used = min(now - earlier, PAUSE_S)
        if age + used > age_s:
            return now - (age_s - age)
        age, now = age + used, earlier
    return -math.inf


def excess(usages: Sequence[StationUsage], settings: JournalSettings) -> Excess | None:
    """Return the sessions to delete next: of a station with too many, or of the largest one over its part.

    The largest station loses no more than brings it to the size of the next one, or to its part. None if
    nothing must be deleted.
    """
    many = max(usages, key=lambda one: one.sessions, default=None)
    if many is not None and many.closed and many.sessions > settings.sessions:
        why = f"the oldest closed one of {many.sessions} of the station; the limit is {settings.sessions}"
        return Excess(many.station, 0, many.sessions - settings.sessions, why)
    size, part = sum(one.size for one in usages), part_of(usages, settings)
    if part is None:
        return None
    largest = sorted((one for one in usages if one.closed and one.size > part), key=lambda one: -one.size)
    if not largest:
        return None
    most, rest = largest[0], largest[1].size if largest[1:] else part
    why = (
        f"the oldest closed one of the largest station, {most.size / GB:.3g} GB of "
        f"{size / GB:.3g}; the limit is {settings.size_bytes / GB:g}"
    )
    return Excess(most.station, min(size - settings.size_bytes, max(most.size - rest, 1)), 0, why)


def part_of(usages: Sequence[StationUsage], settings: JournalSettings) -> int | None:
    """Return the part of a station [bytes], the size to which the largest must shrink; None if all fit."""
    left = settings.size_bytes
    sizes = sorted(one.size for one in usages)
    for number, size in enumerate(sizes):
        stations = len(sizes) - number
        if size * stations > left:
            return left // stations
        left -= size
    return None


def open_part(usages: Sequence[StationUsage], settings: JournalSettings) -> int | None:
    """Return the part of a station if the journal is too large and no session can be deleted."""
    return None if excess(usages, settings) else part_of(usages, settings)

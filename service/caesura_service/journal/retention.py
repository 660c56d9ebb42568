"""Retention: which closed sessions are deleted, by age, size and number.

Stations share its size fairly. Past it, the station that takes most loses its oldest closed session, so one
that takes no more than its part loses nothing to another; and the open sessions of one station, which are
never dropped, take half of it at most. The number of sessions of a station is bounded too, because a look for
what has to go takes a time for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

DAY_S = 86400.0
GB = 10**9


@dataclass(frozen=True)
class JournalSettings:
    """How long a record may wait to be written, and how much is kept. Raises ValueError below 0."""

    commit_s: float = 0.05  # 0: each is written at once
    waiting_bytes: int = 1 << 26  # that wait to be written; past that, appends are refused
    age_s: float = 30 * DAY_S  # since a session was last touched
    size_bytes: int = 10 * GB  # of all sessions
    sessions: int = 20_000  # of a station

    @cached_property
    def open_bytes(self) -> int:
        """That the open sessions of one station may take, so that none takes the place of all."""
        return max(self.size_bytes // 2, self.waiting_bytes)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value < 0:
                raise ValueError(f"{name} is {value}, expected 0 or more")


class StationUsage(NamedTuple):
    """The size and number of one station's sessions in a journal."""

    station: str
    size: int  # [bytes]
    open_size: int  # [bytes] of those that are open
    sessions: int
    closed: int  # of these
    touched: float  # [s] the session that was not written to for longest


class Excess(NamedTuple):
    """Closed sessions of a station that have to go, the oldest first, and why."""

    station: str
    size: int  # [bytes] in all, or 0
    sessions: int  # or 0
    why: str


def excess(usages: Sequence[StationUsage], settings: JournalSettings) -> Excess | None:
    """Return what to delete next: of a station with too many sessions, or of the largest station.

    Of the largest no more than brings it to the size of the next one.
    """
    many = max(usages, key=lambda one: one.sessions, default=None)
    if many is not None and many.closed and many.sessions > settings.sessions:
        why = f"the oldest closed one of {many.sessions} of the station, kept are {settings.sessions}"
        return Excess(many.station, 0, many.sessions - settings.sessions, why)
    size = sum(one.size for one in usages)
    largest = sorted((one for one in usages if one.closed), key=lambda one: -one.size)[:2]
    if size <= settings.size_bytes or not largest:
        return None
    most, rest = largest[0], largest[1].size if largest[1:] else 0
    why = (
        f"the oldest closed one of the station that takes most, {most.size / GB:.3g} GB of "
        f"{size / GB:.3g}, kept are {settings.size_bytes / GB:g}"
    )
    return Excess(most.station, min(size - settings.size_bytes, max(most.size - rest, 1)), 0, why)

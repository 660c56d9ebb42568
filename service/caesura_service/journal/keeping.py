"""How long sessions stay in a journal: until they are too old or too much, closed ones first.

Stations share its size fairly. Past it, the station that takes most loses its oldest closed session, so one
that takes no more than its part loses nothing to another; and the open sessions of one station, which are
never dropped, take half of it at most.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from caesura_service.journal.journal import Key

DAY_S = 86400.0
GB = 10**9


@dataclass(frozen=True)
class JournalSettings:
    """How long a record may wait to be written, and how much is kept. Raises ValueError below 0."""

    commit_s: float = 0.05  # 0: each is written at once
    waiting_bytes: int = 1 << 26  # that wait to be written; past that, appends are refused
    age_s: float = 30 * DAY_S  # since a session was last touched
    size_bytes: int = 10 * GB  # of all sessions

    @property
    def open_bytes(self) -> int:
        """That the open sessions of one station may take, so that none takes the place of all."""
        return max(self.size_bytes // 2, self.waiting_bytes)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value < 0:
                raise ValueError(f"{name} is {value}, expected 0 or more")


class Kept(NamedTuple):
    """A session, as far as it matters for how long it stays."""

    station: str
    session: str
    touched: float  # [s]
    size: int  # [bytes]
    closed: int

    @property
    def key(self) -> Key:
        """(station, session)."""
        return self.station, self.session


def overdue(known: Sequence[Kept], settings: JournalSettings, now: float) -> Iterator[tuple[Kept, str]]:
    """What has to go, and why, in order: closed sessions first. known: oldest touched first; now [s]."""
    closed = [row for row in known if row.closed]
    for row in (*closed, *(row for row in known if not row.closed)):
        age_s = now - row.touched
        if age_s > settings.age_s:
            yield (row, f"not touched for {age_s / DAY_S:.1f} days, kept are {settings.age_s / DAY_S:g}")
    sizes = sizes_of(known)
    size = sizes.total()
    closed.sort(key=lambda row: -sizes[row.station])  # and oldest first, as they came
    for row in closed if size > settings.size_bytes else ():
        yield (
            row,
            f"the oldest closed one of the station that takes most, {sizes[row.station] / GB:.3g} GB of "
            f"{size / GB:.3g}, kept are {settings.size_bytes / GB:g}",
        )


def sizes_of(known: Sequence[Kept]) -> Counter[str]:
    """What each station takes [bytes]."""
    sizes: Counter[str] = Counter()
    for row in known:
        sizes[row.station] += row.size
    return sizes

"""How long sessions stay in a journal: until they are too old or too much, closed ones first."""

from __future__ import annotations

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
    size = sum(row.size for row in known)
    for row in closed if size > settings.size_bytes else ():
        yield (row, f"the oldest closed one of {size / GB:.3g} GB, kept are {settings.size_bytes / GB:g}")

"""A journal that lives as long as the process."""

from __future__ import annotations

from collections.abc import Iterator

from caesura_service.journal.journal import Record


class MemoryJournal:
    """Records in lists, one a session."""

    def __init__(self) -> None:
        self._records: dict[tuple[str, str], list[Record]] = {}

    def append(self, record: Record) -> None:
        """Keep a record."""
        self._records.setdefault((record.station, record.session), []).append(record)

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """The records of a session as they are now; later ones do not appear in the iteration."""
        return iter(tuple(self._records.get((station, session), ())))

    def sessions(self) -> tuple[tuple[str, str], ...]:
        """(station, session) of every session with a record, oldest first."""
        return tuple(self._records)

    def forget(self, station: str, session: str) -> None:
        """Drop the records of a session."""
        self._records.pop((station, session), None)

"""The bytes of open sessions, and the share of the journal that one station's open sessions may use.

Retention never deletes an open session. So a station's open sessions use at most half of what the open
sessions of other stations leave, and all of them together stay below the journal's size. If the journal is
over its size and retention has nothing to delete, they use no more than the station's part (`retention`).

Batches and all other records count. A close and the opening of a new session are always accepted. A resumed
opening and a declared loss, which a session may need to end, are accepted for ENDING_BYTES more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from caesura_protocol.codec import encoding_of
from caesura_protocol.messages import Error, Open
from caesura_service.journal.journal import JournalShareError, Key
from caesura_service.journal.retention import GB
from caesura_service.journal.rows import RecordRow
from caesura_service.journal.sqlite_statements import CLOSE

ENDING = (Open, Error)  # that a session may need to end: it is resumed, or a loss is declared
ENDING_BYTES = 1 << 20  # of a station past its share, for these
_ENDING_ENCODINGS = frozenset(map(encoding_of, ENDING))


class StationQuota:
    """The sizes of the open sessions of a journal, on disk and queued. The caller holds the lock."""

    def __init__(self) -> None:
        self._sizes: dict[Key, int] = {}  # [bytes]
        self._of_station: Counter[str] = Counter()  # [bytes]
        self._total = 0  # [bytes]
        self._part: int | None = None  # [bytes]

    def renew(self, sizes: Mapping[Key, int], waiting: Iterable[RecordRow], part: int | None) -> None:
        """Replace the sizes by those on disk, and add the queued rows.

        part: the limit of a station if the journal is too large and no session can be deleted, else None.
        """
        self._sizes, self._of_station, self._total, self._part = {}, Counter(), 0, part
        for key, size in sizes.items():
            self._add(key, size)
        for row in waiting:
            self.add(row)

    def add(self, row: RecordRow) -> None:
        """Add a row that was appended; one of a closed session does not count."""
        if self._counts(row):
            self._add(row.key, row.size)

    def remove(self, row: RecordRow) -> None:
        """Remove a row that could not be written."""
        if row.key in self._sizes:
            self._add(row.key, -row.size)

    def close(self, key: Key) -> None:
        """Remove a session that is closed or deleted; an unknown one is no error."""
        size = self._sizes.pop(key, 0)
        self._of_station[key[0]] -= size
        self._total -= size

    def check(self, row: RecordRow, size_bytes: int, path: Path) -> None:
        """Raise JournalShareError if the open sessions of the row's station have used their share.

        size_bytes: greatest size of the journal.
        """
        if row.encoding == CLOSE or not self._counts(row):
            return
        is_ending = row.encoding in _ENDING_ENCODINGS
        if is_ending and row.key not in self._sizes:
            return  # a new session, of which there are few: one more closes the oldest
        taken = self._of_station[row.station]
        limit = max(size_bytes - (self._total - taken), 0) // 2
        if self._part is not None:
            limit = min(limit, self._part)
        if taken >= limit + ENDING_BYTES * is_ending:
            why = (
                f"journal {path}: open sessions of station {row.station} take {taken / GB:.3g} GB, "
                f"they may take {limit / GB:.3g}: close them, or raise --journal-gb"
            )
            raise JournalShareError(why, taken, limit)

    def _counts(self, row: RecordRow) -> bool:
        """Return whether a row belongs to an open session: a closed one gets no batch, opening or loss."""
        return row.seq is not None or row.encoding in _ENDING_ENCODINGS or row.key in self._sizes

    def _add(self, key: Key, size: int) -> None:
        self._sizes[key] = self._sizes.get(key, 0) + size
        self._of_station[key[0]] += size
        self._total += size

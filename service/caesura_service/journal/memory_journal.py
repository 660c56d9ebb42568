"""A journal in memory, which is lost when the process ends."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Set
from itertools import islice

from caesura_protocol.codec import decode, encode, encoding_of
from caesura_protocol.messages import (
    Close,
    Describe,
    Edit,
    EditProgram,
    JournalReport,
    SampleBatch,
)
from caesura_service.journal.applied_edits import AppliedEdit
from caesura_service.journal.copy_conflicts import CHANGES
from caesura_service.journal.journal import (
    Copy,
    EncodedBatch,
    JournalShareError,
    Key,
    Outcome,
    Record,
    Recordable,
    Refused,
    StoredOutcome,
    is_named,
)
from caesura_service.journal.station_quota import ENDING, ENDING_BYTES

CAPACITY_BYTES = 1 << 29  # nearly an hour and a half of one station at 1 kHz, 13 columns in single precision
_OVERHEAD_BYTES = 1000  # of a record beside its content


class MemoryJournal:
    """Records in lists, one per session.

    Over its capacity the station with the most bytes loses its oldest session. If that is the session being
    recorded, it gets no further batches and changes; it can still be closed.
    """

    def __init__(self, capacity_bytes: int = CAPACITY_BYTES) -> None:
        self.capacity_bytes = capacity_bytes
        self._records: dict[Key, list[Record]] = {}
        self._sizes: dict[Key, int] = {}  # [bytes]
        self._outcomes: dict[Key, Outcome] = {}
        self._epochs: dict[str, int] = {}  # by station
        self._takeovers: dict[str, int] = {}  # their epochs, by station

    def append(self, record: Record, *, now: bool = False) -> None:
        """Append a record, and make room for it; its own session is never deleted.

        Raises JournalShareError without room. A close is always accepted, and other records that a session
        may need to end are accepted for ENDING_BYTES more.
        """
        key, size = (record.station, record.session), _size(record)
        if not isinstance(record.message, Close):
            self._make_room(key, size, ENDING_BYTES * isinstance(record.message, ENDING))
        self._records.setdefault(key, []).append(record)
        self._sizes[key] = self._sizes.get(key, 0) + size

    def append_batch(self, station: str, session: str, at: float, batch: EncodedBatch) -> None:
        """Append a batch as `append` does."""
        message = decode(batch.payload, encoding_of(SampleBatch), SampleBatch)
        self.append(Record(station, session, at, message))

    def _make_room(self, key: Key, size: int, spare: int) -> None:
        """Delete sessions until a record fits. spare: additional bytes that it may use."""
        while (total := (sizes := self._station_sizes(key, size)).total()) > self.capacity_bytes:
            most = max(sizes, key=sizes.__getitem__)
            oldest = next((known for known in self._sizes if known[0] == most and known != key), None)
            if oldest is not None:
                self.delete(*oldest)
            elif total > self.capacity_bytes + spare:
                why = (
                    f"session {'/'.join(key)} fills the journal in memory, which holds {self.capacity_bytes} "
                    "bytes: close the session, and serve with --journal DIR"
                )
                raise JournalShareError(why, sizes[most], self.capacity_bytes)
            else:
                return

    def _station_sizes(self, key: Key, size: int) -> Counter[str]:
        sizes = Counter({key[0]: size})
        for (station, _), taken in self._sizes.items():
            sizes[station] += taken
        return sizes

    def commit(self) -> None:
        """Return at once: memory has no disk."""

    def flush(self) -> None:
        """Return at once: memory has no disk."""

    def replay(self, station: str, session: str) -> Iterator[Record]:
        """Return the records of a session as they are now; later ones do not appear in the iteration."""
        return iter(tuple(self._records.get((station, session), ())))

    def edits(self, station: str, session: str) -> tuple[AppliedEdit, ...]:
        """Return the edits of a session, oldest first."""
        messages = (record.message for record in self._records.get((station, session), ()))
        return tuple(message for message in messages if isinstance(message, AppliedEdit))

    def changes(self, station: str, session: str) -> tuple[Recordable, ...]:
        """Return the edits, descriptions and program edits of a session, oldest first."""
        messages = (record.message for record in self._records.get((station, session), ()))
        return tuple(message for message in messages if isinstance(message, CHANGES))

    def edit_at(
        self, station: str, session: str, kind: type[Edit] | type[EditProgram], revision: int
    ) -> Edit | EditProgram | None:
        """Return the edit of a session, or of its program, after `revision` earlier ones.

        None without one.
        """
        messages = (record.message for record in self._records.get((station, session), ()))
        made = (message for message in messages if isinstance(message, kind))
        return next(islice(made, revision, None), None)

    def sessions(self) -> tuple[Key, ...]:
        """Return (station, session) of every session, oldest first."""
        return tuple(self._records)

    def closed(self) -> Set[Key]:
        """Return the sessions with a close."""
        return {key for key, records in self._records.items() if _is_closed(records)}

    def copies(self, station: str | None = None, session: str | None = None) -> tuple[Copy, ...]:
        """Return the extent of every session, oldest first."""
        if station is not None and session is not None:
            kept = [(station, session)] if (station, session) in self._records else []
        else:
            kept = [key for key in self._records if station in {None, key[0]}]
        return tuple(self._copy(key, self._records[key]) for key in kept)

    def epoch_of(self, station: str) -> int:
        """Return the last epoch of a station; -1 without one."""
        return self._epochs.get(station, -1)

    def store_epoch(self, station: str, epoch: int) -> None:
        """Store the epoch of a station."""
        self._epochs[station] = epoch

    def store_takeover(self, station: str, epoch: int) -> None:
        """Store the epoch of a completed takeover."""
        self._takeovers[station] = epoch

    def store_outcome(self, station: str, outcome: Outcome) -> None:
        """Store the outcome of a session."""
        self._outcomes[station, outcome.opening.session] = outcome

    def outcome(self, station: str, session: str) -> Outcome | None:
        """Return the outcome of a session; None without one."""
        return self._outcomes.get((station, session))

    def outcomes(self, station: str | None = None, session: str | None = None) -> Iterator[StoredOutcome]:
        """Yield the sessions with an outcome, the newest first."""
        for key, size in reversed(list(self._sizes.items())):
            if key in self._outcomes and is_named(key, station, session):
                yield StoredOutcome(key, size)

    def check_readable(self) -> None:
        """Return at once: memory is readable."""

    def mark_unreadable(self, station: str, session: str, why: str) -> None:
        """Return at once: a journal in memory reports no session as damaged."""

    def quarantine(self, station: str, session: str, why: str) -> str:
        """Delete a damaged session: a journal in memory keeps none."""
        self.delete(station, session)
        return session

    def retract(self, station: str, session: str, refused: Refused, why: str) -> None:
        """Delete what was refused: memory keeps none."""
        key = (station, session)
        places: dict[bool | None, list[int]] = {}  # of edits, of neutral changes, and of the close (None)
        for place, record in enumerate(self._records[key]):
            if isinstance(record.message, (*CHANGES, Close)):
                kind = None if isinstance(record.message, Close) else isinstance(record.message, AppliedEdit)
                places.setdefault(kind, []).append(place)
        counts = {True: refused.edits, False: refused.described, None: 0 if refused.close else 1}
        gone = {place for kind, found in places.items() for place in found[counts[kind] :]}
        self._records[key] = [one for place, one in enumerate(self._records[key]) if place not in gone]
        self._sizes[key] = sum(map(_size, self._records[key]))
        self._outcomes.pop(key, None)

    def release(self, station: str, session: str) -> None:
        """Delete a released session: a journal in memory keeps only sessions in use."""
        self.delete(station, session)

    def enforce_retention(self, now: float) -> Mapping[Key, str]:
        """Delete nothing: room is made at every append."""
        return {}

    def report(self) -> JournalReport:
        """Return the size of all records."""
        sizes = sum(list(self._sizes.values()))
        return JournalReport(kind="memory", commit_s=0.0, size=sizes, size_limit=self.capacity_bytes)

    def delete(self, station: str, session: str) -> None:
        """Delete the records of a session."""
        self._records.pop((station, session), None)
        self._sizes.pop((station, session), None)
        self._outcomes.pop((station, session), None)

    def _copy(self, key: Key, records: list[Record]) -> Copy:
        numbers = [record.message.seq for record in records if isinstance(record.message, SampleBatch)]
        return Copy(
            *key,
            opened=records[0].at,
            touched=records[-1].at,
            closed=_is_closed(records),
            last_seq=max(numbers, default=-1),
            size=self._sizes[key],
            edits=sum(isinstance(record.message, AppliedEdit) for record in records),
            described=sum(isinstance(record.message, Describe | EditProgram) for record in records),
            owner_epoch=self._takeovers.get(key[0], -1),
        )


def _is_closed(records: list[Record]) -> bool:
    """Return whether there is a close among the records, searched from the end."""
    return any(isinstance(record.message, Close) for record in reversed(records))


def _size(record: Record) -> int:
    message = record.message
    content = message.samples if isinstance(message, SampleBatch) else encode(message).payload
    return len(content) + _OVERHEAD_BYTES

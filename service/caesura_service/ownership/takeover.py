"""Takes over a session: from its outcome, from own records, and from further records of another instance.

The records of another instance are processed like messages of a bridge: they are validated and recorded in
the own journal; duplicates are skipped. So either instance may have more records, and damaged batches are
requested from the bridge. Records that cannot be read or written now are retried, and the station is not
served until then.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from functools import partial

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Error, Open, SampleBatch
from caesura_service.journal import (
    Copy,
    Journal,
    JournalDamagedError,
    JournalError,
    JournalMalformedError,
    JournalShareError,
    Key,
    Outcome,
    Record,
)
from caesura_service.ownership.session_copies import JournalSet, SessionCopies
from caesura_service.publishing.events import Output, Owner, PipelineFactory, TakeoverFailed
from caesura_service.segmentation.pipeline_interface import Pipeline
from caesura_service.sessions.batch_validation import validate_columns
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.restored_outcome import ClosedPipeline, state_from_snapshot
from caesura_service.sessions.session import Session

Steps = Generator[list[Output], None, Session | None]  # gives way after every record, with outputs


class NotRecordedError(JournalError):
    """A record of another instance's session cannot be read, or recorded by this instance, now."""


class SessionFactory:
    """Makes sessions that record into one journal."""

    def __init__(
        self,
        pipeline_factory: PipelineFactory,
        default_preset: str,
        journal: Journal,
        limits: Limits,
        check_current: Callable[[str], None],
    ) -> None:
        """check_current: raises JournalError if another instance owns a station now."""
        self._pipeline_factory = pipeline_factory
        self._default_preset = default_preset
        self._journal = journal
        self._limits = limits
        self._check_current = check_current

    def new(self, station: str, opening: Open, owner: Owner, opened: float) -> Session:
        """Return a new session without batches. Raises ProtocolError `malformed` or `conflict`.

        opened: time of day of its opening [s].
        """
        validate_columns(opening)
        try:
            pipeline = self._pipeline_factory(opening, self._default_preset)
        except ProtocolError:
            raise
        except Exception as error:
            why = f"the session could not be opened: {type(error).__name__}: {error}"
            raise ProtocolError("conflict", why) from error
        return self._session(station, opening, pipeline, owner, opened)

    def from_outcome(self, station: str, outcome: Outcome, owner: Owner, opened: float) -> Session:
        """Return the closed session of an outcome. opened: time of day of its opening [s]."""
        session = self._session(station, outcome.opening, ClosedPipeline(outcome.snapshot), owner, opened)
        session.load_outcome(outcome, state_from_snapshot(outcome.snapshot, owner)._replace(opened=opened))
        return session

    def _session(
        self, station: str, opening: Open, pipeline: Pipeline, owner: Owner, opened: float
    ) -> Session:
        return Session(
            station,
            opening,
            pipeline,
            owner=owner,
            journal=self._journal,
            limits=self._limits,
            opened=opened,
            check_current=partial(self._check_current, station),
        )


def why_not(error: Exception) -> str:
    """Return why a session cannot be rebuilt, without the list of what would be accepted."""
    if not isinstance(error, ProtocolError):
        return f"{type(error).__name__}: {error}"
    return error.message if error.value is None else f"{error.message}; value {error.value!r}"


class Takeover:
    """Brings sessions of one journal and its peers up to the furthest copy (`Copy.progress`)."""

    def __init__(self, factory: SessionFactory, journals: JournalSet, own: Journal) -> None:
        self._factory = factory
        self._journals = journals
        self._own = own
        self._peer_only: set[Key] = set()  # closed sessions that only a peer has

    def take_over_session(self, copies: SessionCopies, held: Session | None, owner: Owner) -> Steps:
        """Return the session up to its furthest copy; None if unreadable. held: the one in memory."""
        ended_elsewhere = copies.best.closed and (held is None or held.is_open)
        behind = ended_elsewhere or (held is not None and is_behind(held, copies))
        if copies.best.closed and behind:
            ended = self._from_outcome(copies, owner)
            if ended is not None:
                return ended
        if held is not None and not (behind and not held.has_pipeline):
            return (yield from self._apply_peers(held, copies)) if behind else held
        return (yield from self.rebuild(copies, owner))

    def rebuild(self, copies: SessionCopies, owner: Owner) -> Steps:
        """Return the session replayed from all its records; None if they are incomplete.

        Raises NotRecordedError.
        """
        session = yield from self._replay_or_open(copies, owner)
        if session is not None and is_behind(session, copies):
            return (yield from self._apply_peers(session, copies))
        return session

    def vanished_sessions(self) -> list[Key]:
        """Return the closed sessions that only a peer had and has deleted; each once.

        Empty while a journal cannot be read, because its sessions may still exist.
        """
        known = {station: self._journals.names(station) for station in {key[0] for key in self._peer_only}}
        if not self._journals.is_complete:
            return []
        gone = [key for key in self._peer_only if key[1] not in known[key[0]]]
        self._peer_only.difference_update(gone)
        return gone

    def _from_outcome(self, copies: SessionCopies, owner: Owner) -> Session | None:
        """Restore a closed session from the outcome of its best copy; None without a current outcome.

        An own copy that is not the best one is deleted.
        """
        station, name = copies.best.key
        outcome = self._journals.outcome(copies)
        if outcome is None or not is_current(outcome, copies):
            return None
        if copies.best is not copies.own:
            self._peer_only.add((station, name))
            with suppress(JournalError):
                self._own.delete(station, name)
        return self._factory.from_outcome(station, outcome, owner, copies.opened)

    def _replay_or_open(self, copies: SessionCopies, owner: Owner) -> Steps:
        key = copies.best.key
        try:
            if copies.own is not None:
                try:
                    return (yield from self._replay_readable(copies.own, owner))
                except JournalDamagedError as damage:
                    yield [TakeoverFailed(*key, damage)]
                    if self._journals.own_outcome(copies.own) is not None:
                        return None  # its outcome still answers queries
                    self._own.quarantine(*key, str(damage))
                    if copies.peer is None:
                        return None
            return self._open_from_peer(copies, owner)
        except NotRecordedError:
            raise
        except Exception as error:
            yield [TakeoverFailed(*key, error)]
            if not isinstance(error, JournalError):  # a disk that refuses may do so for a moment
                self._list_unreadable(copies, error)
            return None

    def _list_unreadable(self, copies: SessionCopies, error: Exception) -> None:
        """List a session that cannot be rebuilt as damaged, unless its outcome answers queries."""
        with suppress(JournalError):
            if copies.own is not None and self._journals.own_outcome(copies.own) is None:
                self._own.mark_unreadable(*copies.own.key, f"it cannot be rebuilt: {why_not(error)}")

    def _replay_readable(self, copy: Copy, owner: Owner) -> Generator[list[Output], None, Session]:
        """Replay a session; repeat it once if it may have been temporarily unreadable.

        Raises JournalError.
        """
        try:
            return (yield from self._replay_own(copy, owner))
        except JournalMalformedError:
            self._own.check_readable()
        return (yield from self._replay_own(copy, owner))

    def _replay_own(self, copy: Copy, owner: Owner) -> Generator[list[Output], None, Session]:
        records = self._journals.own_records(copy)
        first = next(records)
        session = self._factory.new(copy.station, _require_open(first.message), owner, first.at)
        for _ in session.replay_records(records, self._journals.own_edits(copy)):
            yield []
        return session

    def _open_from_peer(self, copies: SessionCopies, owner: Owner) -> Session:
        """Open the session from a peer's record of its opening, and record that in the own journal."""
        assert copies.peer is not None
        with _recording(copies):
            first = next(self._journals.peer_records(copies.peer, 0), None)
        if first is None:
            raise JournalError(f"{copies.peer.path} cannot be read")
        session = self._factory.new(copies.best.station, _require_open(first.message), owner, first.at)
        with _recording(copies):
            session.begin(first.at)
        return session

    def _apply_peers(self, session: Session, copies: SessionCopies) -> Steps:
        """Bring a session up to the peers' copies.

        Return None if the station's share of the journal is too small for that. An incomplete session would
        lack acknowledged records, and a new correction would get the number of a missing one. Raises
        NotRecordedError.
        """
        try:
            with _recording(copies):
                if copies.peer is not None:
                    records = self._journals.peer_records(copies.peer, session.next_seq)
                    edits = self._journals.peer_edits(copies.peer)
                    for _ in session.apply_peer_records(records, edits):
                        yield []
                if copies.batches is not None:
                    records = self._journals.peer_records(copies.batches, session.next_seq)
                    for _ in session.apply_peer_records(filter(_is_of_bridge, records)):
                        yield []
        except NotRecordedError:
            raise
        except Exception as error:
            yield [TakeoverFailed(*copies.best.key, error)]
            return None if isinstance(error, JournalShareError) else session
        return session


def is_behind(session: Session, copies: SessionCopies) -> bool:
    """Return whether a peer's copy has records that the session in memory lacks."""
    others = copies.batches
    if others is not None and session.is_open and others.copy.last_seq >= session.next_seq:
        return True
    if copies.peer is None:
        return False
    peer = copies.peer.copy
    further = peer.closed or peer.last_seq >= session.next_seq
    described = peer.described > session.state.neutral_changes
    return (session.is_open and further) or peer.edits > session.revision or described


def is_current(outcome: Outcome, copies: Copy | SessionCopies) -> bool:
    """Return whether an outcome contains all corrections, descriptions and program edits of the copies.

    After a power failure a later one may be recorded and not yet be in the outcome.
    """
    status, program = outcome.snapshot.status, outcome.snapshot.program
    return (status.revision, status.described + program.edit_revision) == (copies.edits, copies.described)


def _is_of_bridge(record: Record) -> bool:
    """Whether a record is of a bridge's batches and openings: of a copy of which the changes do not count."""
    return isinstance(record.message, Open | SampleBatch | Error)


@contextmanager
def _recording(copies: SessionCopies) -> Iterator[None]:
    """Raise a JournalError of the context as NotRecordedError, except JournalShareError."""
    try:
        yield
    except JournalShareError:
        raise
    except JournalError as error:
        name = "/".join(copies.best.key)
        raise NotRecordedError(f"{name} of another instance cannot be copied: {error}") from error


def _require_open(message: object) -> Open:
    if not isinstance(message, Open):
        raise TypeError(f"the journal begins with {type(message).__name__}, expected Open")
    return message

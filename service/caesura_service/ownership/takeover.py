"""A session taken over: from its outcome, from own records, and from those of another instance beyond them.

The records of another instance are processed like messages of a bridge: they pass the same checks and are
recorded here; duplicates are skipped. So the progress of either instance does not matter, and batches that
cannot be read are requested from the bridge.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Open
from caesura_service.journal import Copy, Journal, JournalDamagedError, JournalError, Key, Outcome
from caesura_service.ownership.session_copies import JournalSet, SessionCopies
from caesura_service.publishing.events import Output, Owner, PipelineFactory, TakeoverFailed
from caesura_service.segmentation.view import Pipeline
from caesura_service.sessions.batch_validation import check_columns
from caesura_service.sessions.closed_pipeline import ClosedPipeline, standing_of
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session

Steps = Generator[list[Output], None, Session | None]  # gives way after every record; what there is to say


class SessionFactory:
    """Sessions on one journal."""

    def __init__(
        self, pipeline_factory: PipelineFactory, default_preset: str, journal: Journal, limits: Limits
    ) -> None:
        self._pipeline_factory = pipeline_factory
        self._default_preset = default_preset
        self._journal = journal
        self._limits = limits

    def new(self, station: str, opening: Open, owner: Owner) -> Session:
        """One that has taken nothing. Raises ProtocolError `malformed` or `conflict`."""
        check_columns(opening)
        try:
            pipeline = self._pipeline_factory(opening, self._default_preset)
        except ProtocolError:
            raise
        except Exception as error:
            why = f"the session could not be opened: {type(error).__name__}: {error}"
            raise ProtocolError("conflict", why) from error
        return self._session(station, opening, pipeline, owner)

    def concluded(self, station: str, outcome: Outcome, owner: Owner) -> Session:
        """One that has ended."""
        session = self._session(station, outcome.opening, ClosedPipeline(outcome.snapshot), owner)
        session.take_up(outcome, standing_of(outcome.snapshot, owner))
        return session

    def _session(self, station: str, opening: Open, pipeline: Pipeline, owner: Owner) -> Session:
        return Session(station, opening, pipeline, owner=owner, journal=self._journal, limits=self._limits)


class Takeover:
    """Brings sessions of one journal and its siblings up to where the furthest copy is."""

    def __init__(self, builder: SessionFactory, journals: JournalSet, own: Journal) -> None:
        self._builder = builder
        self._journals = journals
        self._own = own
        self._borrowed: set[Key] = set()  # ended sessions that only a sibling has

    def session(self, copies: SessionCopies, held: Session | None, owner: Owner) -> Steps:
        """The session, None where it cannot be had. held: what is in memory of it."""
        ended_elsewhere = copies.best.closed and (held is None or held.is_open)
        behind = ended_elsewhere or (held is not None and is_behind(held, copies))
        if copies.best.closed and behind:
            ended = self._ended(copies, owner)
            if ended is not None:
                return ended
        if held is not None and not (behind and not held.is_folded):
            if behind:
                yield from self._followed(held, copies)
            return held
        return (yield from self.rebuilt(copies, owner))

    def rebuilt(self, copies: SessionCopies, owner: Owner) -> Steps:
        """Return the session, folded from all its records; None where they do not suffice."""
        session = yield from self._rebuilt(copies, owner)
        if session is not None and is_behind(session, copies):
            yield from self._followed(session, copies)
        return session

    def returned(self) -> list[Key]:
        """Ended sessions that only a sibling had, and has no more; each is returned once."""
        known = {station: self._journals.of(station) for station in {key[0] for key in self._borrowed}}
        gone = [key for key in self._borrowed if key[1] not in known[key[0]]]
        self._borrowed.difference_update(gone)
        return gone

    def _ended(self, copies: SessionCopies, owner: Owner) -> Session | None:
        """Restore a closed session from its outcome in the best copy; a local copy without it is unused."""
        station, name = copies.best.key
        outcome = self._journals.outcome(copies)
        if outcome is None or outcome.snapshot.status.revision != copies.best.edits:
            return None  # or it was corrected after that, and the power went before it was kept anew
        if copies.best is not copies.own:
            self._borrowed.add((station, name))
            with suppress(JournalError):
                self._own.forget(station, name)
        return self._builder.concluded(station, outcome, owner)

    def _rebuilt(self, copies: SessionCopies, owner: Owner) -> Steps:
        key = copies.best.key
        try:
            if copies.own is not None:
                try:
                    return (yield from self._restored(copies.own, owner))
                except JournalDamagedError as damage:
                    yield [TakeoverFailed(*key, damage)]
                    if self._own.outcome(*key) is not None:
                        return None  # it can be asked for still
                    self._own.set_aside(*key, str(damage))
                    if copies.furthest is None:
                        return None
            return self._begun(copies, owner)
        except Exception as error:
            yield [TakeoverFailed(*key, error)]
            return None

    def _restored(self, copy: Copy, owner: Owner) -> Generator[list[Output], None, Session]:
        records = self._journals.own_records(copy)
        session = self._builder.new(copy.station, _opening(next(records).message), owner)
        for _ in session.restoring(records, self._journals.own_edits(copy)):
            yield []
        return session

    def _begun(self, copies: SessionCopies, owner: Owner) -> Session:
        """As another instance has opened it, and recorded here."""
        assert copies.furthest is not None
        first = next(self._journals.siblings_records(copies.furthest, 0), None)
        if first is None:
            raise JournalError(f"{copies.furthest.path} cannot be read")
        session = self._builder.new(copies.best.station, _opening(first.message), owner)
        session.begin(first.at)
        return session

    def _followed(self, session: Session, copies: SessionCopies) -> Generator[list[Output], None, None]:
        assert copies.furthest is not None
        records = self._journals.siblings_records(copies.furthest, session.next_seq)
        try:
            for _ in session.following(records, self._journals.siblings_edits(copies.furthest)):
                yield []
        except Exception as error:
            yield [TakeoverFailed(*copies.best.key, error)]


def is_behind(session: Session, copies: SessionCopies) -> bool:
    """Has another instance gone further than what is in memory here?"""
    if copies.furthest is None:
        return False
    theirs = copies.furthest.copy
    further = theirs.closed or theirs.last_seq >= session.next_seq
    return (session.is_open and further) or theirs.edits > session.revision


def _opening(message: object) -> Open:
    if not isinstance(message, Open):
        raise TypeError(f"the journal begins with {type(message).__name__}, expected Open")
    return message

"""All sessions of this instance, by station and name. Routes messages, charges refusals, keeps limits.

A refusal is charged to the session that it names, else to the station's current session where the
station is known, and always to the service. A station reaches only its own sessions. What the journal
cannot take is refused as `overloaded` with the journal's reason: the bridge still has it, and is asked
again. A closed session stays in the journal longer than it can be asked for here, and its name stays taken
for so long.

Stations may be shared with other instances: what is not served here is another's, and a bridge whose station
is just being taken has to ask again.

Other threads read the `board`, which is replaced when a session comes or goes and holds its immutable
standing.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Set
from contextlib import suppress
from types import TracebackType

from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.messages import Close, Command, Edit, Heartbeat, JournalReport, Open, SampleBatch
from caesura_service.journal import Journal, JournalError, Key, PeerJournals
from caesura_service.ownership.session_copies import JournalSet, SessionCopies
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.ownership.session_rebuilder import SessionRebuilder
from caesura_service.ownership.station_ownership import StationOwnership
from caesura_service.ownership.takeover import SessionFactory, Takeover, is_behind
from caesura_service.publishing.events import (
    BatchRejected,
    Output,
    Owner,
    PipelineFactory,
    Publish,
    ReplayEnded,
    Reply,
    SessionDeleted,
    StationTakenOver,
    TakeoverFailed,
)
from caesura_service.publishing.session_state import SessionCounters, status_of
from caesura_service.segmentation.time_slices import Slices
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.session import Session

REVIVING = "/reviving"  # what `step` does, among the slices; the name of no station


class Registry:
    """One thread calls the methods; any thread may read `board` and `tally`."""

    def __init__(
        self,
        *,
        owner: Owner,
        pipeline_factory: PipelineFactory,
        default_preset: str,
        journal: Journal,
        limits: Limits,
        siblings: PeerJournals | None = None,
    ) -> None:
        self._default_preset = default_preset
        self._journal = journal
        self._limits = limits
        self._journals = JournalSet(journal, siblings or PeerJournals(None))
        self.custody = StationOwnership(owner, journal, self._journals)
        self._builder = SessionFactory(pipeline_factory, default_preset, journal, limits)
        self._takeover = Takeover(self._builder, self._journals, journal)
        self._reviving = SessionRebuilder(self._takeover, self._journals)
        self.slices = Slices()  # of the work on what stations send, by station; REVIVING by that
        self._stations: dict[str, dict[str, Session]] = {}
        self._hushed: set[Session] = set()  # which keep a refusal back for a little while
        self._tidy_at = self._look_at = float("-inf")  # [s]
        self.board = SessionIndex({})
        self.tally = SessionCounters()

    # --- whose stations are whose -----------------------------------------------------------------------

    def restore(self, now: float = 0.0, stations: Set[str] | None = None) -> list[TakeoverFailed]:
        """Take these stations, or every one that is known; returns the sessions that were left out."""
        wanted = self.known() if stations is None else stations
        taken = (outputs for station in sorted(wanted) for outputs in self.take(station, now))
        return [output for outputs in taken for output in outputs if isinstance(output, TakeoverFailed)]

    def known(self) -> Set[str]:
        """Stations with a session, in memory or in a journal. Raises JournalError."""
        return self._journals.stations() | self._stations.keys()

    def held(self) -> Set[str]:
        """Stations with a session in memory."""
        return frozenset(self._stations)

    def take(self, station: str, now: float, *, renew: bool = True) -> Generator[list[Output], None, None]:
        """Bring the station's sessions to where the furthest journal is; gives way after every record.

        From then on we speak under a new epoch, higher than any before. renew: also where nothing was behind,
        as after another instance may have had the station.
        """
        try:
            self._finish_work(station)
            known, held = self._journals.of(station), self._stations.get(station, {})
            wanted = self._to_hold(known)
            if renew or any(_lacks(held.get(name), known[name]) for name in wanted):
                yield from self._take(station, now, {name: known[name] for name in wanted})
        finally:
            self.custody.unbar(station)

    def _take(
        self, station: str, now: float, wanted: Mapping[str, SessionCopies]
    ) -> Generator[list[Output], None, None]:
        self.custody.bar(station)
        self._reviving.leave(station)
        held, owner = self._stations.get(station, {}), self.custody.acquire(station, now)
        taken = {name: session for name, session in held.items() if name not in wanted}
        for name, copies in wanted.items():
            session = yield from self._takeover.session(copies, held.get(name), owner)
            if session is not None:
                taken[name] = session
        self._hushed.difference_update(held.values())
        if taken:
            self._stations[station] = taken
            self._show()
        outputs: list[Output] = []
        for name, session in taken.items():
            session.hand_to(owner)
            if session.is_open or name in held:  # its readers learn the new owner
                outputs.append(Publish(status_of(session.standing)))
        opened = sum(session.is_open for session in taken.values())
        yield [StationTakenOver(station, owner.epoch, len(taken), opened), *outputs]

    def leave(self, station: str) -> None:
        """The station is another's: let go of its sessions, which stay in the journal."""
        self._finish_work(station)
        self.custody.leave(station)
        self._reviving.leave(station)
        with suppress(JournalError):  # which the journal has said already
            self._journal.flush()
        if (left := self._stations.pop(station, None)) is not None:
            self._hushed.difference_update(left.values())
            self._show()

    def _finish_work(self, station: str) -> None:
        """What was begun is done before the station changes hands: no instance can go on in the middle."""
        for name in (station, REVIVING):
            self.slices.finish(name)

    def _to_hold(self, known: Mapping[str, SessionCopies]) -> list[str]:
        """Which of a station's sessions are held here: those that are open, and the last closed ones."""
        closed = [name for name, copies in known.items() if copies.best.closed]
        gone = set(closed[: max(0, len(closed) - self._limits.closed_sessions)])
        return [name for name in known if name not in gone]

    # --- what comes -------------------------------------------------------------------------------------

    def command(self, station: str, command: Command, now: float) -> list[Output]:
        """Carry out a command; the outputs hold exactly one answer."""
        if (elsewhere := self.custody.elsewhere(station)) is not None:
            return [Reply(ProtocolError("overloaded", elsewhere, value=station))]
        try:
            if isinstance(command, Open) and self._find(station, command.session) is None:
                return self._open(station, command, now)
            session = self._session(station, command.session)
            with _RECORDING:
                if isinstance(command, Edit) and not session.is_folded:
                    session.check_revision(command)
                    owner = self.custody.owner(station, now)
                    return [Reply(self._reviving.ask(station, session, owner))]
                return self._minded(session, session.receive(command, now))
        except ProtocolError as error:
            if isinstance(command, Edit):  # which is the editor's affair, not that of the session's bridge
                self.tally = self.tally.with_refusal(error)
                return [Reply(error)]
            return [*self._charge(station, command.session, error), Reply(error)]

    def samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Take what a bridge sent, or the end of an answer to a replay."""
        if self.custody.elsewhere(station) is not None:
            return []  # the bridge still has it
        try:
            session = self._session(station, message.session)
            with _RECORDING:
                outputs = self._minded(session, session.receive(message, now))
        except ProtocolError as error:
            return self._charge(station, message.session, error)
        for output in outputs:
            if isinstance(output, BatchRejected):
                self.tally = self.tally.with_refusal(output.error)
        if session.looked.view.observations >= self._limits.observations and session.is_open:
            outputs = [*outputs, *self._end(station, session, now)]
        return outputs

    def refuse(self, station: str | None, error: ProtocolError) -> list[Output]:
        """A message that could not be read, from a station where the key names one."""
        return self._charge(station, None, error)

    def dropped(self, station: str, messages: int) -> list[Output]:
        """There was no room for so many messages of a station: its current session counts and shows them."""
        sessions = tuple(self._stations.get(station, {}).values())
        return self._minded(sessions[-1], sessions[-1].drop(messages)) if sessions else []

    def restate(self, station: str | None) -> list[Output]:
        """The open sessions of a station, or of all, say how they are: something beside them has changed."""
        concerned = [
            session
            for name, sessions in self._stations.items()
            if station in {None, name}
            for session in sessions.values()
            if session.is_open
        ]
        return [outputs for session in concerned for outputs in self._minded(session, session.drop(0))]

    def tick(self, now: float) -> list[Output]:
        """Time has passed: every open session may ask again for what is missing, and the journal tidy up."""
        outputs = [outputs for session in self._awake() if session.is_open for outputs in session.tick(now)]
        outputs += [outputs for session in self._hushed for outputs in session.unhush(now)]
        self._hushed = {session for session in self._hushed if session.is_hushed}
        if now >= self._tidy_at:
            self._tidy_at = now + self._limits.tidy_interval_s
            outputs += self._tidy(now)
        return outputs

    def spent(self, station: str, seconds: float) -> None:
        """So long did a slice of the work on what a station sent take. For those who count."""

    @property
    def is_busy(self) -> bool:
        """Is there something to do, for which `step` is to be called?"""
        return self._reviving.is_busy

    def step(self) -> list[Output]:
        """Do the next little thing, and say what comes of it."""
        return self._reviving.step()

    def journal_report(self) -> JournalReport:
        """How the journal is doing; may be asked from any thread."""
        return self._journal.report()

    def _open(self, station: str, command: Open, now: float) -> list[Output]:
        if station not in self._stations and len(self._stations) >= self._limits.stations:
            raise ProtocolError("overloaded", "too many stations", value=station, limit=self._limits.stations)
        opening = command.model_copy(update={"preset": command.preset or self._default_preset})
        with _RECORDING:
            owner = self.custody.owner(station, now)
        session = self._builder.new(station, opening, owner)
        with _RECORDING:
            known = self._journals.of(station, command.session).get(command.session)
        with _BEGINNING:
            if known is not None:
                return self._open_once_more(station, command, known, now)
            outputs = session.begin(now)
        self._stations.setdefault(station, {})[command.session] = session
        outputs = [*self._make_room(station, now), *outputs]
        self._show()
        return outputs

    def _open_once_more(self, station: str, command: Open, known: SessionCopies, now: float) -> list[Output]:
        """One that a journal has, and that is not held: if it is open, it was not to be had so far.

        Raises ProtocolError `overloaded` where that may change, else `conflict`.
        """
        name, why = command.session, "which is over"
        if not known.best.closed:
            outputs = [output for each in self.take(station, now) for output in each]
            if self._find(station, name) is not None:
                return [*outputs, *self.command(station, command, now)]
            failed = [out.error for out in outputs if isinstance(out, TakeoverFailed) and out.session == name]
            if failed and isinstance(failed[0], JournalError):
                raise ProtocolError("overloaded", str(failed[0]), value=name)
            why = "which cannot be read"
        raise ProtocolError(
            "conflict", f"the journal has such a session, {why}: give it another name", value=name
        )

    def _make_room(self, station: str, now: float) -> list[Output]:
        """Close the oldest open and let go of the oldest closed session of a station that has too many.

        What the journal cannot take of that waits until the next one is opened.
        """
        sessions = self._stations[station]
        outputs: list[Output] = []
        opened = [session for session in sessions.values() if session.is_open]
        for session in opened[: max(0, len(opened) - self._limits.open_sessions)]:
            with suppress(JournalError):
                outputs += _unanswered(self._closed(session, now))
        closed = [session for session in sessions.values() if not session.is_open]
        held = sum(session.looked.view.observations for session in sessions.values())
        for number, session in enumerate(closed):
            few = len(closed) - number <= self._limits.closed_sessions
            if few and held <= self._limits.observations_held:
                break
            held -= session.looked.view.observations
            del sessions[session.name]
            self._journal.release(station, session.name)
        return outputs

    def _end(self, station: str, session: Session, now: float) -> list[Output]:
        """Close a session that is as long as one may be: what it keeps grows with its observations."""
        count, most = session.looked.view.observations, self._limits.observations
        why = f"the session is as long as one may be and is closed: {most} observations; open another"
        with suppress(JournalError):  # tried again at the next batch
            outputs = _unanswered(self._closed(session, now))
            error = ProtocolError("too_large", why, value=count, limit=most)
            return [*outputs, *self._charge(station, session.name, error)]
        return []

    def _closed(self, session: Session, now: float) -> list[Output]:
        """Close it behind the last batch that it has. Raises JournalError."""
        return session.receive(Close(session=session.name, last_seq=session.next_seq - 1), now)

    def _tidy(self, now: float) -> list[Output]:
        """What no journal keeps any longer cannot be asked for either."""
        gone: dict[Key, str] = {}
        with suppress(JournalError):  # which the journal has said already
            gone |= self._journal.tidy(now)
        if now >= self._look_at:
            self._look_at = now + self._limits.look_interval_s
            gone |= dict.fromkeys(self._takeover.returned(), "deleted by another process")
        for station, name in gone:
            sessions = self._stations.get(station, {})
            sessions.pop(name, None)
            if not sessions:
                self._stations.pop(station, None)
        if gone:
            self._show()
        return [SessionDeleted(*key, why) for key, why in gone.items()]

    def _charge(self, station: str | None, name: str | None, error: ProtocolError) -> list[Output]:
        self.tally = self.tally.with_refusal(error)
        session = self._find(station, name) or self._current(station, error)
        return self._minded(session, session.refuse(error)) if session else []

    def _minded(self, session: Session, outputs: list[Output]) -> list[Output]:
        """What a session says; where it keeps something back, it is asked for that later."""
        if session.is_hushed:
            self._hushed.add(session)
        return outputs

    def _current(self, station: str | None, error: ProtocolError) -> Session | None:
        """The station's newest session, unless the refusal speaks of one that is unknown here."""
        sessions = self._stations.get(station or "")
        if not sessions or error.code == "unknown_session":
            return None
        return next(reversed(sessions.values()))

    def _find(self, station: str | None, name: str | None) -> Session | None:
        return self._stations.get(station or "", {}).get(name or "")

    def _session(self, station: str, name: str) -> Session:
        """The station's own session. Raises ProtocolError `forbidden` or `unknown_session`."""
        session = self._find(station, name)
        if session is not None:
            return session
        if any(name in sessions for sessions in self._stations.values()):
            raise ProtocolError("forbidden", "the session belongs to another station", value=name)
        raise ProtocolError(
            "unknown_session",
            "no such session at this station",
            value=name,
            expected=list(self._stations.get(station, {})),
        )

    def _awake(self) -> Iterable[Session]:
        stations = (sessions for name, sessions in self._stations.items() if not self.custody.is_barred(name))
        return (session for sessions in stations for session in sessions.values())

    def _show(self) -> None:
        shown = {name: tuple(sessions.values()) for name, sessions in self._stations.items() if sessions}
        self.board = SessionIndex(shown)


def _lacks(session: Session | None, copies: SessionCopies) -> bool:
    return session is None or is_behind(session, copies)


class _Recording:
    """Turns what the journal cannot take into a refusal. A session that never began need not try again."""

    def __init__(self, code: ErrorCode) -> None:
        self._code = code

    def __enter__(self) -> None:
        """A class, not a generator: every batch comes through here."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, JournalError):
            raise ProtocolError(self._code, str(error)) from error


_RECORDING, _BEGINNING = _Recording("overloaded"), _Recording("conflict")


def _unanswered(outputs: list[Output]) -> list[Output]:
    return [output for output in outputs if not isinstance(output, Reply)]

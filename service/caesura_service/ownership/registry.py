"""All sessions of this instance, by station and name. It routes messages, counts refusals, and enforces
limits.

A refusal is counted for the session that it names, or else for the station's current session if the station
is known, and always for the service. A station can access only its own sessions. A message that the journal
cannot store is rejected as `overloaded` with the journal's reason: the bridge still has it, and is asked to
send it again. A closed session stays in the journal longer than in memory, and its name stays in use for so
long.

Other instances may serve other stations: a message of a station that this instance does not serve is
rejected, and a bridge must repeat messages during a takeover.

Other threads read the `index`, which is replaced when a session is added or removed and holds its immutable
state (`held_sessions`).
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Set
from contextlib import suppress

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Close,
    Command,
    Describe,
    Edit,
    EditProgram,
    Heartbeat,
    JournalReport,
    Open,
    Preview,
    Program,
    ReplacePart,
    SampleBatch,
)
from caesura_service.cooperative_scheduler import Slices
from caesura_service.journal import (
    AppliedProgramEdit,
    Journal,
    JournalError,
    JournalSupersededError,
    Key,
    PeerJournals,
)
from caesura_service.ownership.closed_session_rebuilder import ClosedSessionRebuilder
from caesura_service.ownership.held_sessions import HeldSessions
from caesura_service.ownership.journal_error_mapping import AS_OVERLOADED
from caesura_service.ownership.session_copies import JournalSet, SessionCopies
from caesura_service.ownership.session_index import SessionIndex
from caesura_service.ownership.station_limit import StationLimit, last_opened
from caesura_service.ownership.station_ownership import StationOwnership
from caesura_service.ownership.stored_sessions import StoredSessions
from caesura_service.ownership.takeover import SessionFactory, Takeover, is_behind, why_not
from caesura_service.ownership.takeovers_in_turns import TakeoversInTurns
from caesura_service.ownership.tolerance_limits import check_tolerances
from caesura_service.program_edits.replacement_apps import apps_for
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
from caesura_service.publishing.session_state import SessionCounters, program_of, status_of
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.same_layout_batches import BatchBlock
from caesura_service.sessions.session import Awaited, Session

STEP_S = 1e-3  # between the openings of two sessions whose clocks disagree
REBUILDING = "/rebuilding/"  # with a station, what `rebuild_step` does for it; the name of no station


class Registry:
    """Holds the sessions of this instance, and passes each message to its session.

    One thread calls the methods; any thread may read `index` and `counters`, and call `stored`.
    """

    def __init__(
        self,
        *,
        owner: Owner,
        pipeline_factory: PipelineFactory,
        default_preset: str,
        journal: Journal,
        limits: Limits,
        peers: PeerJournals | None = None,
    ) -> None:
        self._default_preset = default_preset
        self._journal = journal
        self._limits = limits
        self._journals = JournalSet(journal, peers or PeerJournals(None))
        self.ownership = StationOwnership(owner, journal, self._journals)
        self._factory = SessionFactory(
            pipeline_factory, default_preset, journal, limits, self.ownership.check_current
        )
        self._takeover = Takeover(self._factory, self._journals, journal)
        self._rebuilder = ClosedSessionRebuilder(self._takeover, self._journals)
        self.slices = Slices()  # of the work on what stations send, by station; and of its rebuilds
        self._held = HeldSessions()
        self._station_limit = StationLimit(limits, self._is_busy)
        self._retention_due_s = self._peer_poll_due_s = float("-inf")  # [s]
        self.stored = StoredSessions(journal, lambda: self.index, self.ownership.serves)
        self.counters = SessionCounters()

    @property
    def index(self) -> SessionIndex:
        """The current index of sessions; any thread may read it."""
        return self._held.index

    # --- whose stations are whose -----------------------------------------------------------------------

    def restore(self, now: float = 0.0, stations: Set[str] | None = None) -> list[TakeoverFailed]:
        """Take over these stations, or all with a session; return the sessions that could not be taken over.

        The takeover of a station whose records cannot be read or copied must be repeated.
        """
        turns = TakeoversInTurns()
        for station in sorted(self.known_stations() if stations is None else stations):
            turns.begin(station, self.take_over(station, now))
        return turns.complete()

    def known_stations(self) -> Set[str]:
        """Stations with a session, in memory or in a journal. Raises JournalError."""
        return self._journals.stations() | self._held.by_station.keys()

    def held_stations(self) -> Set[str]:
        """Stations with a session in memory."""
        return frozenset(self._held.by_station)

    def take_over(
        self, station: str, now: float, *, renew: bool = True
    ) -> Generator[list[Output], None, None]:
        """Bring each of the station's sessions up to its furthest copy; yields after every record.

        From then on results have a new epoch, higher than any before. renew: take a new epoch also if no
        record was missing, because another instance may have owned the station; if one has, there always is a
        new epoch. Raises JournalError; the station's messages are then rejected until a takeover succeeds.
        """
        try:
            self._finish_work(station)
            renew = renew or self.ownership.is_behind(station) or self.ownership.is_superseded(station)
            if renew or self._lacks_records(station):
                yield from self._take_over(station, now)
        finally:
            self.ownership.end_takeover(station)

    def _lacks_records(self, station: str) -> bool:
        held = self._held.of(station)
        wanted = self._to_hold(self._journals.copies_of_station(station))
        return any(_is_missing_or_behind(held.get(name), copies) for name, copies in wanted.items())

    def _without_refused(self, station: str) -> Mapping[str, SessionCopies]:
        """Set refused records aside, and remove the sessions that contain them from memory.

        Return the copies of the station's sessions. Raises JournalError.
        """
        known = self._journals.copies_of_station(station)
        refused = {name: copies.refused for name, copies in known.items() if copies.refused is not None}
        for name, records in refused.items():
            why = f"{station}/{name} has records that conflict with those of the station's last owner"
            self._held.remove(station, name)
            self._journal.retract(station, name, records, why)
        return self._journals.copies_of_station(station) if refused else known

    def _take_over(self, station: str, now: float) -> Generator[list[Output], None, None]:
        self.ownership.begin_takeover(station)
        self._rebuilder.cancel(station)
        shown = self._held.of(station)
        try:
            self.ownership.begin_catching_up(station)
            owner = self.ownership.acquire(station, now)
            known = self._without_refused(station)  # from here on the last owner acknowledges nothing
            held, wanted = self._held.of(station), self._to_hold(known)
            taken = {name: session for name, session in held.items() if name not in wanted}
            for name, copies in wanted.items():
                session = yield from self._takeover.take_over_session(copies, held.get(name), owner)
                if session is not None:
                    taken[name] = session
        except JournalError as error:
            self.ownership.fall_behind(station, str(error))
            raise
        self.ownership.catch_up(station)
        if taken:
            self._held.replace(station, taken)
            self._station_limit.began(station, now)
        outputs: list[Output] = []
        for name, session in taken.items():
            session.set_owner(owner)
            if session.is_open or name in shown:  # its readers learn the new owner
                outputs.append(Publish(status_of(session.state)))
        opened = sum(session.is_open for session in taken.values())
        yield [StationTakenOver(station, owner.epoch, len(taken), opened), *outputs]

    def release(self, station: str) -> None:
        """Release a station to another instance; its sessions stay in the journal."""
        self._finish_work(station)
        self.ownership.release(station)
        self._rebuilder.cancel(station)
        with suppress(JournalError):  # which the journal has said already
            self._journal.flush()
        self._drop(station)

    def _drop(self, station: str) -> None:
        """Remove all sessions of a station from memory."""
        self._held.replace(station, {})
        self._station_limit.forget(station)

    def _finish_work(self, station: str) -> None:
        """Complete sliced work before the station changes its owner."""
        for name in (station, REBUILDING + station):
            self.slices.finish(name)

    def _to_hold(self, known: Mapping[str, SessionCopies]) -> Mapping[str, SessionCopies]:
        """Return the copies of the sessions to load into memory: the open ones and the last closed ones."""
        closed = [name for name, copies in known.items() if copies.best.closed]
        gone = set(closed[: max(0, len(closed) - self._limits.closed_sessions)])
        return {name: copies for name, copies in known.items() if name not in gone}

    # --- what comes -------------------------------------------------------------------------------------

    def handle_command(self, station: str, command: Command, now: float) -> list[Output]:
        """Execute a command; the outputs contain exactly one reply."""
        if (rejection := self.ownership.rejection_reason(station)) is not None:
            return [Reply(ProtocolError("overloaded", rejection, value=station))]
        try:
            return self._carry_out(station, command, now)
        except JournalSupersededError as error:
            return [Reply(ProtocolError("overloaded", str(error), value=station))]
        except ProtocolError as error:
            # A refusal of these concerns the editor and not the session's bridge.
            if isinstance(command, Edit | Preview | Describe | EditProgram):
                error = self._as_only_read(station, command.session, error)
                if not isinstance(command, Preview):  # its refusal is no event of the session
                    self._count_refused(station, error)
                return [Reply(error)]
            return [*self._count_rejection(station, command.session, error), Reply(error)]

    def _carry_out(self, station: str, command: Command, now: float) -> list[Output]:
        """Execute a command. Raises ProtocolError, JournalSupersededError."""
        if isinstance(command, Open) and self._held.find(station, command.session) is None:
            return self._open(station, command, now)
        session = self._held.require(station, command.session)
        with AS_OVERLOADED:
            if not session.has_pipeline and _needs_rebuilding(command, session):
                owner = self.ownership.owner(station, now)
                return [Reply(self._rebuilder.request(station, session, owner))]
            if isinstance(command, EditProgram) and session.repeated(command) is None:
                check_tolerances(command)
                command = self._with_apps(station, session, command)
            outputs = self._held.track(session, session.receive(command, now))
            if not isinstance(command, Preview):
                # An instance that has acquired the station meanwhile may have read the journals before.
                self.ownership.check_current(station)
            return outputs

    def handle_samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Process a bridge's message or the end of a replay. now: [s]."""
        if self.ownership.rejection_reason(station) is not None:
            return []  # the bridge still has it
        try:
            session = self._held.require(station, message.session)
            self._station_limit.received(station, now)
            with AS_OVERLOADED:
                outputs = self._held.track(session, session.receive(message, now))
        except JournalSupersededError:
            return []
        except ProtocolError as error:
            return self._count_rejection(station, message.session, error)
        return self._with_limits(station, session, outputs, now)

    def awaited(self, station: str, session: str) -> Awaited | None:
        """Return the next batch that an open session expects; None if it is not in memory.

        Any thread may call it.
        """
        for held in reversed(self.index.sessions.get(station, ())):
            if held.name == session:
                return held.awaited if held.is_open else None
        return None

    def handle_together(self, station: str, block: BatchBlock, now: float) -> tuple[int, list[Output]]:
        """Process the first batches of a block together, as `handle_samples` does in turn; return how many.

        0: the first one must be processed separately. A due program is postponed to `make_due_program`, so
        that segments are published before it.
        """
        session = self._held.find(station, block.session)
        if session is None or self.ownership.rejection_reason(station) is not None:
            return 0, []
        self._station_limit.received(station, now)
        try:
            with AS_OVERLOADED:
                count, outputs = session.receive_together(block, now)
        except ProtocolError as error:
            return 1, self._count_rejection(station, session.name, error)
        if not count:
            return 0, []
        return count, self._with_limits(station, session, self._held.track(session, outputs), now)

    def has_due_program(self, station: str, session: str) -> bool:
        """Whether `handle_together` has postponed a program of the session."""
        found = self._held.find(station, session)
        return found is not None and found.has_due_program

    def make_due_program(self, station: str, session: str) -> list[Output]:
        """Make and publish the program that `handle_together` has postponed."""
        found = self._held.find(station, session)
        return [] if found is None else self._held.track(found, found.make_due_program())

    def _with_limits(self, station: str, session: Session, outputs: list[Output], now: float) -> list[Output]:
        """Count the rejected batches among the outputs; close the session at its limit of observations."""
        for output in outputs:
            if isinstance(output, BatchRejected):
                self._count_refused(station, output.error)
        if session.last_published_state.view.observations >= self._limits.observations and session.is_open:
            outputs = [*outputs, *self._close_at_limit(station, session, now)]
        return outputs

    def reject(self, station: str | None, error: ProtocolError) -> list[Output]:
        """Count an unreadable message; station: None if its key names none."""
        return self._count_rejection(station, None, error)

    def report_dropped(self, station: str, messages: int) -> list[Output]:
        """Count messages that the queue dropped, in a status of the station's newest session."""
        newest = self._held.newest(station)
        return [] if newest is None else self._held.track(newest, newest.count_dropped(messages))

    def republish_status(self, station: str | None) -> list[Output]:
        """Publish a status of the open sessions of a station, or of all for None."""
        concerned = self._held.all() if station is None else self._held.of(station).values()
        return [
            output
            for session in concerned
            if session.is_open
            for output in self._held.track(session, session.count_dropped(0))
        ]

    def tick(self, now: float) -> list[Output]:
        """Request what is due, publish postponed statuses and enforce the journal's retention. now: [s]."""
        outputs = [
            output
            for session in self._available_sessions()
            if session.is_open
            for output in session.request_missing(now)
        ]
        outputs += self._held.flush_statuses(now)
        if now >= self._retention_due_s:
            self._retention_due_s = now + self._limits.retention_interval_s
            outputs += self._enforce_retention(now)
        return outputs

    def record_work(self, station: str, seconds: float) -> None:
        """Record the time [s] of a slice of a station's work.

        Here it does nothing, see `InstrumentedRegistry`.
        """

    @property
    def rebuilding(self) -> Set[str]:
        """The stations of which a session is being rebuilt; for each `rebuild_step` must be called."""
        return self._rebuilder.stations

    def rebuild_step(self, station: str) -> list[Output]:
        """Replay one more record of a station's rebuild; return the outputs."""
        return self._rebuilder.step(station)

    def journal_report(self) -> JournalReport:
        """Return the state of the journal; any thread may call it.

        A session in memory is not listed as damaged, as it can be read.
        """
        report, held = self._journal.report(), self.index.sessions
        damaged = tuple(
            one
            for one in report.damaged
            if one.set_aside or all(held_one.name != one.session for held_one in held.get(one.station, ()))
        )
        return report.model_copy(update={"damaged": damaged})

    def _open(self, station: str, command: Open, now: float) -> list[Output]:
        self._station_limit.check_has_room(self._held.by_station, station, now)
        opening = command.model_copy(update={"preset": command.preset or self._default_preset})
        with AS_OVERLOADED:
            owner = self.ownership.owner(station, now)
            known = self._journals.copies_of_station(station, command.session).get(command.session)
            opened = self._opening_time(station, now)
            session = self._factory.new(station, opening, owner, opened)
            if known is not None:
                return self._reopen(station, command, known, now)
            check_tolerances(command)
            outputs = session.begin(opened)
        self._held.add(station, session)
        outputs = [*self._make_room(station, now), *outputs]
        self._station_limit.received(station, now)
        return [*self._release_stations(now), *outputs]

    def _opening_time(self, station: str, now: float) -> float:
        """Return the time of an opening [s]; `now` if no other instance has opened a session of the station.

        Otherwise it is later than that of all sessions of the station, also of other instances. Sessions are
        ordered by it, and the last one is the station's current session, also if clocks differ.
        """
        others = self._journals.peer_last_opened(station)
        if others is None:
            return now
        own = last_opened(self._held.of(station))
        return max(now, max(others, own) + STEP_S)

    def _is_busy(self, station: str) -> bool:
        """Whether work on a station is in progress."""
        return (
            self.slices.is_under_way(station)
            or self.ownership.in_takeover(station)
            or station in self.rebuilding
        )

    def _release_stations(self, now: float) -> list[Output]:
        """Close and release the sessions of stations beyond the limit, which stay in the journal."""
        outputs: list[Output] = []
        for station in self._station_limit.beyond(self._held.by_station, now):
            sessions = self._held.of(station)
            try:
                for session in sessions.values():
                    if session.is_open:
                        outputs += _without_replies(self._close(session, now))
            except JournalError:  # it stays beyond the limit until another station is opened
                continue
            self._drop(station)
            self.ownership.release(station)
            for name in sessions:
                self._journal.release(station, name)
        return outputs

    def _reopen(self, station: str, command: Open, known: SessionCopies, now: float) -> list[Output]:
        """Open a session that is in a journal and not in memory; an open one is taken over again.

        Raises ProtocolError `overloaded` if a retry may succeed, else `conflict`.
        """
        name, why = command.session, "is closed"
        if not known.best.closed:
            with AS_OVERLOADED:
                outputs = [output for each in self.take_over(station, now) for output in each]
            if self._held.find(station, name) is not None:
                return [*outputs, *self.handle_command(station, command, now)]
            failed = [out.error for out in outputs if isinstance(out, TakeoverFailed) and out.session == name]
            if failed and isinstance(failed[0], JournalError):
                raise ProtocolError("overloaded", str(failed[0]), value=name)
            why = f"cannot be rebuilt ({why_not(failed[0])})" if failed else "cannot be read"
        raise ProtocolError(
            "conflict",
            f"the journal has a session of this name, which {why}: choose another name",
            value=name,
        )

    def _make_room(self, station: str, now: float) -> list[Output]:
        """Close the oldest open and release the oldest closed session of a station that has too many.

        A close that the journal cannot store is repeated when the next session is opened.
        """
        sessions = self._held.of(station)
        outputs: list[Output] = []
        opened = [session for session in sessions.values() if session.is_open]
        for session in opened[: max(0, len(opened) - self._limits.open_sessions)]:
            with suppress(JournalError):
                outputs += _without_replies(self._close(session, now))
        closed = [session for session in sessions.values() if not session.is_open]
        held = sum(session.last_published_state.view.observations for session in sessions.values())
        for number, session in enumerate(closed):
            few = len(closed) - number <= self._limits.closed_sessions
            if few and held <= self._limits.observations_held:
                break
            held -= session.last_published_state.view.observations
            self._held.remove(station, session.name)
            self._journal.release(station, session.name)
        return outputs

    def _close_at_limit(self, station: str, session: Session, now: float) -> list[Output]:
        """Close a session at its limit of observations, which bounds its memory."""
        count, most = session.last_published_state.view.observations, self._limits.observations
        why = f"the session has reached its limit of {most} observations and is closed: open another"
        with suppress(JournalError):  # tried again at the next batch
            outputs = _without_replies(self._close(session, now))
            error = ProtocolError("too_large", why, value=count, limit=most)
            return [*outputs, *self._count_rejection(station, session.name, error)]
        return []

    def _close(self, session: Session, now: float) -> list[Output]:
        """Close a session after the last batch that it has. Raises JournalError."""
        return session.receive(Close(session=session.name, last_seq=session.next_seq - 1), now)

    def _enforce_retention(self, now: float) -> list[Output]:
        """Enforce the journal's retention, and remove the deleted sessions from memory.

        Every `peer_poll_interval_s` also those that only a peer had and has deleted.
        """
        gone: dict[Key, str] = {}
        with suppress(JournalError):  # which the journal has said already
            gone |= self._journal.enforce_retention(now)
        if now >= self._peer_poll_due_s:
            self._peer_poll_due_s = now + self._limits.peer_poll_interval_s
            with suppress(JournalError):  # likewise; nothing is known to have gone
                gone |= dict.fromkeys(self._takeover.vanished_sessions(), "deleted by another process")
        for station, name in gone:
            self._held.remove(station, name)
            if not self._held.of(station):
                self._station_limit.forget(station)
        return [SessionDeleted(*key, why) for key, why in gone.items()]

    def _with_apps(self, station: str, session: Session, command: EditProgram) -> EditProgram:
        """Return the edit with the apps that replace its part. Raises as `apps_for`."""
        if not isinstance(command.action, ReplacePart):
            return command
        apps = apps_for(program_of(session.state), self._program(station, command.action.session))
        return AppliedProgramEdit(**vars(command), apps=apps)

    def _program(self, station: str, name: str) -> Program:
        """Return the program of a session, in memory or stored. Raises ProtocolError."""
        held = self._held.find(station, name)
        stored = self.stored.program(station, name) if held is None else program_of(held.state)
        return stored or program_of(self._held.require(station, name).state)

    def _count_rejection(self, station: str | None, name: str | None, error: ProtocolError) -> list[Output]:
        self._count_refused(station, error)
        session = self._held.find(station, name)
        if session is None and error.code != "unknown_session":
            session = self._held.newest(station)
        return [] if session is None else self._held.track(session, session.reject(error))

    def _count_refused(self, _station: str | None, error: ProtocolError) -> None:
        self.counters = self.counters.with_refusal(error)

    def _as_only_read(self, station: str, name: str, error: ProtocolError) -> ProtocolError:
        """Return the error of an operator's command.

        If its session is stored and too old to be loaded, the error states that it is read-only.
        """
        with suppress(JournalError):
            if error.code == "unknown_session" and self.stored.has(station, name):
                why = "newer sessions have taken the place of this one: it can be read, and cannot change"
                return ProtocolError("unknown_session", why, value=name)
        return error

    def _available_sessions(self) -> Iterable[Session]:
        stations = (
            sessions
            for name, sessions in self._held.by_station.items()
            if not self.ownership.in_takeover(name)
        )
        return (session for sessions in stations for session in sessions.values())


def _is_missing_or_behind(session: Session | None, copies: SessionCopies) -> bool:
    return session is None or copies.refused is not None or is_behind(session, copies)


def _needs_rebuilding(command: Command, session: Session) -> bool:
    """Return whether a session without a pipeline must first be rebuilt. Raises ProtocolError `conflict`."""
    if isinstance(command, Edit) and session.repeated(command) is not None:
        return False
    if not session.has_records:  # only a peer's journal has them, and the edits
        return isinstance(command, Edit | Preview | Describe | EditProgram)
    if isinstance(command, Edit | Preview):
        session.check_revision(command)
        return True
    return False


def _without_replies(outputs: list[Output]) -> list[Output]:
    return [output for output in outputs if not isinstance(output, Reply)]

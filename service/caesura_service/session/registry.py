"""All sessions of this instance, by station and name. Routes messages, charges refusals, keeps limits.

A refusal is charged to the session that it names, else to the station's current session where the
station is known, and always to the service. A station reaches only its own sessions. What the journal
cannot take is refused as `overloaded` with the journal's reason: the bridge still has it, and is asked
again. A closed session stays in the journal longer than it can be asked for here, and its name stays taken
for so long. Other threads read the `board`, which is replaced when a session comes or goes and holds each
one's immutable standing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice

from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.messages import Close, Heartbeat, JournalReport, Open, SampleBatch
from caesura_service.journal import Journal, JournalError, Key
from caesura_service.session.concluded import Concluded, standing_of
from caesura_service.session.content import check_columns
from caesura_service.session.limits import Limits
from caesura_service.session.ports import (
    Answer,
    Failed,
    Forgotten,
    Output,
    Owner,
    PipelineFactory,
    Refused,
    ReplayEnded,
)
from caesura_service.session.session import Session
from caesura_service.session.standing import Standing, Tally
from caesura_service.session.view import Pipeline


@dataclass(frozen=True)
class Board:
    """The sessions as they were when one last came or went; each one's standing is always current."""

    sessions: Mapping[str, tuple[Session, ...]]  # by station, newest last

    def standings(self) -> tuple[Standing, ...]:
        """Of every session."""
        return tuple(session.standing for sessions in self.sessions.values() for session in sessions)

    def current(self) -> tuple[Standing, ...]:
        """Of every station's newest session."""
        return tuple(sessions[-1].standing for sessions in self.sessions.values())


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
    ) -> None:
        self._owner = owner
        self._pipeline_factory = pipeline_factory
        self._default_preset = default_preset
        self._journal = journal
        self._limits = limits
        self._stations: dict[str, dict[str, Session]] = {}
        self._hushed: set[Session] = set()  # which keep a refusal back for a little while
        self._tidy_at = float("-inf")  # [s]
        self.board = Board({})
        self.tally = Tally()

    def restore(self) -> list[Failed]:
        """Rebuild every open session of the journal, and the closed ones that may be asked for.

        Those that cannot be rebuilt are left out and named.
        """
        failed = []
        for station, name in self._held():
            try:
                session = self._taken_up(station, name) or self._rebuild(station, name)
            except Exception as error:
                failed.append(Failed(station, name, error))
            else:
                self._stations.setdefault(station, {})[name] = session
        self._show()
        return failed

    def command(self, station: str, command: Open | Close, now: float) -> list[Output]:
        """Carry out a command; the outputs hold exactly one answer."""
        try:
            if isinstance(command, Open) and self._find(station, command.session) is None:
                return self._open(station, command, now)
            session = self._session(station, command.session)
            with _recording():
                return self._minded(session, session.receive(command, now))
        except ProtocolError as error:
            return [*self._charge(station, command.session, error), Answer(error)]

    def samples(
        self, station: str, message: SampleBatch | Heartbeat | ReplayEnded, now: float
    ) -> list[Output]:
        """Take what a bridge sent, or the end of an answer to a replay."""
        try:
            session = self._session(station, message.session)
            with _recording():
                said = self._minded(session, session.receive(message, now))
        except ProtocolError as error:
            return self._charge(station, message.session, error)
        for output in said:
            if isinstance(output, Refused):
                self.tally = self.tally.with_refusal(output.error)
        return said

    def refuse(self, station: str | None, error: ProtocolError) -> list[Output]:
        """A message that could not be read, from a station where the key told which."""
        return self._charge(station, None, error)

    def dropped(self, station: str, messages: int) -> list[Output]:
        """There was no room for so many messages of a station: its current session counts and shows them."""
        sessions = tuple(self._stations.get(station, {}).values())
        return self._minded(sessions[-1], sessions[-1].drop(messages)) if sessions else []

    def restate(self, station: str | None) -> list[Output]:
        """The open sessions of a station, or of all, say how they are: something beside them has changed."""
        told = [
            session
            for name, sessions in self._stations.items()
            if station in {None, name}
            for session in sessions.values()
            if session.is_open
        ]
        return [said for session in told for said in self._minded(session, session.drop(0))]

    def tick(self, now: float) -> list[Output]:
        """Time has passed: every open session may ask again for what is missing, and the journal tidy up."""
        said = [said for session in self._all() if session.is_open for said in session.tick(now)]
        said += [said for session in self._hushed for said in session.unhush(now)]
        self._hushed = {session for session in self._hushed if session.is_hushed}
        if now >= self._tidy_at:
            self._tidy_at = now + self._limits.tidy_interval_s
            said += self._tidy(now)
        return said

    def journal_report(self) -> JournalReport:
        """How the journal is doing; may be asked from any thread."""
        return self._journal.report()

    def _open(self, station: str, command: Open, now: float) -> list[Output]:
        if station not in self._stations and len(self._stations) >= self._limits.stations:
            raise ProtocolError("overloaded", "too many stations", value=station, limit=self._limits.stations)
        opening = command.model_copy(update={"preset": command.preset or self._default_preset})
        session = self._build(station, opening)
        with _recording("conflict"):
            if (station, command.session) in self._journal.sessions():
                why = "the journal has such a session, which is over or cannot be read: give it another name"
                raise ProtocolError("conflict", why, value=command.session)
            said = [*self._make_room(station, now), *session.begin(now)]
        self._stations.setdefault(station, {})[command.session] = session
        self._show()
        return said

    def _build(self, station: str, opening: Open) -> Session:
        check_columns(opening)
        try:
            pipeline = self._pipeline_factory(opening, self._default_preset)
        except ProtocolError:
            raise
        except Exception as error:
            why = f"the session could not be opened: {type(error).__name__}: {error}"
            raise ProtocolError("conflict", why) from error
        return self._session_of(station, opening, pipeline)

    def _session_of(self, station: str, opening: Open, pipeline: Pipeline) -> Session:
        return Session(
            station, opening, pipeline, owner=self._owner, journal=self._journal, limits=self._limits
        )

    def _held(self) -> list[Key]:
        """Which sessions of the journal are held here: those that are open, and the last closed ones."""
        known, closed = self._journal.sessions(), self._journal.closed()
        over: dict[str, list[Key]] = {}
        for key in known:
            if key in closed:
                over.setdefault(key[0], []).append(key)
        keep = {key for keys in over.values() for key in keys[-self._limits.closed_sessions :]}
        return [key for key in known if key not in closed or key in keep]

    def _taken_up(self, station: str, name: str) -> Session | None:
        """A closed session whose outcome the journal has."""
        outcome = self._journal.outcome(station, name)
        if outcome is None:
            return None
        session = self._session_of(station, outcome.opening, Concluded(outcome.snapshot))
        session.take_up(outcome, standing_of(outcome.snapshot, self._owner))
        return session

    def _rebuild(self, station: str, name: str) -> Session:
        records = self._journal.replay(station, name)
        opening = next(records).message
        if not isinstance(opening, Open):
            raise TypeError(f"the journal begins with {type(opening).__name__}, expected Open")
        session = self._build(station, opening)
        session.restore(records)
        return session

    def _make_room(self, station: str, now: float) -> list[Output]:
        """Close the oldest open and let go of the oldest closed session of a station that has its fill."""
        sessions = self._stations.get(station, {})
        said: list[Output] = []
        opened = [session for session in sessions.values() if session.is_open]
        for session in opened[: max(0, len(opened) - self._limits.open_sessions + 1)]:
            said += _unanswered(
                session.receive(Close(session=session.name, last_seq=session.next_seq - 1), now)
            )
        closed = [session.name for session in sessions.values() if not session.is_open]
        for name in islice(closed, max(0, len(closed) - self._limits.closed_sessions)):
            del sessions[name]
            self._journal.release(station, name)
        return said

    def _tidy(self, now: float) -> list[Output]:
        """What the journal no longer keeps cannot be asked for either."""
        with suppress(JournalError):  # which the journal has said already
            gone = self._journal.tidy(now)
            for station, name in gone:
                self._stations.get(station, {}).pop(name, None)
            if gone:
                self._show()
            return [Forgotten(*key, why) for key, why in gone.items()]
        return []

    def _charge(self, station: str | None, name: str | None, error: ProtocolError) -> list[Output]:
        self.tally = self.tally.with_refusal(error)
        session = self._find(station, name) or self._current(station, error)
        return self._minded(session, session.refuse(error)) if session else []

    def _minded(self, session: Session, said: list[Output]) -> list[Output]:
        """What a session says; where it keeps something back, it is asked for that later."""
        if session.is_hushed:
            self._hushed.add(session)
        return said

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

    def _all(self) -> Iterable[Session]:
        return (session for sessions in self._stations.values() for session in sessions.values())

    def _show(self) -> None:
        shown = {name: tuple(sessions.values()) for name, sessions in self._stations.items() if sessions}
        self.board = Board(shown)


@contextmanager
def _recording(code: ErrorCode = "overloaded") -> Iterator[None]:
    """Turn what the journal cannot take into a refusal. A session that never began need not try again."""
    try:
        yield
    except JournalError as error:
        raise ProtocolError(code, str(error)) from error


def _unanswered(said: list[Output]) -> list[Output]:
    return [output for output in said if not isinstance(output, Answer)]

"""A bridge in standby: connected to its robot, it sends samples only between a start and a stop.

It holds the station's liveliness token, publishes its state once a second, and answers `Start` and `Stop` on
the key `bridge_control`. The robot's hand-guiding button can also start sessions (`guiding_button`). Each
session has a `Bridge` of its own, with its ring and the same guarantees after a crash.

Outcome of each case:
  the same start twice      one session; the second answer names it
  two starts at once        the first opens a session; the second is refused and names it
  a stop twice              no error
  no service at a start     refused: the samples could not be stored
  no service at a stop      the ring keeps missing batches; the close is repeated until it is acknowledged
  the source ends or fails  the session is closed after its last sample; a lost source is opened again
  the bridge crashes        the next bridge of the station closes the session after its last batch
  another bridge is there   this one waits for it to leave, at most `token_s`, and then ends with an error
  the button, no service    nothing begins, and the status states the reason until the next start
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, suppress
from typing import Any

from caesura_clients import query
from caesura_clients.bridge.bridge import Bridge, new_bridge_name, new_session_name
from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.bridge.gated_source_feed import SourceFeed
from caesura_clients.bridge.marker_queue import MarkerQueue
from caesura_clients.bridge.query_responder import QueryThread
from caesura_clients.bridge.settings import BridgeSettings
from caesura_clients.bridge.sources import Chunk, Mark, Source, button_pressed
from caesura_protocol.codec import decode, encode, encode_error
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable, printable
from caesura_protocol.keys import check_name, station_key
from caesura_protocol.messages import (
    MAX_SOURCE,
    MAX_STATUS_TEXT,
    BridgeAck,
    BridgeControl,
    BridgeStatus,
    SessionStatus,
    Start,
    Stop,
)
from caesura_protocol.number_words import counted
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.transport_interface import Transport

OPEN_S = 4.0  # within which a service has to open the session
STOP_S = 12.0  # after which a stop is answered although the service lacks something
STATUS_S = 1.0
RECONNECT_S = 2.0  # between attempts to open a lost source
TIDY_S = 2.0  # between attempts to close a session that a bridge left open
TOKEN_S = 15.0  # for the token of a bridge that has just died
REMEMBERED = 64  # starts, by their id

OpenSource = Callable[[], AbstractContextManager[Source]]

logger = logging.getLogger(__name__)


class NoButtonError(SourceError):
    """The hand-guiding button shall begin demonstrations, and the source does not report one."""


class Standby:
    """Many sessions of one station, one after the other, each from a `Start` to a `Stop`.

    open_source: opens the source again whenever it is lost or has been read. source_name: its name in the
    status; say: called with each new status; token_s: how long to wait for another bridge of the station to
    leave. released_s [s]: the hand-guiding button also begins demonstrations, and ends those after it was
    released for so long; None: it does not.
    """

    def __init__(
        self,
        transport: Transport,
        station: str,
        open_source: OpenSource,
        *,
        source_name: str = "source",
        preset: str | None = None,
        settings: BridgeSettings | None = None,
        say: Callable[[BridgeStatus], None] | None = None,
        token_s: float = TOKEN_S,
        released_s: float | None = None,
    ) -> None:
        self.station = check_name(station, "station")
        self._transport = transport
        self._open_source = open_source
        self._preset, self._settings = preset, settings or BridgeSettings()
        self._token_s, self._released_s = token_s, released_s
        self._say = say or (lambda _status: None)
        self._over = threading.Event()
        self._changed = threading.Event()  # a command came, or the source ended
        self._changing = threading.Lock()
        self._starting = threading.Lock()  # one start at a time is looked at
        self._began = time.time()  # [s] time of day
        self._tidy_due = float("-inf")  # [s] monotonic
        self._tidied = False  # are the sessions closed that an earlier bridge left open?
        self._abandoned: set[str] = set()  # own sessions that may be open without a bridge
        self._current: _Demonstration | None = None
        self._started: dict[str, _Demonstration] = {}  # by the id of their start
        self.status = BridgeStatus(
            station=station,
            bridge=new_bridge_name(),
            state="failed",
            source=printable(source_name, MAX_SOURCE),
            problem="the source is not open yet",
        )

    def end(self) -> None:
        """End once the current session is stored. Any thread or signal handler may call it."""
        self._over.set()
        self._changed.set()

    def run(self) -> None:
        """Serve starts and stops until `end`.

        Raises CaesuraError if another bridge stays at the station, or the source lacks the button.
        """
        self._wait_for_station()
        key = station_key(self.station, "bridge_control")
        with ExitStack() as stack:
            # Before the token: a client that sees the station can start it.
            stack.enter_context(QueryThread(self._transport, key, self._answer))
            stack.enter_context(self._transport.declare_token(station_key(self.station, "alive")))
            beat = threading.Thread(target=self._publish, name=f"status {self.station}", daemon=True)
            beat.start()
            stack.callback(beat.join)
            stack.callback(self.end)
            while not self._over.is_set():
                try:
                    with self._open_source() as source:
                        self._check_button(source)
                        self._serve(source)
                except NoButtonError:
                    raise
                except Exception as error:  # of any library: the robot may come back
                    logger.debug("the source is lost", exc_info=True)
                    self._change(state="failed", problem=f"the source is lost: {_words(error)}")
                    self._over.wait(RECONNECT_S)

    def _wait_for_station(self) -> None:
        """Wait until no other bridge holds the station; the token of a dead one lasts for some seconds."""
        token = station_key(self.station, "alive")
        deadline = time.monotonic() + self._token_s
        while self._transport.list_tokens(token) and not self._over.wait(0.2):
            if time.monotonic() >= deadline:
                raise CaesuraError(f"a bridge is connected as {self.station} already: end that one first")

    def _check_button(self, source: Source) -> None:
        """Raise NoButtonError if the button shall begin demonstrations and the source has none."""
        if self._released_s is not None and button_pressed(source) is None:
            raise NoButtonError(
                f"the source {self.status.source} reports no hand-guiding button; these do: franky, panda, "
                "ur and xarm without --teach-mode, ros2 with FrankaRobotState"
            )

    # --- source and sessions, in the thread that runs ---------------------------------------------------

    def _serve(self, source: Source) -> None:
        """Serve with one source until the end, or until a session has read a source that can wait.

        Raises SourceError if the source is lost.
        """
        with SourceFeed(source, self._changed, self._released_s) as feed:
            if self._current is None:
                self._change(state="ready", problem=None)
            while not self._over.is_set():
                self._tidy()
                self._changed.wait(STATUS_S)
                self._changed.clear()
                if feed.button is not None and self._current is None and feed.button.accept():
                    self._start_by_button(source, feed)
                elif self._current is not None:
                    self._teach(self._current, source, feed)
                if feed.is_lost:
                    raise feed.failure or SourceError("it has ended")
                if feed.was_read:
                    return  # it begins anew with the next session

    def _start_by_button(self, source: Source, feed: SourceFeed) -> None:
        """Run one session after a press of the button.

        No client receives a refusal, so the status states it until the next start.
        """
        refusal: Exception | None = None
        try:
            one = self._begin(Start(id=new_session_name()))
        except (ProtocolError, CaesuraError) as error:
            refusal = error
        else:
            self._teach(one, source, feed)
            refusal = one.refusal if one.was_refused else None
        if refusal is None:
            return
        feed.end()
        if self._current is None:
            why = refusal.message if isinstance(refusal, ProtocolError) else str(refusal)
            self._change(problem=f"the button was pressed, and nothing began: {why}")

    def _teach(self, one: _Demonstration, source: Source, feed: SourceFeed) -> None:
        """Run one session, from its opening to its acknowledged end; store the outcome in the status."""
        outcome = ""
        try:
            with self._bridge(one, source) as bridge:
                bridge.wait_open(OPEN_S)
                why = self._follow(one, bridge, source, feed)
                self._change(state="stopping", session=one.session, problem=None)
                outcome = self._store(one, bridge) + why
                if bridge.slow_pose is not None and not source.can_wait:  # a file names it when it is opened
                    outcome += f"; {bridge.slow_pose.rstrip('.')}"
                if bridge.ignored_up is not None:
                    outcome += f"; {bridge.ignored_up}"
        except Unreachable as error:
            self._abandoned.add(one.session)
            outcome = f"not stored as a whole: {error}"
            one.failed(ProtocolError("overloaded", f"nothing was taught, try again: {error}"))
        except Exception as error:  # the source's too, which may be of any library
            if one.is_open:  # else the name may be that of another bridge's session
                self._abandoned.add(one.session)
            outcome = f"was ended by an error: {_words(error)}"
            one.failed(
                error if isinstance(error, ProtocolError) else ProtocolError("conflict", _words(error))
            )
            if not isinstance(error, CaesuraError | ProtocolError):
                raise
        finally:
            feed.end()
            self._current = None
            self._change(
                state="failed" if feed.is_lost else "ready",
                session=None,
                description=None,
                problem="the source is lost" if feed.is_lost else None,
                last_session=one.session if one.is_open else self.status.last_session,
                outcome=outcome if one.is_open else self.status.outcome,
            )
            one.done.set()

    def _bridge(self, one: _Demonstration, source: Source) -> Bridge:
        return Bridge(
            self._transport,
            self.station,
            source,
            session=one.session,
            preset=self._preset,
            settings=self._settings,
            description=one.start.description,
            holds_token=False,
        )

    def _follow(self, one: _Demonstration, bridge: Bridge, source: Source, feed: SourceFeed) -> str:
        """Send samples until a stop or the end of the source; return why they ended, empty after a stop."""
        with MarkerQueue(bridge.mark, self.station) as marks:
            feed.begin(_Taker(bridge, marks, rebased=not source.can_wait))
            self._change(state="teaching")
            one.opened()  # only now: what is taught after the answer is in the session
            was_released = False
            while not (one.stop.is_set() or self._over.is_set() or was_released):
                if bridge.ignored_up != self.status.problem:  # an older service may take over meanwhile
                    self._change(problem=bridge.ignored_up)
                if feed.has_ended or feed.failure is not None or feed.rejection is not None:
                    break
                self._changed.wait(STATUS_S)
                self._changed.clear()
                was_released = feed.button is not None and feed.button.is_over
            feed.end()
            bridge.stop()
        if feed.rejection is not None:
            return f"; the rest was refused: {feed.rejection}"
        if feed.failure is not None:
            return f"; the source failed: {feed.failure}"
        if feed.has_ended and not one.stop.is_set():
            return "; the source has ended"
        if was_released and not one.stop.is_set():
            return f"; the button was released for {self._released_s:g} s, which are left out"
        return "; the bridge was ended" if self._over.is_set() and not one.stop.is_set() else ""

    def _store(self, one: _Demonstration, bridge: Bridge) -> str:
        """Close the session, repeatedly until the service has every batch. Return the outcome as text."""
        while True:
            try:
                ack = bridge.finish(success=one.success)
            except Unreachable as error:
                self._change(problem=f"not stored yet: {error}")
                if self._over.is_set():
                    raise
            else:
                one.lost = ack.lost
                whole = counted(ack.next_seq, "batch")
                return f"is stored; {ack.lost} of {whole} are lost" if ack.lost else "is stored"

    # --- sessions that a bridge has left open -----------------------------------------------------------

    def _tidy(self) -> None:
        """Close the open sessions whose bridge is gone, where a service answers."""
        if (self._tidied and not self._abandoned) or time.monotonic() < self._tidy_due:
            return
        self._tidy_due = time.monotonic() + TIDY_S
        with suppress(CaesuraError, ProtocolError):
            if not query.services(self._transport):
                return
            found = query.snapshots(self._transport, self.station, complete=True)
            left = [one.status for one in found if one.status.state == "open"]
            still_open = [one for one in left if self._is_left_open(one) and not self._close_left_open(one)]
            if not still_open:
                self._tidied = True
                self._abandoned.clear()

    def _close_left_open(self, status: SessionStatus) -> bool:
        """Close a session; return whether it is closed.

        A service refuses it while another bridge still sends it, and answers nothing during a takeover.
        """
        try:
            return ControlClient(self._transport, self.station).close_left_open(status) is not None
        except ProtocolError:
            return False

    def _is_left_open(self, status: SessionStatus) -> bool:
        """Whether the session's bridge is gone: it failed in this process, or ended before this one began."""
        return status.session in self._abandoned or (status.opened or 0.0) < self._began

    # --- commands, in the thread of the queries ---------------------------------------------------------

    def _answer(self, asked: IncomingQuery) -> None:
        try:
            if asked.content is None:
                raise ProtocolError("malformed", "no command", expected="BridgeControl")
            command = decode(*asked.content, BridgeControl).command
            ack = self._start(command) if isinstance(command, Start) else self._stop(command)
        except ProtocolError as error:
            asked.refuse(encode_error(error))
        except CaesuraError as error:
            asked.refuse(encode_error(ProtocolError("overloaded", str(error))))
        except Exception as error:  # the next command is answered all the same
            logger.exception("a command failed")
            asked.refuse(encode_error(ProtocolError("internal", _words(error))))
        else:
            asked.reply(station_key(self.station, "bridge_control"), encode(ack))

    def _start(self, start: Start) -> BridgeAck:
        one = self._started.get(start.id)
        if one is None or one.was_refused:
            one = self._begin(start)
            self._changed.set()
        if not one.answered.wait(OPEN_S + 2 * STATUS_S):
            raise ProtocolError("overloaded", f"{one.session} is still being opened: try again")
        if one.was_refused and one.refusal is not None:
            raise one.refusal
        return BridgeAck(session=one.session, state=self.status.state)

    def _begin(self, start: Start) -> _Demonstration:
        """Make a start the current demonstration. Raises ProtocolError if none can begin now."""
        with self._starting:
            self._check_ready()
            self._check_no_other_session()
            one = _Demonstration(start, start.session or new_session_name())
            self._remember(start.id, one)
            self._current = one
            self._change(state="starting", session=one.session, description=start.description, problem=None)
        return one

    def _check_ready(self) -> None:
        """Raise ProtocolError if no session can begin now."""
        if self._over.is_set():
            raise ProtocolError("conflict", f"the bridge of {self.station} is ending")
        status = self.status
        if status.state == "ready" and self._current is None:
            return
        if status.state == "failed":
            raise ProtocolError("conflict", f"{self.station} cannot start: {status.problem}")
        operator = status.description and status.description.operator
        begun = f"was started by {operator}" if operator else "goes on"
        doing = "is still being stored" if status.state == "stopping" else f"{begun}: stop it first"
        why = f"{self.station} has demonstration {status.session}, which {doing}"
        raise ProtocolError("conflict", why, value=status.session)

    def _check_no_other_session(self) -> None:
        """Raise ProtocolError if another bridge teaches at the station, or no service answers."""
        if not query.services(self._transport):
            raise ProtocolError(
                "overloaded",
                "no service is there: a demonstration would be recorded nowhere; start the service",
            )
        program = query.find_program(self._transport, self.station)
        if program is None or program.complete or program.session in self._abandoned:
            return
        if not self._tidied:
            why = f"{program.session}, which an earlier bridge left open, is being closed: try again"
            raise ProtocolError("overloaded", why, value=program.session)
        why = (
            f"another bridge teaches {program.session} at {self.station}: end that one first; if it is gone, "
            "start this one again, which closes its session"
        )
        raise ProtocolError("conflict", why, value=program.session)

    def _remember(self, name: str, one: _Demonstration) -> None:
        self._started[name] = one
        while len(self._started) > REMEMBERED:
            del self._started[next(iter(self._started))]

    def _stop(self, stop: Stop) -> BridgeAck:
        one = self._current
        if one is None or (stop.session is not None and stop.session != one.session):
            return self._stopped_before(stop)
        latest = time.monotonic() + STOP_S
        if not one.answered.wait(OPEN_S):
            raise ProtocolError("overloaded", "the demonstration is just starting: stop it once it has begun")
        if one.was_refused:
            return self._stopped_before(stop)
        if not one.stop.is_set():
            one.success = stop.success
            one.stop.set()
            self._changed.set()
        if not one.done.wait(latest - time.monotonic()):
            why = self.status.problem or "the source delivers nothing"
            raise ProtocolError("overloaded", f"the bridge keeps trying to store {one.session}: {why}")
        return BridgeAck(session=one.session, state=self.status.state, lost=one.lost)

    def _stopped_before(self, stop: Stop) -> BridgeAck:
        """Return the answer to a stop of a session that has already ended.

        Raises ProtocolError for any other session, and for a `success` stated after the end.
        """
        past = {one.session: one for one in self._started.values()}
        last = stop.session or self.status.last_session
        over = f"no demonstration is being taught at {self.station}"
        if stop.success is not None and last in past and past[last].success != stop.success:
            command = f"caesura sessions describe {self.station} {last} --success"
            why = f"{over}: {last} has ended before, and this success is not stored; use {command}"
            raise ProtocolError("conflict", f"{why} {'yes' if stop.success else 'no'}")
        if stop.session is not None and stop.session in past.keys() | {self.status.last_session}:
            lost = past[stop.session].lost if stop.session in past else 0
            return BridgeAck(session=stop.session, state=self.status.state, lost=lost)
        if stop.session is not None:
            why = f"{self.station} has no demonstration {stop.session}"
            there = [self.status.session] if self.status.session else None
            raise ProtocolError("unknown_session", why, value=stop.session, expected=there)
        raise ProtocolError("conflict", over)

    # --- status -----------------------------------------------------------------------------------------

    def _change(self, **changes: Any) -> None:
        for name in {"problem", "outcome"} & changes.keys():
            changes[name] = printable(changes[name] or "", MAX_STATUS_TEXT) or None
        with self._changing:
            self.status = self.status.model_copy(update=changes)
            self._put_status()
            with suppress(OSError):  # its terminal is gone
                self._say(self.status)

    def _publish(self) -> None:
        while not self._over.wait(STATUS_S):
            with self._changing:
                self._put_status()

    def _put_status(self) -> None:
        with suppress(CaesuraError):  # the network is lost: it is published again in a second
            self._transport.put(station_key(self.station, "bridge_status"), encode(self.status))


def _words(error: Exception) -> str:
    """Return the text of an error, preceded by its type if it comes from another library."""
    is_own = isinstance(error, CaesuraError | ProtocolError | OSError)
    return str(error) if is_own else f"{type(error).__name__}: {error}"


class _Demonstration:
    """A session between a start and a stop."""

    def __init__(self, start: Start, session: str) -> None:
        self.start, self.session = start, session
        self.stop = threading.Event()
        self.done = threading.Event()
        self.answered = threading.Event()
        self.is_open = False
        self.success: bool | None = None
        self.lost = 0  # batches that the service lacks in the end
        self.refusal: ProtocolError | None = None  # it was not opened, or was ended by an error

    @property
    def was_refused(self) -> bool:
        """Whether the start did not open a session."""
        return self.refusal is not None and not self.is_open

    def opened(self) -> None:
        """Record that a service has the session, and set `answered`."""
        self.is_open = True
        self.answered.set()

    def failed(self, refusal: ProtocolError) -> None:
        """Record the refusal of the opening, or the error that ended the session, and set `answered`."""
        self.refusal = refusal
        self.answered.set()


class _Taker:
    """Passes the samples of a source to a session. rebased: times count from 0 at the first sample."""

    def __init__(self, bridge: Bridge, marks: MarkerQueue, *, rebased: bool) -> None:
        self._bridge, self._marks = bridge, marks
        self._t0: float | None = None if rebased else 0.0

    def __call__(self, item: Chunk | Mark) -> None:
        if isinstance(item, Mark):
            if self._t0 is not None:
                self._marks.put(item.t - self._t0)
            return
        if self._t0 is None and len(item):
            self._t0 = float(item[0, 0])
        if self._t0:
            item = item.copy()
            item[:, 0] -= self._t0
        self._bridge.send(item)

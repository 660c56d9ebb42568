"""A bridge between one robot and the service.

It publishes numbered batches. It keeps the last two minutes for replay, and, at 1 kHz, ten minutes of batches
that no service has acknowledged.

Four threads:
  the caller's  takes chunks from the source, numbers them and appends them to the ring; no network calls;
  send          publishes the batches of the ring, repeated batches and heartbeats;
  replay        answers the service's requests for batches that it did not receive;
  keeper        opens the session, and opens it again whenever a service appears or disappears.

How losses are found: Zenoh's `put` drops silently, so the service detects a missing batch by its number and
queries `replay`. A lost last batch leaves no gap in the numbers, so an idle bridge repeats its last number.
`Close` is acknowledged only when the service has every batch; until then the missing ones are sent again.

Flow control of a source that can wait: batches are not acknowledged, but `Open` is, and may be repeated. When
`window_batches` are unacknowledged, the bridge repeats `Open` until the service has received half of them.

A bridge that ends before a service has every batch writes the batches in its ring to a file.
"""

from __future__ import annotations

import logging
import os
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import datetime
from types import TracebackType
from typing import Self

import numpy as np
from pydantic import ValidationError

from caesura_clients.bridge.batch_sender import BatchSender
from caesura_clients.bridge.control_client import ControlClient
from caesura_clients.bridge.marker_queue import MarkerQueue
from caesura_clients.bridge.real_time_priority import share_priority
from caesura_clients.bridge.replay_ring import ReplayRing
from caesura_clients.bridge.replay_server import ReplayServer
from caesura_clients.bridge.send_thread import SendThread
from caesura_clients.bridge.settings import BridgeSettings
from caesura_clients.bridge.sources import Chunk, Mark, Source
from caesura_clients.bridge.unstored_batch_export import save_unstored
from caesura_clients.session_corrections import mark
from caesura_protocol.codec import signals_of
from caesura_protocol.errors import CaesuraError, ProtocolError, SourceError, Unreachable
from caesura_protocol.formats.sample_checks import wrong_values
from caesura_protocol.keys import NAME_PATTERN, check_name, service_key, station_key
from caesura_protocol.messages import Ack, Close, Description, HandOnRobot, Open
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import FirstSecond
from caesura_protocol.pose_update_rate import PoseReadings
from caesura_protocol.programs.safety import UNSET, CellSettings
from caesura_protocol.recording import OPTIONS, contradiction, is_option, unit_remedy
from caesura_protocol.transport.inbox import Inbox
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.up_direction import UP, up_text
from caesura_protocol.validation_words import first_finding, not_one_of

# What a service says of a session that it does not have, or not all of. Where another station has one of that
# name, a lost one is taken for that station's.
LOST = {"conflict", "unknown_session", "forbidden"}

logger = logging.getLogger(__name__)

MARKER = "marker"  # whose corrections those of a pedal are


def new_session_name(now: datetime | None = None) -> str:
    """Return a new session name, `s{yyyymmdd}-{hhmmss}-{4 hex}`: names sort by time and do not repeat."""
    return f"s{now or datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"


class Bridge:
    """One session of one station, from its first sample to its acknowledged end.

    epoch: 0 for a new session. A restarted bridge continues a session with a higher epoch than before, and
    must then not send before `wait_open` has returned.

    >>> with Bridge(transport, "cell-1", source) as bridge:  # doctest: +SKIP
    ...     bridge.run()

    Raises ProtocolError where the service refuses, Unreachable where it does not acknowledge the end,
    CaesuraError where the session's name is taken.
    """

    def __init__(
        self,
        transport: Transport,
        station: str,
        source: Source,
        *,
        session: str | None = None,
        epoch: int = 0,
        preset: str | None = None,
        settings: BridgeSettings | None = None,
        description: Description | None = None,
        holds_token: bool = True,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """description: the operator's statements about the session; None states nothing.

        holds_token: False if the caller declares the liveliness token of the station.
        """
        self.station = check_name(station, "station")
        self.session = check_name(session or new_session_name(), "session")
        preset = None if preset is None else check_name(preset, "preset")
        self.settings = settings or BridgeSettings()
        self._source = source
        self._open = _opening(source, self.session, epoch, preset, self.settings.setting, description)
        self._holds_token = holds_token
        opening = self._open
        self._first_second = FirstSecond(
            opening.columns, opening.length_unit, opening.declared_units, opening.robot
        )
        self._pose_readings = PoseReadings(opening.columns)
        self._ring = ReplayRing(
            span_s=self.settings.ring_span_s,
            max_samples=self.settings.ring_samples,
        )
        self._transport = transport
        self._control = ControlClient(transport, self.station)
        self._sender = BatchSender(
            transport,
            self.station,
            self._open,
            self._ring,
            batch_samples=self.settings.batch_samples,
            clock=clock,
        )
        self._replay = ReplayServer(transport, self.station, self.session, self._ring, clock)
        self._clock = clock
        self.unmarked: list[str] = []  # why marks of the source's were not made
        self._revision = 0  # of the session, as far as a mark has learnt
        self._ignored_up: str | None = None
        self._is_open = self._is_closed = False  # to a service; with all that was sent
        self._answered = threading.Event()  # the first Open was: acknowledged or refused
        self._over = threading.Event()
        self._stopped = threading.Event()  # the demonstration is over: it takes no samples
        self._failure: Exception | None = None
        self._services = Inbox()
        self._keeper = threading.Thread(target=self._run_keeper, name=f"keeper {station}", daemon=True)
        self._shares_priority = False  # the threads have that of the robot's loop
        self._send_thread = SendThread(
            self._sender,
            f"send {station}",
            tick_s=self.settings.tick_s,
            max_latency_s=self.settings.max_latency_s,
            heartbeat_s=self.settings.heartbeat_s,
            over=self._over,
        )
        self._stack = ExitStack()

    @property
    def sent(self) -> int:
        """The number of batches of the session so far, including those of a predecessor."""
        return self._sender.last_seq + 1

    @property
    def acknowledged(self) -> int:
        """The number of batches that the service has acknowledged."""
        return self._ring.acknowledged

    @property
    def is_open(self) -> bool:
        """Whether a service has acknowledged the session; stays true after the close."""
        return self._is_open

    @property
    def slow_pose(self) -> str | None:
        """A warning that the source reads its pose too seldom and repeats it; None if it does not."""
        return self._pose_readings.slow

    @property
    def ignored_up(self) -> str | None:
        """A warning that the service ignores the stated direction of up.

        None if it uses it or none is stated.
        """
        return self._ignored_up

    @property
    def postponed(self) -> str | None:
        """The reason why a service refuses the session for now, as of the last answer; None without one."""
        return self._control.postponed

    @property
    def stuck_s(self) -> float:
        """Time [s] for which the service has requested the same batch, which it cannot store.

        0 if it does not.
        """
        return self._replay.stuck_s

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self._replay)
            stack.enter_context(self._transport.watch_liveliness(service_key("*", "alive"), self._services))
            if self._holds_token:
                stack.enter_context(self._transport.declare_token(station_key(self.station, "alive")))
            stack.enter_context(self._send_thread)
            self._keeper.start()
            stack.callback(self._keeper.join)
            stack.callback(self._over.set)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()
        is_refused = isinstance(error, ProtocolError) and not self._is_open
        if not self._is_closed and not is_refused and self.sent > self.acknowledged:
            self._save_unstored()

    def run(self) -> Ack:
        """Send all samples of the source and close the session; return the acknowledgement of the close.

        If the source fails, the samples before the failure are sent, the session is closed and the error is
        raised.
        """
        if self._source.can_wait or self._open.epoch > 0:
            self.wait_open()
        try:
            with MarkerQueue(self.mark, self.station) as marks:
                self.unmarked = marks.failed
                for item in self._source.chunks():
                    if isinstance(item, Mark):
                        marks.put(item.t)
                    else:
                        self.send(item)
        except (ProtocolError, Unreachable):
            raise  # the service's word, not the source's
        except Exception:
            with suppress(ProtocolError, CaesuraError):  # the source's failure says more
                self.finish()
            raise
        return self.finish()

    def wait_open(self, timeout_s: float | None = None) -> None:
        """Wait until a service has opened the session.

        Raises Unreachable, or ProtocolError where it refuses.
        """
        if not self._answered.wait(timeout_s):
            what = f"no service has opened {self.station}/{self.session} for {timeout_s:g} s"
            raise Unreachable(what + self._because())
        self._raise_failure()

    def send(self, chunk: Chunk) -> None:
        """Send samples (k, columns). Makes no network call, unless the source can wait.

        Raises SourceError for a wrong shape, a value that is not finite, or values in the first second that
        no session accepts or that are probably in another unit; ProtocolError once the service has refused
        the session; CaesuraError once it is closed. After `stop` it drops the samples.
        """
        if not self._shares_priority:
            self._shares_priority = True
            share_priority((self._send_thread.thread, self._replay.thread, self._keeper))
        self._raise_failure()
        if self._stopped.is_set():
            return
        if self._over.is_set():
            raise CaesuraError(f"{self.station}/{self.session} is closed: it takes no samples")
        step = self.settings.batch_samples
        for start in range(0, len(chunk), step):
            self._check_first_second(chunk[start : start + step])
            self._sender.push(chunk[start : start + step])
            self._pose_readings.push(chunk[start : start + step])
            if self._source.can_wait:
                self._wait_for_room()

    def stop(self) -> None:
        """End the demonstration now: drop later samples, and unblock a source that waits."""
        self._sender.end()
        self._stopped.set()

    def mark(self, t: float | None = None, *, author: str = MARKER) -> Ack:
        """Mark a changepoint: a segment ends at `t` [s], by default at the newest sample; the next begins.

        Waits for the network, so it must not be called in a robot's control loop. Raises as
        `session_corrections.edit`, or CaesuraError before the first sample.
        """
        t = self._sender.last_t if t is None else t
        if t is None:
            raise CaesuraError(f"{self.station}/{self.session} has no samples yet: nothing to mark")
        ack = mark(self._transport, self.station, self.session, t, author=author, revision=self._revision)
        self._revision = ack.revision
        return ack

    def finish(self, *, success: bool | None = None) -> Ack:
        """Send the pending samples and close the session; it may be called again after a failure.

        success: whether the demonstration succeeded; None states nothing.

        Raises Unreachable where the service does not acknowledge everything in `close_timeout_s`, or
        ProtocolError where it refuses to.
        """
        self._raise_failure()
        self._sender.flush()
        self._sender.put_waiting()
        close = Close(
            session=self.session,
            last_seq=self._sender.last_seq,
            bridge=self._open.bridge,
            success=success,
        )
        deadline = self._clock() + self.settings.close_timeout_s
        while True:
            # The keeper may have been refused: by a session of another bridge, or by our own that is closed
            # already, where the answer to an earlier close was lost. The next answer says which.
            failure, before = self._failure or self._send_thread.failure, self.acknowledged
            ack, refusal, is_open = self._try_to_close(close)
            if ack is not None and ack.state == "closed" and ack.next_seq > close.last_seq:
                self._over.set()
                self._is_closed = True
                return ack
            if failure is not None and (ack is not None or refusal is not None or is_open):
                raise failure
            if self._clock() >= deadline:
                raise refusal or failure or self._unacknowledged()
            if is_open and self.acknowledged <= before:
                self._sender.resend(self.acknowledged, self.settings.window_batches)
            if self._over.wait(self.settings.retry_s):
                time.sleep(self.settings.retry_s)  # the keeper has failed: `_over` waits no longer

    def _try_to_close(self, close: Close) -> tuple[Ack | None, ProtocolError | None, bool]:
        """Send the close once; reopen the session at a service that lost it or lacks batches.

        Returns no refusal where the service lacked batches, because a later close may be accepted. The last
        value states whether a service has the session now: only then can batches be sent.
        """
        had_all = self.acknowledged > close.last_seq
        try:
            ack = self._control.ask(close)
        except ProtocolError as refusal:
            if refusal.code not in LOST:
                raise
            try:
                is_open = self._ask_to_open()
            except ProtocolError:  # the first refusal says more
                return None, refusal, False
            is_final = is_open and had_all and self.acknowledged > close.last_seq
            return None, refusal if is_final else None, is_open
        if ack is not None:
            self._ring.acknowledged = ack.next_seq
        return ack, None, False

    def _save_unstored(self) -> None:
        """Write the batches of the ring to a file, unless the source can deliver its samples again."""
        folder, batches = self.settings.unstored_folder, self._ring.entries_from(0, self.sent)
        if folder is None or self._source.can_wait or not batches:
            return
        name = f"{self.station}/{self.session}"
        lacking = f"of {counted(self.sent, 'batch')} a service is known to have {self.acknowledged}"
        try:
            path = save_unstored(self.station, self._open, batches, folder)
        except OSError as error:
            why = f"{folder.absolute()} cannot be written: {error.strerror or error}"
            logger.error("%s: %s; the rest is lost: %s", name, lacking, why)
        else:
            since = f" from batch {batches[0].seq} on" if batches[0].seq else ""
            play = f"caesura bridge --station {self.station} --source file --file {path}"
            logger.warning("%s: %s; they are stored%s, play them with `%s`", name, lacking, since, play)

    def _unacknowledged(self) -> Unreachable:
        return Unreachable(
            f"{self.station}/{self.session}: the service is known to have {self.acknowledged} of {self.sent} "
            f"batches {self.settings.close_timeout_s:g} s after the end{self._because()}"
        )

    def _because(self) -> str:
        return "" if self.postponed is None else f": {self.postponed}"

    def _wait_for_room(self) -> None:
        """Block the source while `window_batches` batches are unacknowledged."""
        if self.sent - self.acknowledged < self.settings.window_batches:
            return
        before, since = self.acknowledged, self._clock()
        while self.sent - self.acknowledged > self.settings.window_batches // 2:
            if self._stopped.is_set():
                return
            self._ask_to_open()
            self._raise_failure()
            if self.acknowledged > before:
                before, since = self.acknowledged, self._clock()
            elif self._clock() - since > self.settings.stall_s:
                self._sender.resend(self.acknowledged, self.settings.window_batches)
                since = self._clock()
            self._over.wait(self.settings.tick_s)

    def _ask_to_open(self) -> bool:
        """Send the session's `Open`; return True if a service answered."""
        ack = self._control.ask(self._open)
        if ack is not None:
            self._ring.acknowledged = ack.next_seq
            self._ignored_up = self._ignored_up or _ignored_up(self._open, ack)
        return ack is not None

    def _run_keeper(self) -> None:
        """Keep the session open; an error is stored and raised by the next send."""
        try:
            open_due, due = True, self._clock()
            while not self._over.is_set():
                open_due |= self._services.get(self.settings.tick_s) is not None
                open_due |= self._clock() >= due + self.settings.reopen_s
                if open_due and self._clock() >= due:
                    open_due, due = not self._open_and_announce(), self._clock() + self.settings.retry_s
        except Exception as error:
            self._failure = error
            self._over.set()
        finally:
            self._answered.set()

    def _open_and_announce(self) -> bool:
        """Open the session and publish its last number; return whether a service answered."""
        if not self._ask_to_open():
            return False
        if not self._is_open:
            self._take_over_numbers()
        if self.sent:
            self._sender.heartbeat()
        self._answered.set()
        return True

    def _take_over_numbers(self) -> None:
        """Number batches from 0, or after those of a predecessor with a lower epoch."""
        if self._open.epoch > 0:
            self._sender.continue_from(self.acknowledged)
        elif self.acknowledged > self.sent:
            raise CaesuraError(
                f"{self.station}/{self.session} already has {counted(self.acknowledged, 'batch')}; "
                "give the session another name, or the bridge a higher epoch"
            )
        self._is_open = True

    def _check_first_second(self, rows: Chunk) -> None:
        if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] != len(self._open.columns):
            return  # the sender refuses it
        if not self._first_second.is_over:
            signals = signals_of(self._open.columns, np.asarray(rows, np.float64))
            before = self._first_second.seen
            for wrong in wrong_values(signals, lambda row: f"sample {before + row}"):
                raise SourceError(f"the source: {wrong}")
        if (found := self._first_second.check(rows)) is not None:
            raise SourceError(f"the source: {found}. {unit_remedy(found, self._open.length_unit)}")

    def _raise_failure(self) -> None:
        failure = self._failure or self._send_thread.failure
        if failure is not None:
            raise failure


def new_bridge_name() -> str:
    """Return a unique name of this bridge: `{host}-{process}-{4 hex}`."""
    host = re.sub("[^a-z0-9]+", "-", socket.gethostname().lower()).strip("-")[:40] or "bridge"
    return f"{host}-{os.getpid()}-{secrets.token_hex(2)}"


def _robot_of(source: Source) -> CellSettings:
    """Return cell settings with the robot name that the source states; UNSET if it states none.

    A `robot` attribute that is no text is ignored: a source may keep the driver of its arm there. Raises
    SourceError for a text that is no valid name.
    """
    name = getattr(source, "robot", None)
    if not isinstance(name, str):
        return UNSET
    if not re.fullmatch(NAME_PATTERN, name):
        raise SourceError(f"robot is {name!r}, expected a name as of `caesura robots`")
    return CellSettings(robot=name)


def _ignored_up(opening: Open, ack: Ack) -> str | None:
    """Return a warning if `up` is stated to a service that does not support it; None otherwise."""
    up = opening.up
    if up is None or up == UP or ack.up is not None:
        return None
    return (
        f"the service ignores that up is {up_text(up)}: it is an older version, or was when "
        f"{opening.session} began. There loads weigh against z. Update the service and teach this again"
    )


def _described(stated: Description | None, of_source: Description | None) -> Description | None:
    """Return a description, completed by that of the source where it states nothing."""
    if of_source is None or of_source == Description():
        return stated
    own = {} if stated is None else stated.model_dump(exclude_defaults=True)
    return of_source.model_copy(update=own)


def _opening(
    source: Source,
    session: str,
    epoch: int,
    preset: str | None,
    setting: CellSettings,
    description: Description | None,
) -> Open:
    # A source that was written for an earlier version does not state whether a hand is on the robot.
    hand_on_robot: HandOnRobot = getattr(source, "hand_on_robot", "unknown")
    for name, known in OPTIONS.items():
        value = hand_on_robot if name == "hand_on_robot" else getattr(source, name)
        if not is_option(name, value):
            raise SourceError(not_one_of(name, value, known))
    if (wrong := contradiction(source.wrench_source, hand_on_robot)) is not None:
        raise SourceError(wrong)
    stated = setting.completed_by(getattr(source, "setting", UNSET)).completed_by(_robot_of(source))
    try:
        return Open(
            session=session,
            epoch=epoch,
            columns=source.columns,
            wrench_source=source.wrench_source,
            hand_on_robot=hand_on_robot,
            force_frame=source.force_frame,
            length_unit=source.length_unit,
            preset=preset,
            bridge=new_bridge_name(),
            **stated._asdict(),
            declared_units=getattr(source, "declared_units", ()),
            assumed=getattr(source, "assumed", ()),
            description=_described(description, getattr(source, "description", None)),
        )
    except ValidationError as error:
        raise SourceError(f"the source: {first_finding(error)}") from error

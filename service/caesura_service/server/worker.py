"""The worker thread: processes arrivals by the registry and publishes the outputs.

The queue chooses the next station by the measured time of each station's work. Work longer than a slice
continues in its station's next turn. Work without a message, such as a takeover, has separate lanes.

An error affects only the arrival that caused it: the sender of a command gets a reply, and a line is logged,
at most one in ten seconds for each station. Only this thread passes the time to sessions.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVarTuple

from caesura_protocol.codec import decode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import parse_station_key
from caesura_protocol.messages import Ack, Control, Heartbeat, Preview, SampleBatch
from caesura_protocol.messages import Command as Wanted
from caesura_protocol.number_words import counted
from caesura_protocol.token_bucket import LOG_RATE, SENDERS, RateLimit
from caesura_service.cooperative_scheduler import stand_aside
from caesura_service.ownership.registry import REBUILDING, Registry
from caesura_service.publishing.events import (
    BatchRejected,
    Output,
    Publish,
    Reply,
    RequestReplay,
    SessionDeleted,
    SessionFailed,
    StationTakenOver,
    TakeoverFailed,
)
from caesura_service.server.background_thread import BackgroundThread
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import (
    NETWORK,
    UNKNOWN,
    Arrival,
    BatchesReceived,
    CommandReceived,
    LivelinessChanged,
    RawPayload,
    ReplayFinished,
    RouterLinkChanged,
    SamplesReceived,
    Unfinished,
    Watching,
    source_of_key,
    station_of,
)
from caesura_service.server.outbound import ResultPublisher
from caesura_service.server.station_manager import TAKEOVER, StationManager
from caesura_service.server.work_queue import WHOLE, WorkQueue
from caesura_service.sessions.same_layout_batches import ENCODING

logger = logging.getLogger(__name__)
Given = TypeVarTuple("Given")
StationArrival = SamplesReceived | BatchesReceived | ReplayFinished | CommandReceived

TICK_S = 0.1  # between two looks at what is still missing
AT_ONCE = 16  # arrivals before a look at everything else, unless there is something else to do
EVENTS = LivelinessChanged, RouterLinkChanged, Watching  # of the network


class Worker(BackgroundThread):
    """Processes the work queue in a separate thread while the context lasts."""

    def __init__(
        self,
        registry: Registry,
        station_manager: StationManager,
        queue: WorkQueue[Arrival],
        publisher: ResultPublisher,
        budgets: Budgets,
        clock: Callable[[], float],
    ) -> None:
        self.messages = 0  # taken from the queue so far
        self._chores: set[str] = set()  # own lanes that are enqueued
        self._queue_revision = 0  # published so far, with the overloaded sources of then:
        self._overloaded = frozenset[str]()
        self._registry = registry
        self._station_manager = station_manager
        self._queue = queue
        self._publisher = publisher
        self._budgets = budgets
        self._previewing: set[str] = set()  # lanes whose work is a preview
        self._refused: set[str] = set()  # stations whose status says that their work is used up
        self._clock = clock
        self._log_rate = RateLimit(LOG_RATE)
        super().__init__("caesura-worker", queue.wake)

    def _run(self) -> None:
        due = self._clock() + TICK_S
        while not self._stopped.is_set():
            idle_s = self._station_manager.idle_s()
            self._schedule_chores(takes_over=idle_s <= 0.0)
            self._process_some(AT_ONCE, min(TICK_S, idle_s))
            if self._queue.revision != self._queue_revision:
                self._run_guarded(self._publish_overload)
            if (now := self._clock()) >= due:
                due = now + TICK_S
                self._run_guarded(self._emit_step, self._registry.tick, now)
        self._registry.slices.stop()
        self._station_manager.stop()

    def _schedule_chores(self, *, takes_over: bool) -> None:
        """Enqueue takeovers and the rebuilds of each station like arrivals."""
        due = {REBUILDING + station for station in self._registry.rebuilding}
        for lane in (due | {TAKEOVER} if takes_over else due) - self._chores:
            self._chores.add(lane)
            self._queue.put_unbounded(Unfinished(lane), lane)

    def _process_some(self, most: int, patience_s: float) -> None:
        """Wait for an arrival; process it, and further ones up to `most` in all."""
        for _ in range(most):
            if (arrival := self._queue.get(patience_s)) is None:
                return
            began, lane, done = time.perf_counter(), _lane_of(arrival), True
            if isinstance(arrival, EVENTS):
                self._run_guarded(self._station_manager.handle_event, arrival)
            else:
                done = self._run_slice(arrival, lane)
            if not done:
                self._queue.put_back(Unfinished(lane), stands_aside=self._registry.slices.stands_aside(lane))
            self._charge(lane, time.perf_counter() - began)
            if done:
                self._previewing.discard(lane)
            if self._chores or not len(self._queue):
                return

    def _charge(self, lane: str, took_s: float) -> None:
        """Charge the time of an arrival [s] to its lane and its station's budget.

        A rebuild uses no budget: a correction of an old session must not cost a new one its samples.
        """
        self._queue.charge(took_s)
        station = lane.removeprefix(REBUILDING)
        if lane in self._previewing:
            self._budgets.charge_preview(lane, took_s)
        elif lane == station:
            self._budgets.charge_work(lane, took_s)
        self._registry.record_work(station, took_s)

    def _run_slice(self, arrival: StationArrival | Unfinished, lane: str) -> bool:
        """Run a slice of an arrival's work; return whether the work is finished."""
        slices = self._registry.slices
        if not isinstance(arrival, Unfinished):
            done = slices.begin(lane, partial(self._run_guarded, self._process, arrival))
        elif slices.is_under_way(lane):
            done = slices.go_on(lane)
        elif lane == TAKEOVER:
            takeover = partial(self._run_guarded, self._emit_step, self._station_manager.step)
            done = slices.begin(lane, takeover)
        elif lane.startswith(REBUILDING):
            step, station = self._registry.rebuild_step, lane.removeprefix(REBUILDING)
            done = slices.begin(lane, partial(self._run_guarded, self._emit_step, step, station))
        else:
            done = slices.go_on(lane)
        if done:
            self._chores.discard(lane)
        return done

    def _emit_step(self, step: Callable[[*Given], Iterable[Output]], *given: *Given) -> None:
        self.emit(step(*given))

    def _publish_overload(self) -> None:
        """Count drops in their sessions, and publish a status if an overload began or ended."""
        self._queue_revision = self._queue.revision
        before, self._overloaded = self._overloaded, self._queue.overloaded_sources
        for source, messages in self._queue.pop_drops().items():
            self.emit(self._registry.report_dropped(station_of(source), messages))
            self._publish_budget(station_of(source))
        for source in before ^ self._overloaded:
            self.emit(self._registry.republish_status(None if source == WHOLE else station_of(source)))

    def _publish_budget(self, station: str) -> None:
        """Count a refusal in a station's session once its budget of work is used up."""
        if (refusal := self._budgets.work_exhausted(station)) is None:
            self._refused.discard(station)
        elif station not in self._refused and len(self._refused) < SENDERS:
            self._refused.add(station)
            self.emit(self._registry.reject(station, refusal))

    def _run_guarded(self, step: Callable[[*Given], None], *given: *Given) -> None:
        try:
            step(*given)
        except Exception:
            if self._log_rate.allows(_log_key(*given)):
                logger.exception("an event was lost to an error of the service")

    def _process(self, arrival: StationArrival) -> None:
        self.messages += len(arrival.block.payloads) if isinstance(arrival, BatchesReceived) else 1
        match arrival:
            case SamplesReceived(content, station):
                self._process_samples(content, station)
            case BatchesReceived():
                self._process_batches(arrival)
            case ReplayFinished(replay):
                self._publisher.replay_finished()
                self.emit(
                    self._registry.handle_samples(replay.request.station, replay.result(), self._clock())
                )
            case CommandReceived():
                self._process_command(arrival)

    def _process_samples(self, content: RawPayload, station: str | None) -> None:
        try:
            station = station or parse_station_key(content.key)[0]  # raises for an invalid key
            message = _batch(content)
        except ProtocolError as error:
            logger.debug("refused on %s: %s", content.key, error)
            self.emit(self._registry.reject(station, error))
            return
        self.emit(self._registry.handle_samples(station, message, self._clock()))

    def _process_batches(self, arrival: BatchesReceived) -> None:
        """Process batches in turn, those of one observation together.

        The program changed by the last ones is made once no other station has queued work.
        """
        block, station = arrival.block, arrival.station
        session = block.session
        while block.payloads:
            count, outputs = self._registry.handle_together(station, block, self._clock())
            if not count:
                payload = block.payloads[0]
                self._process_samples(RawPayload(arrival.key, payload, ENCODING, len(payload)), station)
            self.emit(outputs)
            block = block.after(max(count, 1))
            if self._registry.has_due_program(station, session):
                if not block.payloads:
                    stand_aside()
                self.emit(self._registry.make_due_program(station, session))

    def _process_command(self, arrival: CommandReceived) -> None:
        try:
            outputs = self._execute(arrival.content)
        except Exception as error:
            why = f"not carried out: {type(error).__name__}"
            self._reply(arrival, ProtocolError("internal", why))
            raise
        for output in outputs:
            if isinstance(output, Reply):
                self._reply(arrival, output.reply)
            else:
                self.emit([output])

    def _reply(self, arrival: CommandReceived, reply: Ack | ProtocolError) -> None:
        self._publisher.reply(arrival.query, arrival.content.key, _lane_of(arrival), reply)

    def _execute(self, content: RawPayload) -> list[Output]:
        """Execute a command; return its outputs with one reply."""
        station: str | None = None
        try:
            station = parse_station_key(content.key)[0]
            command = _command(content)
        except ProtocolError as error:
            logger.debug("refused on %s: %s", content.key, error)
            return [Reply(error), *self._registry.reject(station, error)]
        if isinstance(command, Preview):
            if (refusal := self._budgets.reject_preview(station)) is not None:
                return [Reply(refusal)]
            self._previewing.add(station)
        return self._registry.handle_command(station, command, self._clock())

    def emit(self, outputs: Iterable[Output]) -> None:
        """Publish, request and log the outputs. Another thread may call it only before the worker starts."""
        for output in outputs:
            match output:
                case Publish():
                    self._publisher.publish(output)
                case RequestReplay():
                    self._publisher.request_replay(output)
                case BatchRejected(error):
                    logger.debug("refused: %s", error)
                case SessionFailed(station, session, error):
                    fields = {"station": station, "session": session}
                    logger.error(
                        "%s/%s was closed by an error", station, session, exc_info=error, extra=fields
                    )
                case SessionDeleted(station, session, why):
                    fields = {"station": station, "session": session}
                    logger.info("%s/%s is deleted: %s", station, session, why, extra=fields)
                case TakeoverFailed(station, session, error):
                    fields = {"station": station, "session": session}
                    logger.error("%s/%s was not rebuilt", station, session, exc_info=error, extra=fields)
                case StationTakenOver(station, epoch, sessions, opened):
                    found = f"{counted(sessions, 'session')}, {opened} of them open"
                    text = "%s is owned by this instance, epoch %d, %s"
                    logger.info(text, station, epoch, found, extra={"station": station})
                case Reply():
                    raise TypeError("an answer without a question")


def _log_key(*given: object) -> str:
    """Return the key of the message among the arguments, or an empty string."""
    for one in given:
        if isinstance(one, SamplesReceived | CommandReceived):
            return one.content.key
        if isinstance(one, BatchesReceived):
            return one.key
    return ""


def _lane_of(arrival: Arrival) -> str:
    """Return the lane in which an arrival was enqueued."""
    match arrival:
        case BatchesReceived(_, _, station):
            return station
        case SamplesReceived(_, station):
            return station or UNKNOWN
        case Unfinished() | LivelinessChanged():
            return arrival.lane
        case RouterLinkChanged() | Watching():
            return NETWORK
        case ReplayFinished(replay):
            return replay.request.station
        case CommandReceived(content):
            return source_of_key(content.key).station or UNKNOWN


def _batch(content: RawPayload) -> SampleBatch | Heartbeat:
    content.check_size()
    expected: tuple[type[SampleBatch | Heartbeat], ...] = (SampleBatch, Heartbeat)
    return decode(content.payload, content.encoding, *expected)


def _command(content: RawPayload) -> Wanted:
    content.check_size()
    return decode(content.payload, content.encoding, Control).command

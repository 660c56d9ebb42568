"""The thread that does the work: takes what arrived, lets the registry decide, says what comes of it.

The inbox says whose turn it is, by how long the work of each station took; here that is measured. What takes
longer than a slice goes on when it is its station's turn again. What is to be done without a message,
as taking stations over, has lanes of its own.

Whatever goes wrong with one arrival ends there: the sender of a command is answered, and the log has it, once
in ten seconds for each station. Time enters the sessions only here.
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
from caesura_protocol.messages import Ack, Control, Heartbeat, SampleBatch
from caesura_protocol.messages import Command as Wanted
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
from caesura_service.server.inbound import (
    UNKNOWN,
    Arrival,
    CommandReceived,
    LivelinessChanged,
    RawPayload,
    ReplayFinished,
    RouterLinkChanged,
    SamplesReceived,
    Unfinished,
    Watching,
    sender_of,
    station_of,
)
from caesura_service.server.rates import COMPLAINTS, SENDERS, RateLimit
from caesura_service.server.result_publisher import ResultPublisher
from caesura_service.server.station_manager import StationManager
from caesura_service.server.work_queue import WHOLE, WorkQueue

logger = logging.getLogger(__name__)
Given = TypeVarTuple("Given")

TICK_S = 0.1  # between two looks at what is still missing
AT_ONCE = 16  # arrivals before a look at everything else, unless there is something else to do
TAKING = "/taking"  # the lane in which stations are taken over; no station's name


class Worker(BackgroundThread):
    """Drains the inbox in a thread of its own while the context lasts."""

    def __init__(
        self,
        registry: Registry,
        steward: StationManager,
        inbox: WorkQueue[Arrival],
        outgoing: ResultPublisher,
        budgets: Budgets,
        clock: Callable[[], float],
    ) -> None:
        self.messages = 0  # taken from the inbox so far
        self._chores: set[str] = set()  # lanes of our own that have a turn coming
        self._news = 0  # of the inbox, as far as statuses have it; and who was pressed then:
        self._pressed = frozenset[str]()
        self._registry = registry
        self._steward = steward
        self._inbox = inbox
        self._outgoing = outgoing
        self._budgets = budgets
        self._refused: set[str] = set()  # stations whose status says that their work is used up
        self._clock = clock
        self._complaints = RateLimit(COMPLAINTS)
        super().__init__("caesura-worker", inbox.wake)

    def _run(self) -> None:
        due = self._clock() + TICK_S
        while not self._stopped.is_set():
            self._look_for_chores()
            self._take_some(AT_ONCE, min(TICK_S, self._steward.patience_s()))
            if self._inbox.news != self._news:
                self._guarded(self._publish_overload)
            if (now := self._clock()) >= due:
                due = now + TICK_S
                self._guarded(self._let, self._registry.tick, now)
        self._registry.slices.stop()

    def _look_for_chores(self) -> None:
        """What there is to do of our own takes its turn like what arrives."""
        for lane, is_due in (
            (TAKING, self._steward.patience_s() <= 0.0),
            (REBUILDING, self._registry.is_rebuilding),
        ):
            if is_due and lane not in self._chores:
                self._chores.add(lane)
                self._inbox.deliver(Unfinished(lane), lane)

    def _take_some(self, most: int, patience_s: float) -> None:
        """Wait for an arrival; take it, and what else is there: so many without a look at all the rest."""
        for _ in range(most):
            if (arrival := self._inbox.get(patience_s)) is None:
                return
            began = time.perf_counter()
            if (lane := self._do_a_slice(arrival)) is not None:
                self._inbox.put_back(Unfinished(lane))
            self._charge(arrival, time.perf_counter() - began)
            if self._chores or not len(self._inbox):
                return

    def _charge(self, arrival: Arrival, took_s: float) -> None:
        """What was done for a station counts for its turn, and for its budget."""
        self._inbox.spent(took_s)
        if isinstance(arrival, SamplesReceived | ReplayFinished | CommandReceived | Unfinished):
            lane = _lane_of(arrival)
            self._budgets.spend(lane, took_s)
            self._registry.record_work(lane, took_s)

    def _do_a_slice(self, arrival: Arrival) -> str | None:
        """Begin with an arrival, or go on; the lane of what is left to do."""
        slices = self._registry.slices
        match arrival:
            case LivelinessChanged() | RouterLinkChanged() | Watching():
                self._guarded(self._steward.receive, arrival)
                return None
            case Unfinished(lane) if lane == TAKING:
                self._guarded(self._let, self._steward.step)
                done = True
            case Unfinished(lane) if lane == REBUILDING and not slices.is_under_way(lane):
                done = slices.begin(lane, partial(self._guarded, self._let, self._registry.rebuild_step))
            case Unfinished(lane):
                done = slices.go_on(lane)
            case _:
                lane = _lane_of(arrival)
                done = slices.begin(lane, partial(self._guarded, self._take, arrival))
        if not done:
            return lane
        self._chores.discard(lane)
        return None

    def _let(self, step: Callable[[*Given], Iterable[Output]], *given: *Given) -> None:
        self.say(step(*given))

    def _publish_overload(self) -> None:
        """Charge what was dropped to its sessions, and let those say so that are pressed, or no longer."""
        self._news = self._inbox.news
        before, self._pressed = self._pressed, self._inbox.pressed
        for source, messages in self._inbox.take_drops().items():
            self.say(self._registry.report_dropped(station_of(source), messages))
            self._publish_budget(station_of(source))
        for source in before ^ self._pressed:
            self.say(self._registry.republish_status(None if source == WHOLE else station_of(source)))

    def _publish_budget(self, station: str) -> None:
        """Where a station's messages are dropped because of its work, its session says so, once."""
        if (refusal := self._budgets.exhausted(station)) is None:
            self._refused.discard(station)
        elif station not in self._refused and len(self._refused) < SENDERS:
            self._refused.add(station)
            self.say(self._registry.reject(station, refusal))

    def _guarded(self, step: Callable[[*Given], None], *given: *Given) -> None:
        try:
            step(*given)
        except Exception:
            if self._complaints.allows(_cause(*given)):
                logger.exception("an arrival was lost to an error of the service")

    def _take(self, arrival: SamplesReceived | ReplayFinished | CommandReceived) -> None:
        self.messages += 1
        match arrival:
            case SamplesReceived(content, station):
                self._take_samples(content, station)
            case ReplayFinished(asked):
                self._outgoing.ended()
                self.say(self._registry.handle_samples(asked.ask.station, asked.ended(), self._clock()))
            case CommandReceived():
                self._take_command(arrival)

    def _take_samples(self, content: RawPayload, station: str | None) -> None:
        try:
            station = station or parse_station_key(content.key)[0]  # which says what is wrong with it
            message = _batch(content)
        except ProtocolError as error:
            logger.debug("refused on %s: %s", content.key, error)
            self.say(self._registry.reject(station, error))
            return
        self.say(self._registry.handle_samples(station, message, self._clock()))

    def _take_command(self, arrival: CommandReceived) -> None:
        try:
            outputs = self._carry_out(arrival.content)
        except Exception as error:
            why = f"not carried out: {type(error).__name__}"
            self._answer(arrival, ProtocolError("internal", why))
            raise
        for output in outputs:
            if isinstance(output, Reply):
                self._answer(arrival, output.reply)
            else:
                self.say([output])

    def _answer(self, arrival: CommandReceived, reply: Ack | ProtocolError) -> None:
        self._outgoing.answer(arrival.query, arrival.content.key, _lane_of(arrival), reply)

    def _carry_out(self, content: RawPayload) -> list[Output]:
        """What comes of a command, with one answer to it."""
        station: str | None = None
        try:
            station = parse_station_key(content.key)[0]
            command = _command(content)
        except ProtocolError as error:
            logger.debug("refused on %s: %s", content.key, error)
            return [Reply(error), *self._registry.reject(station, error)]
        return self._registry.handle_command(station, command, self._clock())

    def say(self, outputs: Iterable[Output]) -> None:
        """Put, ask and log. From another thread only before this one runs."""
        for output in outputs:
            match output:
                case Publish():
                    self._outgoing.publish(output)
                case RequestReplay():
                    self._outgoing.ask(output)
                case BatchRejected(error):
                    logger.debug("refused: %s", error)
                case SessionFailed(station, session, error):
                    fields = {"station": station, "session": session}
                    logger.error(
                        "%s/%s was closed by an error", station, session, exc_info=error, extra=fields
                    )
                case SessionDeleted(station, session, why):
                    fields = {"station": station, "session": session}
                    logger.info("%s/%s is no longer kept: %s", station, session, why, extra=fields)
                case TakeoverFailed(station, session, error):
                    fields = {"station": station, "session": session}
                    logger.error("%s/%s was not rebuilt", station, session, exc_info=error, extra=fields)
                case StationTakenOver(station, epoch, sessions, opened):
                    found = f"{sessions} sessions, {opened} of them open"
                    text = "%s is owned by this instance, epoch %d, %s"
                    logger.info(text, station, epoch, found, extra={"station": station})
                case Reply():
                    raise TypeError("an answer without a question")


def _cause(*given: object) -> str:
    """Whose message was given; empty for what is no message."""
    return next((one.content.key for one in given if isinstance(one, SamplesReceived | CommandReceived)), "")


def _lane_of(arrival: SamplesReceived | ReplayFinished | CommandReceived | Unfinished) -> str:
    """The station whose turn it takes, as it was enqueued."""
    match arrival:
        case Unfinished(lane):
            return lane
        case SamplesReceived(_, station):
            return station or UNKNOWN
        case ReplayFinished(asked):
            return asked.ask.station
        case CommandReceived(content):
            return sender_of(content.key).station or UNKNOWN


def _batch(content: RawPayload) -> SampleBatch | Heartbeat:
    content.check_size()
    expected: tuple[type[SampleBatch | Heartbeat], ...] = (SampleBatch, Heartbeat)
    return decode(content.payload, content.encoding, *expected)


def _command(content: RawPayload) -> Wanted:
    content.check_size()
    return decode(content.payload, content.encoding, Control).command

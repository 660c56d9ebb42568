"""What the service says: results to all readers, questions to bridges, answers to queries.

Puts never wait (DROP): a reader finds a hole by the number and takes a snapshot. One priority a key,
because mixing them would reorder, and one publisher, which sends nothing as long as there is no reader.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from functools import partial

import zenoh

from caesura_protocol.codec import encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.fragments import fragment
from caesura_protocol.keys import ReplayRange, SessionPart, replay_parameters, session_key, station_key
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Message,
    Posterior,
    Program,
    Result,
    Segments,
    SessionStatus,
)
from caesura_protocol.transport.zenoh_transport import encoding_of
from caesura_service.publishing.events import Publish, RequestReplay
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound import (
    Arrival,
    PendingReplay,
    ReplayFinished,
    SamplesReceived,
    content_of,
    content_of_error,
    sources_of,
)
from caesura_service.server.lanes import Lanes
from caesura_service.server.network import QUERY_TIMEOUT_S
from caesura_service.server.work_queue import WorkQueue

logger = logging.getLogger(__name__)

# Questions under way at once. Their answers fit into the inbox together; those of every station after an
# outage would not, and would be asked for again and again.
QUESTIONS = 8
PUBLISHERS = 1024  # declared at once: of 200 sessions that say something

STREAMS: Mapping[type[Result], SessionPart] = {
    Changepoints: "changepoints",
    Segments: "segments",
    Posterior: "posterior",
    SessionStatus: "status",
}


class ResultPublisher:
    """Puts and questions over one zenoh session; used by the worker alone."""

    def __init__(
        self, network: zenoh.Session, inbox: WorkQueue[Arrival], budgets: Budgets, lanes: Lanes
    ) -> None:
        self._network = network
        self._publishers: dict[str, zenoh.Publisher] = {}  # whichever was used last stands last
        self._inbox, self._budgets, self._lanes = inbox, budgets, lanes
        self._under_way = 0
        self._waiting: dict[tuple[str, str], RequestReplay] = {}

    def publish(self, publish: Publish) -> None:
        """Put a result on its key. One that cannot go is logged: the snapshot still has it."""
        message = publish.message
        if isinstance(message, SessionStatus):
            message = with_load(message, self._inbox, self._budgets)
        try:
            put(self._publisher(key_of(message), low=isinstance(message, Posterior)), message)
        except (ProtocolError, zenoh.ZError):
            logger.exception("%s was not published", type(message).__name__)

    def _publisher(self, key: str, *, low: bool) -> zenoh.Publisher:
        publisher = self._publishers.pop(key, None) or publisher_of(self._network, key, low=low)
        self._publishers[key] = publisher
        if len(self._publishers) > PUBLISHERS:
            self._publishers.pop(next(iter(self._publishers))).undeclare()  # type: ignore[no-untyped-call]
        return publisher

    def ask(self, ask: RequestReplay) -> None:
        """Ask a bridge for batches, now or in turn; they and the answer's end arrive in the inbox."""
        self._waiting[ask.station, ask.session] = ask
        self._ask_next()

    def ended(self) -> None:
        """An answer has ended: the next question may go."""
        self._under_way -= 1
        self._ask_next()

    def _ask_next(self) -> None:
        while self._waiting and self._under_way < QUESTIONS:
            ask = self._waiting.pop(next(iter(self._waiting)))
            self._under_way += 1
            if not self._lanes.submit(ask.station, partial(self._ask, ask)):
                self._end(PendingReplay(ask))

    def answer(self, query: zenoh.Query, key: str, station: str, reply: Ack | ProtocolError) -> None:
        """Reply to a command of a station; where too many of its answers wait, its client asks again."""
        if not self._lanes.submit(station, partial(_answered, query, key, reply)):
            query.drop()  # type: ignore[no-untyped-call]

    def _ask(self, ask: RequestReplay) -> None:
        """The robot's side may wait with its answer (BLOCK), in a queue behind live samples (DATA_LOW).

        A question that fails ends: counted as under way for good, it would leave no room for others.
        """
        asked = PendingReplay(ask)
        try:
            self._get(asked, ask)
        except Exception:
            self._end(asked)
            raise

    def _get(self, asked: PendingReplay, ask: RequestReplay) -> None:
        wanted = ReplayRange(ask.first, ask.last, ask.last - ask.first + 1, ask.session)
        selector = f"{station_key(ask.station, 'replay')}?{replay_parameters(wanted)}"
        handler: zenoh.handlers.Callback[zenoh.Reply] = zenoh.handlers.Callback(
            lambda reply: self._take(asked, reply), lambda: self._end(asked), indirect=False
        )
        self._network.get(
            selector,
            handler,
            consolidation=zenoh.ConsolidationMode.NONE,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
            timeout=QUERY_TIMEOUT_S,
        )

    def _take(self, asked: PendingReplay, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            asked.replies += 1
            arrival = SamplesReceived(content_of(reply.ok), asked.ask.station)
            station = asked.ask.station
            size = len(arrival.content.payload)
            has_room = self._budgets.refuse_work(station) is None and self._inbox.offer(
                arrival, station, size, station
            )
            asked.dropped += not has_room
        elif reply.err is not None:
            asked.refusal = content_of_error(reply.err)

    def _end(self, asked: PendingReplay) -> None:
        """Once: of a question that fails Zenoh ends some, and others not."""
        if asked.ends():
            self._inbox.deliver(ReplayFinished(asked), asked.ask.station)


def publisher_of(network: zenoh.Session, key: str, *, low: bool = False) -> zenoh.Publisher:
    """A publisher that never waits. low: what may be late."""
    return network.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.DATA_LOW if low else zenoh.Priority.DATA_HIGH,
    )


def put(publisher: zenoh.Publisher, message: Message) -> None:
    """Put a message. Raises ProtocolError for one that is too large, or ZError."""
    for encoded in fragment(message):
        publisher.put(encoded.payload, encoding=encoding_of(encoded.encoding))


def with_load(status: SessionStatus, inbox: WorkQueue[Arrival], budgets: Budgets) -> SessionStatus:
    """The status of a session with the load that its station causes: overload, and budgets."""
    pressed = inbox.is_pressed(*sources_of(status.station))
    load = {"budgets": budgets.of(status.station), "overloaded": status.overloaded or pressed}
    return status.model_copy(update=load)


def key_of(message: Changepoints | Segments | Posterior | SessionStatus | Program) -> str:
    """Where a result is put."""
    if isinstance(message, Program):
        return station_key(message.station, "program")
    return session_key(message.station, message.session, STREAMS[type(message)])


def _answered(query: zenoh.Query, key: str, reply: Ack | ProtocolError) -> None:
    with query:
        if isinstance(reply, ProtocolError):
            refuse(query, reply)
        else:
            answer(query, key, reply)


def answer(query: zenoh.Query, key: str, message: Message) -> None:
    """Reply to a query on a key of this instance; a message that cannot go is refused instead."""
    try:
        for encoded in fragment(message):
            query.reply(key, encoded.payload, encoding=encoded.encoding)
    except ProtocolError as error:
        refuse(query, error)


def refuse(query: zenoh.Query, error: ProtocolError) -> None:
    """Reply with an error that states the reason."""
    encoded = encode_error(error)
    query.reply_err(encoded.payload, encoding=encoded.encoding)

"""Publishes results, requests replays from bridges and replies to queries.

Publishing never blocks (DROP): a reader detects a gap by the number and queries a snapshot. Each key has one
priority, because several would change the order.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial

from caesura_protocol.codec import Encoded, encode_error
from caesura_protocol.errors import ProtocolError
from caesura_protocol.fragments import fragment
from caesura_protocol.keys import (
    ReplayRange,
    SessionPart,
    replay_parameters,
    requests_nothing_said,
    session_key,
    station_key,
)
from caesura_protocol.messages import (
    Ack,
    Changepoints,
    Hints,
    Message,
    Posterior,
    Program,
    Result,
    Segments,
    SessionStatus,
)
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_protocol.transport.transport_interface import Priority, nothing_found
from caesura_service.publishing.events import Publish, RequestReplay
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound_events import (
    Arrival,
    BatchesReceived,
    PendingReplay,
    RawPayload,
    ReplayFinished,
    SamplesReceived,
    sources_of,
)
from caesura_service.server.key_publishers import KeyPublishers
from caesura_service.server.network_interface import Incoming, Network, NetworkError
from caesura_service.server.replay_reply_collector import ReplayBlocks
from caesura_service.server.station_send_threads import StationSendThreads
from caesura_service.server.work_queue import WorkQueue
from caesura_service.sessions.same_layout_batches import BatchBlock

logger = logging.getLogger(__name__)

# Questions under way at once. Their answers fit into the inbox together; those of every station after an
# outage would not, and would be asked for again and again.
REPLAYS = 8
REPLAYS_OVERLOADED = 1  # while the queue is: their answers take the room of what comes live

FAILED = ProtocolError("internal", "the query failed: the service's log has the reason; try again")

STREAMS: Mapping[type[Result], SessionPart] = {
    Changepoints: "changepoints",
    Segments: "segments",
    Posterior: "posterior",
    Hints: "hints",
    SessionStatus: "status",
}


class ResultPublisher:
    """Publishes and queries over one network session; only the worker calls it."""

    def __init__(
        self,
        network: Network,
        queue: WorkQueue[Arrival],
        budgets: Budgets,
        lanes: StationSendThreads,
        publishers: KeyPublishers,
    ) -> None:
        """lanes: for replies and requests. The publishers have others: no reply waits for a result."""
        self._network = network
        self._publishers = publishers
        self._queue, self._budgets, self._lanes = queue, budgets, lanes
        self._under_way = 0
        self._waiting: dict[tuple[str, str], RequestReplay] = {}

    def publish(self, publish: Publish) -> None:
        """Publish a result on its key. A failure is logged: the snapshot still has the result."""
        message = publish.message
        if isinstance(message, SessionStatus):
            message = with_load(message, self._queue, self._budgets)
        try:
            priority: Priority = "data_low" if isinstance(message, Posterior) else "data_high"
            self._publishers.put(key_of(message), message.station, priority, message)
        except (ProtocolError, NetworkError):
            logger.exception("%s was not published", type(message).__name__)

    def request_replay(self, request: RequestReplay) -> None:
        """Request batches from a bridge, now or once REPLAYS allow it; replies arrive in the queue."""
        self._waiting[request.station, request.session] = request
        self._send_next_request()

    def replay_finished(self) -> None:
        """Count a finished replay and send the next request."""
        self._under_way -= 1
        self._send_next_request()

    def _send_next_request(self) -> None:
        most = REPLAYS_OVERLOADED if self._queue.is_overloaded() else REPLAYS
        while self._waiting and self._under_way < most:
            request = self._waiting.pop(next(iter(self._waiting)))
            self._under_way += 1
            if not self._lanes.submit(request.station, partial(self._send_request, request)):
                self._finish_replay(PendingReplay(request))

    def reply(self, query: IncomingQuery, key: str, station: str, reply: Ack | ProtocolError) -> None:
        """Reply to a command of a station; drop the reply if too many of the station are queued."""
        if not self._lanes.submit(station, partial(_send_reply, query, key, reply)):
            query.drop()

    def _send_request(self, request: RequestReplay) -> None:
        """Query a bridge's ring.

        A query that fails is finished at once, because it otherwise counts as in progress.
        """
        replay = PendingReplay(request)
        try:
            self._get_batches(replay, request)
        except Exception:
            self._finish_replay(replay)
            raise

    def _get_batches(self, replay: PendingReplay, request: RequestReplay) -> None:
        wanted = ReplayRange(request.first, request.last, request.last - request.first + 1, request.session)
        blocks = ReplayBlocks(partial(self._enqueue_reply, replay), partial(self._enqueue_block, replay))
        self._network.request(
            station_key(request.station, "replay"),
            replay_parameters(wanted),
            received=partial(_receive_reply, replay, blocks),
            refused=partial(_receive_refusal, replay),
            ended=partial(self._end_replay, replay, blocks),
        )

    def _enqueue_reply(self, replay: PendingReplay, content: RawPayload) -> None:
        self._enqueue(replay, SamplesReceived(content, replay.request.station), len(content.payload), 1)

    def _enqueue_block(self, replay: PendingReplay, block: BatchBlock) -> None:
        station, count = replay.request.station, len(block.payloads)
        arrival = BatchesReceived(block, station_key(station, "replay"), station)
        self._enqueue(replay, arrival, count * block.layout.size, count)

    def _enqueue(
        self, replay: PendingReplay, arrival: SamplesReceived | BatchesReceived, size: int, count: int
    ) -> None:
        station = replay.request.station
        is_taken = self._budgets.reject_work(station, count) is None and self._queue.offer(
            arrival, station, size, station, count=count
        )
        replay.dropped += 0 if is_taken else count

    def _end_replay(self, replay: PendingReplay, blocks: ReplayBlocks) -> None:
        blocks.end()
        self._finish_replay(replay)

    def _finish_replay(self, replay: PendingReplay) -> None:
        """Enqueue the end of a replay, once: Zenoh ends some of the queries that fail."""
        if replay.end():
            self._queue.put_unbounded(ReplayFinished(replay), replay.request.station)


def with_load(status: SessionStatus, queue: WorkQueue[Arrival], budgets: Budgets) -> SessionStatus:
    """Return the status with its station's overload and budgets."""
    overloaded = queue.is_overloaded(*sources_of(status.station))
    load = {"budgets": budgets.budgets_of(status.station), "overloaded": status.overloaded or overloaded}
    return status.model_copy(update=load)


def key_of(message: Changepoints | Segments | Posterior | Hints | SessionStatus | Program) -> str:
    """Return the key of a result."""
    if isinstance(message, Program):
        return station_key(message.station, "program")
    return session_key(message.station, message.session, STREAMS[type(message)])


def _receive_reply(replay: PendingReplay, blocks: ReplayBlocks, reply: Incoming) -> None:
    replay.replies += 1
    blocks.receive(RawPayload.of(*reply))


def _receive_refusal(replay: PendingReplay, refusal: Encoded) -> None:
    replay.refusal = refusal


def _send_reply(query: IncomingQuery, key: str, reply: Ack | ProtocolError) -> None:
    with query:
        if isinstance(reply, ProtocolError):
            reply_error(query, reply)
        else:
            reply_message(query, key, reply)


def reply_message(query: IncomingQuery, key: str, message: Message) -> bool:
    """Reply to a query on a key of this instance.

    If the message is too large, reply an error and return False.
    """
    try:
        for encoded in fragment(message):
            query.reply(key, encoded)
    except ProtocolError as error:
        reply_error(query, error)
        return False
    return True


def reply_nothing(query: IncomingQuery, instance: str, replies: int = 0) -> None:
    """Reply the number of replies of this instance to a query, 0 if it has no matching content.

    Without it a client cannot distinguish lost replies from missing content. An older client, which does not
    request it, would treat it as an error, and does not get it.
    """
    if requests_nothing_said(query.parameters):
        reply_error(query, nothing_found(instance, replies))


def reply_in_takeover(query: IncomingQuery, station: str, instance: str) -> None:
    """Reply that the station is being taken over, so that its content is not known yet."""
    why = f"{instance} is taking {station} over: ask again"
    reply_error(query, ProtocolError("overloaded", why, value=station))


@contextmanager
def answering(query: IncomingQuery) -> Iterator[None]:
    """End a query with the context; an exception is sent as a refusal, and is raised."""
    with query:
        try:
            yield
        except Exception:
            reply_error(query, FAILED)
            raise


def reply_error(query: IncomingQuery, error: ProtocolError) -> None:
    """Reply with an error that states the reason."""
    query.refuse(encode_error(error))

"""The service on the network: its subscriptions, queryables, and its start and stop.

Every callback only enqueues: a long one would block all reception.

At the start sessions are taken over, then subscribed to, then announced by the token, so that other instances
release only stations that this one has taken over. The stop does this in reverse order, and closes the
network session last: an open one would block the interpreter's exit.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from functools import partial
from types import TracebackType
from typing import Self

from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import service_key, session_key, station_key
from caesura_protocol.messages import ServiceStatus
from caesura_protocol.token_bucket import LOG_RATE, RateLimit
from caesura_protocol.transport.default_endpoint import DEFAULT_ENDPOINT
from caesura_protocol.transport.inbox import IncomingQuery
from caesura_service.decimation import SampleReader
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Owner
from caesura_service.server.batch_collector import BatchCollector
from caesura_service.server.budgets import Budgets
from caesura_service.server.channel_poller import ChannelPoller
from caesura_service.server.held_refusals import HeldRefusals
from caesura_service.server.inbound_events import (
    UNKNOWN,
    Arrival,
    BatchesReceived,
    RawPayload,
    RouterLinkChanged,
    SamplesReceived,
    Watching,
    lane_of_query,
    source_of_key,
)
from caesura_service.server.key_publishers import KeyPublishers, put
from caesura_service.server.live_tokens import SERVICES, TokenChanges, query_live_tokens
from caesura_service.server.muted_sources import MutedSources
from caesura_service.server.network_interface import Incoming, Network, NetworkError
from caesura_service.server.network_join import Join, NetworkSettings, join, lets_in
from caesura_service.server.outbound import ResultPublisher
from caesura_service.server.overload_monitor import OverloadMonitor
from caesura_service.server.query_server import QueryServer, size_refusal
from caesura_service.server.rate_limit_settings import RateLimits
from caesura_service.server.router_link import RouterLink
from caesura_service.server.router_probe import WHY_STUCK, RouterProbe, router_probe
from caesura_service.server.sample_query_server import SampleServer
from caesura_service.server.station_manager import StationManager
from caesura_service.server.station_send_threads import StationSendThreads
from caesura_service.server.station_subscriptions import StationSubscriptions
from caesura_service.server.stored_session_server import LISTING, StoredSessionServer, is_listing
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from caesura_service.server.worker import Worker
from caesura_service.sessions.same_layout_batches import BatchBlock

logger = logging.getLogger(__name__)

NAMED_S = 10.0  # that a start waits for an instance of its name to go: one that hung or lost its power
NAMED_AGAIN_S = 0.2  # between two looks whether it is gone


class ZenohServer:
    """One instance of the service on the network, while the context lasts. Raises NetworkError on entry."""

    def __init__(
        self,
        registry: Registry,
        owner: Owner,
        network: NetworkSettings,
        *,
        version: str,
        samples: SampleReader,
        queue: QueueSettings | None = None,
        rates: RateLimits | None = None,
        clock: Callable[[], float] = time.monotonic,
        stop: threading.Event | None = None,
        join: Join = join,
        journal: AbstractContextManager[object] | None = None,
    ) -> None:
        """samples: reads samples from the journal; stop: set when the process no longer waits for a router.

        journal: opens the journal while the context lasts. A router opens it once it listens, so that a
        refused endpoint leaves no file; a client opens it first, because it may wait long for its router.
        join: joins the network by its settings; `memory_network.in_memory` needs none.
        """
        # Once entered, the real one, with its port.
        self.endpoint = network.connect or network.listen or DEFAULT_ENDPOINT
        self._link = RouterLink(partial(lets_in, network))  # once it has joined
        self._router: RouterProbe | None = None  # of the own router, once it has joined
        self._registry = registry
        self._owner = owner
        self._settings = network
        self._version = version
        self._clock = clock
        self._stop = stop or threading.Event()
        self._join = join
        self._journal = journal or nullcontext()
        self._queue: WorkQueue[Arrival] = WorkQueue(queue or QueueSettings(), announced=True)
        self._worker: Worker | None = None
        rates = rates or RateLimits()
        self.budgets = Budgets(rates)
        self._log_rate = RateLimit(LOG_RATE)
        self._stored = StoredSessionServer(registry.stored, owner.instance)
        self._queries = QueryServer(
            registry, self._queue, self.status, self.budgets, self._stored.enqueue, owner.instance
        )
        self._samples = SampleServer(samples, lambda: registry.index, owner, registry.ownership)
        self._collector = BatchCollector(
            registry.awaited, self._enqueue_samples, self._enqueue_batches, clock
        )
        self._muted, self._muted_commands, self._muted_queries = (MutedSources() for _ in range(3))
        self._held = HeldRefusals()
        self._tokens = TokenChanges(self._queue, self.budgets)
        self._poller = ChannelPoller(self._handle_samples, self._end_poll)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            is_client = self._settings.connect is not None
            if is_client:
                stack.enter_context(self._journal)
            network, self.endpoint = self._join(self._settings, self._stop)
            stack.callback(network.close)
            if not is_client:
                stack.enter_context(self._journal)
            stack.enter_context(self._stored)
            stack.enter_context(self._queries)
            stack.enter_context(self._samples)
            subscriptions = StationSubscriptions(
                network,
                poller=self._poller,
                control=self._handle_command,
                program=partial(self._handle_query, self._queries.program),
                tokens=self._tokens,
            )
            station_manager = StationManager(
                self._registry, self._owner.instance, subscriptions.set, self._clock
            )
            replies, results = (
                stack.enter_context(StationSendThreads()),
                stack.enter_context(StationSendThreads()),
            )
            publisher = ResultPublisher(
                network, self._queue, self.budgets, replies, KeyPublishers(network, results)
            )
            self._worker = Worker(
                self._registry, station_manager, self._queue, publisher, self.budgets, self._clock
            )
            self._await_name(network, NAMED_S)
            self._worker.emit(station_manager.start(query_live_tokens(network)))
            self._declare(stack, network)
            self._worker.emit(self._registry.republish_status(None))
            stack.enter_context(self._worker)
            stack.callback(self._held.end_all)
            stack.enter_context(self._poller)
            stack.callback(self._collector.release_all)
            stack.callback(subscriptions.close)
            self._announce(stack, network)
            if self._settings.connect is None:
                self._router = stack.enter_context(router_probe(network, self._owner.instance))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def router_fault(self) -> str | None:
        """The reason for which clients cannot reach the instance by its router; None if they can."""
        if not self._link.is_up:
            return "the router is gone: trying until it is back"
        return WHY_STUCK if self._router is not None and self._router.is_stuck else None

    def check_link(self, since_s: float) -> None:
        """Raise NetworkError if the router rejects this instance, and accepts other sessions.

        since_s: [s] since the last call.
        """
        if self._router is not None:
            self._router.update(since_s)
        if self._link.is_kept_out():
            raise NetworkError(
                f"{self.endpoint} accepts other sessions and refuses this one: another client has its "
                "Zenoh id, or an old link hangs. Restart this process: it then has a new id"
            )

    def status(self) -> ServiceStatus:
        """Return the status of this instance; any thread may call it."""
        states = self._registry.index.all_states()
        counters = self._registry.counters
        opened = sum(state.is_open for state in states)
        return ServiceStatus(
            instance=self._owner.instance,
            epoch=self._owner.epoch,
            version=self._version,
            sessions_open=opened,
            sessions_closed=len(states) - opened,
            messages=self._worker.messages if self._worker else 0,
            refused=self._queries.add_rejections(counters.refused),
            last_refusal=counters.last_refusal,
            queue=len(self._queue),
            queue_capacity=self._queue.capacity,
            dropped=self._queue.dropped,
            journal=self._registry.journal_report(),
            time=time.time(),
            overloaded=bool(self._queue.overloaded_sources),
            budgets=self.budgets.busiest(),
            queries=self.budgets.queries_of(UNKNOWN),
        )

    def _declare(self, stack: ExitStack, network: Network) -> None:
        """Declare the keys that belong to no station: status, snapshots, the overload monitor."""
        key = service_key(self._owner.instance, "status")
        announced = network.declare_publisher(key, "data_high")
        stack.enter_context(OverloadMonitor(self._queue, lambda: put(announced, self.status())))
        for asked, enqueue in (
            (session_key("*", "*", "snapshot"), self._queries.snapshot),
            (session_key("*", "*", "samples"), self._samples.enqueue),
            (key, self._queries.status),
        ):
            handle = partial(self._handle_query, enqueue)
            stack.callback(self._poller.declare_queryable(network, asked, handle).undeclare)

    def _await_name(self, network: Network, patience_s: float) -> None:
        """Wait until no other instance has the own name.

        Raises NetworkError after patience_s [s], or if the service is stopped.

        Two instances of one name would serve the same stations: each command would be executed twice, and
        every result would be published twice.
        """
        key, end, is_said = service_key(self._owner.instance, "alive"), time.monotonic() + patience_s, False
        while network.list_tokens(key):
            if time.monotonic() >= end:
                raise NetworkError(
                    f"an instance named {self._owner.instance} is at {self.endpoint} already: "
                    "end that one, or give this one a name of its own (--instance)"
                )
            if not is_said:
                is_said = True
                logger.warning("waiting for another instance named %s to go", self._owner.instance)
            if self._stop.wait(NAMED_AGAIN_S):
                raise NetworkError("stopped while another instance had its name")

    def _announce(self, stack: ExitStack, network: Network) -> None:
        """Declare the own token, then watch those of others. Raises NetworkError if the name is in use."""
        self._await_name(network, 0.0)  # once more: the journal may have taken long
        token = network.declare_token(service_key(self._owner.instance, "alive"))
        stack.callback(token.undeclare)
        if self._settings.connect is not None:
            stack.callback(network.watch_link(self._handle_link).undeclare)
        self._tokens.watch(network, SERVICES)
        stack.callback(self._tokens.unwatch, SERVICES)
        self._queue.put_unbounded(Watching())

    def _handle_link(self, up: bool) -> None:
        self._link.report(up)
        if not up:  # at once: the next query may come before the event
            self._registry.ownership.is_unlinked = True
        self._queue.put_unbounded(RouterLinkChanged(up))

    def _handle_command(self, query: IncomingQuery) -> None:
        source, station = source_of_key(query.key)
        if self._muted_commands.drops(source):
            query.drop()
            return
        if station is not None:
            self._collector.release(station_key(station, "samples"))
        if not self._queries.command(query):
            self._muted_commands.mute(source)
            query.drop()

    def _handle_query(
        self, enqueue: Callable[[IncomingQuery, str], ProtocolError | None], query: IncomingQuery
    ) -> None:
        """Enqueue a query on stations within the budget of its lane, or refuse it.

        enqueue: puts it in a queue; returns the refusal if too many of the lane are queued.
        """
        lane = lane_of_query(query.key)
        source, refused_as, end = lane, lane, query.drop
        if is_listing(query):
            source, refused_as, end = lane + LISTING, LISTING, partial(self._held.hold, query)
        if self._muted_queries.drops(source):
            end()
            return
        refusal = self.budgets.reject_query(lane) or size_refusal(query)
        if refusal is None and (refusal := enqueue(query, lane)) is not None:
            self.budgets.count_refused(lane, "queries")
        if refusal is not None and not self._queries.refuse(query, refused_as, refusal):
            self._muted_queries.mute(source)
            end()

    def _handle_samples(self, sample: Incoming) -> None:
        key, payload, encoding = sample
        if self._muted.drops(key):
            return
        if self._collector.hold(key, payload, encoding):
            return
        source, station = source_of_key(key)
        lane = station or UNKNOWN
        if (refusal := self.budgets.reject_put(lane, len(payload))) is not None:
            self._drop(source, refusal.message)
            self._muted.mute(key)
            return
        self._collector.receive(RawPayload.of(key, payload, encoding), source, station)

    def _enqueue_samples(self, content: RawPayload, source: str, station: str | None) -> None:
        self._queue.offer(SamplesReceived(content, station), source, len(content.payload), station or UNKNOWN)

    def _enqueue_batches(self, block: BatchBlock, source: str, station: str) -> None:
        count, size = len(block.payloads), len(block.payloads) * block.layout.size
        if (refusal := self.budgets.reject_put(station, size, count)) is not None:
            self._drop(source, refusal.message, count)
            return
        self._queue.offer(BatchesReceived(block, source, station), source, size, station, count=count)

    def _end_poll(self) -> None:
        """Pass on overdue batches and tokens; count the messages dropped unread."""
        self._collector.release_overdue()
        self._held.end_due()
        self._tokens.poll()
        for key, count in self._muted.pop_drops().items():
            source, station = source_of_key(key)
            self._queue.count_drop(source, count)
            self.budgets.count_refused(station or UNKNOWN, "messages", count)
        for source, count in self._muted_commands.pop_drops().items():
            self.budgets.count_refused(source_of_key(source).station or UNKNOWN, "commands", count)
            self._queries.count_rejected(count)
        for source, count in self._muted_queries.pop_drops().items():
            self.budgets.count_refused(source.removesuffix(LISTING), "queries", count)

    def _drop(self, source: str, why: str, count: int = 1) -> None:
        """Count dropped messages and log them, throttled; the session requests them again."""
        self._queue.count_drop(source, count)
        if self._log_rate.allows(source):
            logger.warning("%s: %s; messages are dropped until then", source, why)

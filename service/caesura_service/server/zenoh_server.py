"""The service on the network: what it listens to, what it answers, and how it leaves.

Every callback of the network only enqueues: one that works would stop all reception. They run directly in
the network's thread, and what was put is gathered before a command: in a thread for each declaration a close
overtook the batches before it in one of six runs, and was refused and repeated.

In the beginning sessions are taken, then declared, then announced by our token, so that others let go only of
what we have. Leaving goes the same way backwards, and closes the network session last: an open one would hang
the interpreter.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import zenoh

from caesura_protocol.keys import service_key, session_key
from caesura_protocol.messages import ServiceStatus
from caesura_protocol.transport.zenoh_transport import direct
from caesura_service.ownership.registry import Registry
from caesura_service.publishing.events import Owner
from caesura_service.server.budgets import Budgets
from caesura_service.server.inbound import UNKNOWN, Arrival, RawPayload, SamplesReceived, Watching, sender_of
from caesura_service.server.lanes import Lanes
from caesura_service.server.live_tokens import watching, who_is_there
from caesura_service.server.network import DEFAULT_ENDPOINT, NetworkSettings, join
from caesura_service.server.overload_monitor import OverloadMonitor
from caesura_service.server.query_server import QueryServer
from caesura_service.server.rates import COMPLAINTS, RateLimit, RateSettings
from caesura_service.server.result_publisher import ResultPublisher, publisher_of, put
from caesura_service.server.station_manager import StationManager
from caesura_service.server.station_subscriptions import StationSubscriptions
from caesura_service.server.subscriber_poller import SubscriberPoller
from caesura_service.server.work_queue import QueueSettings, WorkQueue
from caesura_service.server.worker import Worker

logger = logging.getLogger(__name__)


class ZenohServer:
    """One instance of the service on the network, while the context lasts. Raises NetworkError on entry."""

    def __init__(
        self,
        registry: Registry,
        owner: Owner,
        network: NetworkSettings,
        *,
        version: str,
        queue: QueueSettings | None = None,
        rates: RateSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
        stop: threading.Event | None = None,
    ) -> None:
        """stop: set when the process no longer waits for a router."""
        # Once entered, the real one, with its port.
        self.endpoint = network.connect or network.listen or DEFAULT_ENDPOINT
        self._registry = registry
        self._owner = owner
        self._settings = network
        self._version = version
        self._clock = clock
        self._stop = stop or threading.Event()
        self._inbox: WorkQueue[Arrival] = WorkQueue(queue or QueueSettings(), announced=True)
        self._worker: Worker | None = None
        rates = rates or RateSettings()
        self.budgets = Budgets(rates)
        self._complaints = RateLimit(COMPLAINTS)
        self._answers = QueryServer(registry, self._inbox, self.status, self.budgets, rates.questions)
        self._gathering = SubscriberPoller(self._take_samples)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        network, self.endpoint = join(self._settings, self._stop)
        with ExitStack() as stack:
            stack.callback(network.close)
            stack.enter_context(self._answers)
            scope = StationSubscriptions(
                network,
                samples=self._gathering,
                control=self._take_command,
                program=self._answers.program,
            )
            steward = StationManager(self._registry, self._owner.instance, scope.set, self._clock)
            lanes = stack.enter_context(Lanes())
            outgoing = ResultPublisher(network, self._inbox, self.budgets, lanes)
            self._worker = Worker(self._registry, steward, self._inbox, outgoing, self.budgets, self._clock)
            self._worker.say(steward.begin(who_is_there(network)))
            self._declare(stack, network)
            self._worker.say(self._registry.republish_status(None))
            stack.enter_context(self._worker)
            stack.enter_context(self._gathering)
            stack.callback(scope.close)
            self._appear(stack, network)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def status(self) -> ServiceStatus:
        """How this instance is doing; may be asked from any thread."""
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
            refused=self._answers.with_refusals(counters.refused),
            last_refusal=counters.last_refusal,
            queue=len(self._inbox),
            queue_capacity=self._inbox.capacity,
            dropped=self._inbox.dropped,
            journal=self._registry.journal_report(),
            time=time.time(),
            overloaded=bool(self._inbox.pressed),
            budgets=self.budgets.busiest(),
        )

    def _declare(self, stack: ExitStack, network: zenoh.Session) -> None:
        """What belongs to no station."""
        key = service_key(self._owner.instance, "status")
        announced = publisher_of(network, key)
        stack.enter_context(OverloadMonitor(self._inbox, lambda: put(announced, self.status())))
        for asked, callback in (
            (session_key("*", "*", "snapshot"), self._answers.snapshot),
            (key, self._answers.status),
        ):
            stack.callback(network.declare_queryable(asked, direct(callback)).undeclare)

    def _appear(self, stack: ExitStack, network: zenoh.Session) -> None:
        """Let others know that we are there, then see who comes and goes."""
        token = network.liveliness().declare_token(service_key(self._owner.instance, "alive"))
        stack.callback(token.undeclare)
        client = self._settings.connect is not None
        stack.enter_context(watching(network, self._inbox.insist, client=client))
        self._inbox.deliver(Watching())

    def _take_command(self, query: zenoh.Query) -> None:
        self._gathering.gather()  # what was put before it comes before it
        self._answers.command(query)

    def _take_samples(self, sample: zenoh.Sample) -> None:
        key, payload = str(sample.key_expr), sample.payload
        source, station = sender_of(key)
        lane = station or UNKNOWN
        if (refusal := self.budgets.refuse_put(lane, len(payload))) is not None:
            self._turn_away(source, refusal.message)
            return
        content = RawPayload.of(key, payload, str(sample.encoding))
        self._inbox.offer(SamplesReceived(content, station), source, len(content.payload), lane)

    def _turn_away(self, source: str, why: str) -> None:
        """Dropped like what finds no room: counted, in the session's status, and asked for again."""
        self._inbox.turn_away(source)
        if self._complaints.allows(source):
            logger.warning("%s: %s; messages are dropped until then", source, why)

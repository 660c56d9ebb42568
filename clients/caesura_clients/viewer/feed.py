"""Follows one station and passes its messages to a viewer: a thread for samples and one for results.

A sink returns at once and drops what it cannot send, so a slow or absent viewer does not delay the feed.
Samples that the network dropped are read from the service's journal, and published before later samples.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Protocol

from caesura_clients.query import current_sessions
from caesura_clients.repeating_threads import RepeatingThreads
from caesura_clients.session_follower import SessionRemoved, events
from caesura_clients.session_state_reader import Update
from caesura_clients.viewer.live_mcap_messages import LiveMessage, LiveStation
from caesura_clients.viewer.missing_samples import MissingSamples, MissingSpan
from caesura_protocol.codec import decode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Heartbeat, SampleBatch
from caesura_protocol.transport.inbox import Inbox, ReceivedSample
from caesura_protocol.transport.transport_interface import Transport

TICK_S = 0.1  # how soon a new subscription is served, and how soon a thread sees that it is over
REFRESH_S = 2.0
LOG = logging.getLogger(__name__)


class Sink(Protocol):
    """Destination of live messages. No method blocks."""

    def publish(self, message: LiveMessage) -> None:
        """Send a message to every viewer that has subscribed to its topic."""

    def state(self, session: str, missing: int) -> None:
        """Show the current session, and the number of its batches that were not received."""


class StationFeed(RepeatingThreads):
    """Feeds a sink while its context lasts. transport: is closed by its owner, after the feed."""

    def __init__(
        self,
        transport: Transport,
        station: str,
        sink: Sink,
        *,
        refresh_s: float = REFRESH_S,
        time_of_day: Callable[[], float] = time.time,
    ) -> None:
        self._transport = transport
        self._station = station
        self._sink = sink
        self._refresh_s = refresh_s
        self._time_of_day = time_of_day
        self._messages = LiveStation()
        self._shown: tuple[str, int] | None = None
        self._messages_lock = threading.Lock()
        self._follows = threading.Event()
        self._subscribed: queue.SimpleQueue[str] = queue.SimpleQueue()
        works = {"samples": self._follow_samples, "results": self._follow_results}
        super().__init__(works, on_error=self._log_error)
        self._missing_samples = MissingSamples(transport, station, self._over)

    def wait_until_following(self, timeout_s: float) -> bool:
        """Wait until the feed has subscribed to the samples; return False after `timeout_s`."""
        return self._follows.wait(timeout_s)

    def subscribed(self, topic: str) -> None:
        """Publish the current content of a topic again for a new subscriber. Returns at once."""
        self._subscribed.put(topic)

    def _log_error(self, name: str, why: str) -> None:
        LOG.warning("%s: %s: %s; trying again", self._station, name, why)

    def _follow_samples(self) -> None:
        inbox = Inbox()
        with self._transport.subscribe(station_key(self._station, "samples"), inbox):
            self._follows.set()
            while not self._over.is_set():
                item = inbox.get(TICK_S)
                self._serve_new_viewers()
                if isinstance(item, ReceivedSample):
                    self._receive(item)
                else:
                    self._read_end()

    def _receive(self, delivery: ReceivedSample) -> None:
        """Publish a batch; an invalid one is dropped and the feed goes on."""
        try:
            batch = decode(delivery.payload, delivery.encoding, SampleBatch, Heartbeat)
        except ProtocolError:
            return
        if not isinstance(batch, SampleBatch):
            return
        now_s = self._time_of_day()
        with self._messages_lock:
            hole = self._messages.hole_before(batch)
        self._recover(hole, now_s)
        with self._messages_lock:
            self._publish(self._messages.sampled(batch, now_s))

    def _read_end(self) -> None:
        """Publish the last samples of a closed session if the network dropped them."""
        with self._messages_lock:
            end = self._messages.unreceived_end()
        self._recover(end, self._time_of_day())

    def _recover(self, span: MissingSpan | None, now_s: float) -> None:
        """Publish the journal's samples of a gap. Samples received meanwhile wait in the inbox."""
        rows = None if span is None else self._missing_samples.read(span)
        if span is not None and rows is not None:
            with self._messages_lock:
                self._publish(self._messages.recovered(span, rows, now_s))

    def _follow_results(self) -> None:
        if (session := current_sessions(self._transport).get(self._station)) is not None:
            with self._messages_lock:
                self._messages.show(session)
        found = events(self._transport, self._station, refresh_s=self._refresh_s, over=self._over)
        with closing(found):
            for event in found:
                with self._messages_lock:
                    if isinstance(event, Update):
                        self._publish(self._messages.updated(event, self._time_of_day()))
                    elif isinstance(event, SessionRemoved):
                        self._messages.removed(event.session)

    def _serve_new_viewers(self) -> None:
        topics: set[str] = set()
        while not self._subscribed.empty():
            topics.add(self._subscribed.get())
        if topics:
            with self._messages_lock:
                live, self._shown = self._messages.live, None
                self._publish([] if live is None else live.current(sorted(topics)))

    def _publish(self, messages: Sequence[LiveMessage]) -> None:
        live = self._messages.live
        if live is not None and self._shown != (live.name, live.missing):
            self._shown = (live.name, live.missing)
            self._sink.state(*self._shown)
        for message in messages:
            self._sink.publish(message)

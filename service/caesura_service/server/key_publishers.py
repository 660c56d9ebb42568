"""Publishes on the keys of results in order, and never blocks its caller.

Zenoh matches a key with what clients have declared when its publisher is declared, or at each message without
one. A client can make that take arbitrarily long (docs/security.md), and in a declared publisher it does not
happen again. So the caller itself puts only by declared publishers. Until one is declared, in a separate
thread, the messages of its key are put in the lane of their station.
"""

from __future__ import annotations

from functools import partial

from caesura_protocol.fragments import fragment
from caesura_protocol.messages import Message
from caesura_protocol.transport.transport_interface import Priority
from caesura_service.server.network_interface import Network, Publisher
from caesura_service.server.station_send_threads import StationSendThreads

PUBLISHERS = 1024  # declared at once, those of 200 sessions
DECLARING = "/declaring"  # the lane of declarations; no station's name


class KeyPublishers:
    """The publishers of keys, the last used ones; only one thread may call it."""

    def __init__(self, network: Network, lanes: StationSendThreads) -> None:
        """lanes: for declarations, and for messages of keys that are not declared yet."""
        self._network, self._lanes = network, lanes
        self._publishers: dict[str, _KeyPublisher] = {}  # whichever was used last stands last

    def put(self, key: str, station: str, priority: Priority, message: Message) -> None:
        """Put a message on a key of a station, or enqueue it; drop it if too many of the station are queued.

        Raises ProtocolError for one that is too large, or NetworkError.
        """
        publisher = self._publishers.pop(key, None) or self._new(key, station, priority)
        self._publishers[key] = publisher
        publisher.put(message)

    def _new(self, key: str, station: str, priority: Priority) -> _KeyPublisher:
        """Make a publisher; beyond PUBLISHERS the one that was used longest ago is let go.

        If too many declarations are queued, one more stays. It is not declared then, so it can go next time.
        """
        if len(self._publishers) >= PUBLISHERS:
            free = next((one for one, publisher in self._publishers.items() if publisher.close()), None)
            self._publishers.pop(free or "", None)
        return _KeyPublisher(self._network, self._lanes, key, station, priority)


class _KeyPublisher:
    """Publishes on one key."""

    def __init__(
        self, network: Network, lanes: StationSendThreads, key: str, station: str, priority: Priority
    ) -> None:
        self._network, self._lanes = network, lanes
        self._key, self._station, self._priority = key, station, priority
        self._declared: Publisher | None = None
        self._is_requested = False  # the declaration
        self._enqueued = 0  # messages in the lane of the station, of which were put:
        self._finished = 0

    def put(self, message: Message) -> None:
        """Put a message by the declared publisher once no earlier one is queued; enqueue it otherwise."""
        if self._declared is not None and self._finished == self._enqueued:
            put(self._declared, message)
            return
        self._is_requested = self._is_requested or self._lanes.submit(DECLARING, self._declare)
        if self._lanes.submit(self._station, partial(self._put_in_lane, message)):
            self._enqueued += 1

    def close(self) -> bool:
        """End the declaration, in its lane; return False if too many are queued."""
        return not self._is_requested or self._lanes.submit(DECLARING, self._undeclare)

    def _declare(self) -> None:
        self._declared = self._network.declare_publisher(self._key, self._priority)

    def _undeclare(self) -> None:
        if self._declared is not None:
            self._declared.undeclare()

    def _put_in_lane(self, message: Message) -> None:
        try:
            for encoded in fragment(message):
                self._network.put(self._key, encoded, self._priority)
        finally:
            self._finished += 1


def put(publisher: Publisher, message: Message) -> None:
    """Put a message. Raises ProtocolError for one that is too large, or NetworkError."""
    for encoded in fragment(message):
        publisher.put(encoded)

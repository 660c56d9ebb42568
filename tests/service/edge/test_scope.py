"""How the network's threads call us."""

from __future__ import annotations

import threading
from queue import SimpleQueue

from caesura_service.edge.network import NetworkSettings, join
from caesura_service.edge.scope import direct
from harness.peer import DEADLINE_S, Peer

KEY, CALLS = "some/key", 200  # more than there are threads


def test_a_thread_of_the_network_keeps_its_state_from_call_to_call():
    kept = threading.local()
    counts: SimpleQueue[int] = SimpleQueue()

    def called(_: object) -> None:
        kept.calls = getattr(kept, "calls", 0) + 1
        counts.put(kept.calls)

    network, endpoint = join(NetworkSettings("tcp/127.0.0.1:0"), threading.Event())
    with network, Peer(endpoint) as peer:
        subscriber = network.declare_subscriber(KEY, direct(called))
        for _ in range(CALLS):
            peer.put(KEY, b"", "zenoh/bytes")
        assert max(counts.get(timeout=DEADLINE_S) for _ in range(CALLS)) > 1
        subscriber.undeclare()

"""Whether the service is alive, and can be reached: the answers to probes, and the reasons.

Alive: its process answers, and the thread that does the work comes round. A replay at the start is no reason
to kill it, so before it is ready it counts as alive. Ready: joined, declared, and not on its way out.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from caesura_service.monitoring.http_server import Health, HttpServer
from caesura_service.monitoring.metrics import MetricsSource, metrics_of

# Far past what one arrival can take: a station that is taken over is replayed in a fifteenth of its time, and
# this is more than an hour of it. A restart at this age loses less than waiting on.
STUCK_S = 300.0


def alive(observed: MetricsSource, clock: Callable[[], float] = time.monotonic) -> Health:
    """Not alive: whatever is wrong, a restart is the remedy."""
    since_s = clock() - observed.registry.counting.turned
    if observed.is_ready() and since_s > STUCK_S:
        return Health(False, f"the worker has not come round for {since_s:.0f} s, limit {STUCK_S:.0f} s")
    return Health(True)


def ready(observed: MetricsSource) -> Health:
    """Not ready: wait, or look into the log."""
    if observed.is_ready():
        return Health(True)
    return Health(False, "not joined: replaying its journal, waiting for a router, or leaving")


def web_of(address: str, observed: MetricsSource) -> HttpServer:
    """What is served about a service."""
    return HttpServer(
        address,
        metrics_of(observed),
        alive=lambda: alive(observed),
        ready=lambda: ready(observed),
    )

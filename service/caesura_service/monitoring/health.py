"""Answers of the probes: whether the service is alive and ready, with the reasons.

Alive: the process answers, and the worker thread completes its loop. A replay at the start must not lead to a
restart, so the service counts as alive until it is ready. Ready: it has joined the network, has declared its
keys, is not shutting down, and its router works: there is a link to it, and it accepts declarations.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from caesura_service.monitoring.http_server import Health, HttpServer
from caesura_service.monitoring.metrics import MetricsSource, metrics_of

# Far past what one arrival can take: a station that is taken over is replayed in a fiftieth of its time, and
# this is more than an hour of it. A restart at this age loses less than waiting on.
STUCK_AFTER_S = 300.0


def liveness(source: MetricsSource, clock: Callable[[], float] = time.monotonic) -> Health:
    """Return whether the service is alive; if not, a restart is the remedy."""
    since_s = clock() - source.registry.station_counters.stepped_s
    if source.is_ready() and since_s > STUCK_AFTER_S:
        return Health(
            False, f"the worker has not come round for {since_s:.0f} s, limit {STUCK_AFTER_S:.0f} s"
        )
    return Health(True)


def readiness(source: MetricsSource) -> Health:
    """Return whether the service has joined the network."""
    if not source.is_ready():
        return Health(False, "not joined: replaying its journal, waiting for a router, or leaving")
    fault = source.router_fault()
    return Health(True) if fault is None else Health(False, fault)


def http_server_of(address: str, source: MetricsSource) -> HttpServer:
    """Make the HTTP server of metrics and probes."""
    return HttpServer(
        address,
        metrics_of(source),
        alive=lambda: liveness(source),
        ready=lambda: readiness(source),
    )

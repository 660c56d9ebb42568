"""Lines about a service that goes and comes back, and about a router that cannot be reached."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import typer

from caesura_clients.service_liveliness import Change

SAID_OF_SERVICE: Mapping[Change, str] = {"gone": "service gone, waiting", "there": "service back"}
ROUTER_GONE = "router not reachable, waiting"
LINK_S, LOOK_S = 0.5, 0.05  # tokens disappear up to LINK_S before Zenoh reports the end of their link


def availability_text(change: Change, has_router: Callable[[], bool] | None = None) -> str:
    """Return a change of the service's availability as text.

    has_router: returns whether the link to the router is up; None: not checked. It takes up to LINK_S.
    """
    if change == "there" or has_router is None:
        return SAID_OF_SERVICE[change]
    deadline = time.monotonic() + LINK_S
    while has_router():
        if time.monotonic() >= deadline:
            return SAID_OF_SERVICE[change]
        time.sleep(LOOK_S)
    return ROUTER_GONE


class AvailabilityLines:
    """Prints each time that the service is gone, and that it is back; not that it was there before."""

    def __init__(self, has_router: Callable[[], bool] | None = None) -> None:
        self.is_gone = False
        self._has_router = has_router

    def __call__(self, change: Change) -> None:
        """Print a change."""
        if change == "gone" or self.is_gone:
            typer.echo(availability_text(change, self._has_router), err=True)
        self.is_gone = change == "gone"

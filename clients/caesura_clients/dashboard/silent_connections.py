"""Bounds the connections that have asked nothing: uvicorn waits for each of them without an end.

A silent connection holds a file of the process. As many of them as it may open kept every visitor out, also
of a dashboard with a password. Beyond MOST_SILENT the one that is silent for longest is closed: a browser
asks at once.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

MOST_SILENT = 64

_silent: dict[BoundedProtocol, asyncio.Transport] = {}  # the one that is silent for longest stands first


class BoundedProtocol(AutoHTTPProtocol):  # type: ignore[misc, valid-type]  # chosen at run time
    """The HTTP protocol of uvicorn, of which at most MOST_SILENT connections wait for a first request."""

    def connection_made(self, transport: Any) -> None:
        """Count a connection; close the ones that are silent for longest beyond MOST_SILENT."""
        super().connection_made(transport)
        _silent[self] = transport
        if len(_silent) > MOST_SILENT:
            _forget_those_who_asked()
        while len(_silent) > MOST_SILENT:
            oldest = next(iter(_silent))
            _silent.pop(oldest).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Count it no longer."""
        _silent.pop(self, None)
        super().connection_lost(exc)


def _forget_those_who_asked() -> None:
    for one, transport in list(_silent.items()):
        is_upgraded = transport.get_protocol() is not one  # to a websocket
        if one.cycle is not None or is_upgraded or transport.is_closing():
            del _silent[one]

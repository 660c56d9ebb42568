"""Bounds the number of connections without a request, because uvicorn sets no timeout for them.

A silent connection occupies a file descriptor. If they occupied all of them, no visitor could connect, also
to a dashboard with a password. Beyond MOST_SILENT the connection that has been silent the longest is closed.
A browser is not affected: it sends its request at once.
"""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

MOST_SILENT = 64

_silent: dict[BoundedProtocol, asyncio.Transport] = {}  # the one that is silent for longest stands first


class BoundedProtocol(AutoHTTPProtocol):  # type: ignore[misc, valid-type]  # chosen at run time
    """uvicorn's HTTP protocol, with at most MOST_SILENT connections that wait for a first request."""

    def connection_made(self, transport: Any) -> None:
        """Count a connection; beyond MOST_SILENT close those that have been silent the longest."""
        super().connection_made(transport)
        _silent[self] = transport
        if len(_silent) > MOST_SILENT:
            _forget_those_who_asked()
        while len(_silent) > MOST_SILENT:
            oldest = next(iter(_silent))
            _silent.pop(oldest).abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop counting a connection."""
        _silent.pop(self, None)
        super().connection_lost(exc)


def _forget_those_who_asked() -> None:
    for one, transport in list(_silent.items()):
        is_upgraded = transport.get_protocol() is not one  # to a websocket
        if one.cycle is not None or is_upgraded or transport.is_closing():
            del _silent[one]

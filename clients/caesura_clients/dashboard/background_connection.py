"""Connects to the router in the background, so that pages are served before the service runs."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Self

import typer

from caesura_clients.client import connect
from caesura_protocol.codec import Encoded
from caesura_protocol.errors import AccessDenied, CaesuraError, Unreachable
from caesura_protocol.transport.inbox import Inbox
from caesura_protocol.transport.transport_interface import (
    QUERY_TIMEOUT_S,
    Priority,
    QueryReplies,
    Transport,
)

ATTEMPT_S = 1.0
RETRY_S = 0.5  # from one attempt to the next
REMEDY = "Start it with 'caesura serve', or name its router with --connect. This page connects by itself."


class BackgroundConnection:
    """A transport that is not connected at first, and then is the one that a thread has opened.

    Until then each method raises Unreachable with the reason. Raises AccessDenied, or CaesuraError if the
    endpoint or the file is invalid: waiting does not help there. Arguments as `connect`.
    """

    def __init__(self, endpoint: str | None, config_file: Path | None) -> None:
        self._options = endpoint, config_file
        self._transport: Transport | None = None
        self._why = ""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._connect, name="connect", daemon=True)
        try:
            self._attempt()
        except AccessDenied:
            raise
        except Unreachable:
            typer.echo(f"waiting: {self._why}", err=True)
            self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def why_unconnected(self) -> str:
        """Return why there is no connection yet, and what to do; empty once there is one."""
        return "" if self._transport is not None else f"{self._why} {REMEDY}"

    def _connect(self) -> None:
        while self._transport is None and not self._over.wait(RETRY_S):
            try:
                self._attempt()
            except CaesuraError:
                continue  # `_why` states it

    def _attempt(self) -> None:
        endpoint, config_file = self._options
        try:
            self._transport = connect(endpoint, config_file=config_file, timeout_s=ATTEMPT_S).transport
        except CaesuraError as error:
            self._why = f"{error}".replace(f" for {ATTEMPT_S:g} s", "")
            raise

    @property
    def _opened(self) -> Transport:
        if self._transport is None:
            raise Unreachable(self._why)
        return self._transport

    @property
    def endpoint(self) -> str:
        """The connected endpoint, as named in errors."""
        return self._opened.endpoint

    @property
    def has_router(self) -> bool:
        """Whether the link to the router is up."""
        return self._transport is not None and self._transport.has_router

    def close(self) -> None:
        """Leave the network, and end the attempts."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._transport is not None:
            self._transport.close()

    def put(self, key: str, content: Encoded, *, priority: Priority = "data") -> None:
        """Publish without blocking."""
        self._opened.put(key, content, priority=priority)

    def query(
        self,
        key: str,
        content: Encoded | None = None,
        *,
        parameters: str = "",
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> QueryReplies:
        """Query the key; wait for every answer or the timeout."""
        return self._opened.query(key, content, parameters=parameters, timeout_s=timeout_s)

    def list_tokens(self, key: str) -> tuple[str, ...]:
        """Return the keys of the liveliness tokens that exist now, sorted."""
        return self._opened.list_tokens(key)

    def subscribe(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue a ReceivedSample for every message on the key."""
        return self._opened.subscribe(key, inbox)

    def declare_queryable(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue an IncomingQuery for every query on the key."""
        return self._opened.declare_queryable(key, inbox)

    def declare_token(self, key: str) -> AbstractContextManager[None]:
        """Declare a liveliness token on the key."""
        return self._opened.declare_token(key)

    def watch_liveliness(self, key: str, inbox: Inbox) -> AbstractContextManager[None]:
        """Enqueue a TokenChange for every token that exists, appears or disappears."""
        return self._opened.watch_liveliness(key, inbox)

"""The HTTP server: /metrics for Prometheus, /healthz and /readyz for a supervisor.

It is read-only: it serves names of stations and counts, never samples, results or commands, and uses only the
path of a request. So it needs no credentials and may listen on any address; it is off by default.

Other clients cannot block a probe. At most CONNECTIONS are open, none for longer than TIMEOUT_S. If all are
used, a new connection replaces the oldest one of the address with the most connections. So other addresses
cannot evict a probe, and on a shared address a probe is the newest. /healthz and /readyz do not wait for a
scrape: at most SCRAPES are in progress, one at a time does work, and a further one gets 503.
"""

from __future__ import annotations

import socket
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, NamedTuple, Self

from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder

CONNECTIONS = 64
SCRAPES = 4
TIMEOUT_S = 5.0
PLAIN = "text/plain; charset=utf-8"
_POLL_S = 0.05  # how soon it ends when it is asked to


class WebError(Exception):
    """The address is invalid or cannot be listened on."""


class Health(NamedTuple):
    """The result of a probe with its reason."""

    healthy: bool
    reason: str = "ok"


class HttpResponse(NamedTuple):
    """Status, content type and body of a response."""

    status: int
    content_type: str
    body: bytes


class HttpServer:
    """Serves while the context lasts, also while sessions are replayed at the start.

    address: `host:port`, port 0 for a free one. Raises WebError.
    """

    def __init__(
        self,
        address: str,
        registry: CollectorRegistry,
        *,
        alive: Callable[[], Health],
        ready: Callable[[], Health],
    ) -> None:
        self._where = parse_address(address)
        self._registry = registry
        self._scrapes = threading.BoundedSemaphore(SCRAPES)
        self._rendering = threading.Lock()
        self._pages: Mapping[str, Callable[[str], HttpResponse]] = {
            "/metrics": self._metrics,
            "/healthz": lambda _: _page_of(alive()),
            "/readyz": lambda _: _page_of(ready()),
        }

    def __enter__(self) -> Self:
        try:
            self._server = _Server(self._where, _handler(self._page))
        except OSError as error:
            host, port = self._where
            raise WebError(f"metrics at {host}:{port}: {error.strerror or error}; choose another") from error
        run = threading.Thread(
            target=self._server.serve_forever, args=(_POLL_S,), name="caesura-web", daemon=True
        )
        run.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        self._server.server_close()

    @property
    def url(self) -> str:
        """The URL, with its real port."""
        host, port = self._server.server_address[:2]
        name = host.decode() if isinstance(host, bytes) else str(host)
        return f"http://[{name}]:{port}" if ":" in name else f"http://{name}:{port}"

    def _page(self, path: str, accept: str) -> HttpResponse:
        page = self._pages.get(path.partition("?")[0])
        if page is None:
            return HttpResponse(404, PLAIN, f"known: {', '.join(self._pages)}\n".encode())
        return page(accept)

    def _metrics(self, accept: str) -> HttpResponse:
        if not self._scrapes.acquire(blocking=False):
            return HttpResponse(
                503, PLAIN, f"{SCRAPES} scrapes are under way, which is the limit: retry\n".encode()
            )
        try:
            encoder, content_type = choose_encoder(accept)
            with self._rendering:
                return HttpResponse(200, content_type, encoder(self._registry))
        finally:
            self._scrapes.release()


def parse_address(address: str) -> tuple[str, int]:
    """Parse `host:port`. Raises WebError.

    >>> parse_address("[::1]:9464")
    ('::1', 9464)
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise WebError(f"metrics at {address!r}: expected HOST:PORT, for example 127.0.0.1:9464")
    return host.strip("[]"), int(port)


def _shut_down(request: socket.socket) -> None:
    with suppress(OSError):
        request.shutdown(socket.SHUT_RDWR)


class ConnectionSlots:
    """The open connections, at most `capacity`; beyond that the oldest of the busiest peer is closed.

    Any thread may use it.
    """

    def __init__(self, capacity: int = CONNECTIONS) -> None:
        self._capacity = capacity
        self._peers: dict[socket.socket, str] = {}  # oldest first
        self._lock = threading.Lock()

    def admit(self, request: socket.socket, peer: str) -> None:
        """Admit a connection. At the capacity, close the oldest one of the peer that has the most."""
        with self._lock:
            if len(self._peers) >= self._capacity:
                held = Counter(self._peers.values())
                most = max(held.values())
                evicted = next(one for one, of in self._peers.items() if held[of] == most)
                del self._peers[evicted]
                _shut_down(evicted)
            self._peers[request] = peer

    def release(self, request: socket.socket) -> None:
        """Release the place of a finished or evicted connection."""
        with self._lock:
            self._peers.pop(request, None)


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 2 * CONNECTIONS  # with the usual 5, a burst of callers delays a probe by a second

    def __init__(self, where: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        self._slots = ConnectionSlots()
        super().__init__(where, handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        self._slots.admit(request, client_address[0])
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        late = threading.Timer(TIMEOUT_S, _shut_down, (request,))
        late.daemon = True
        late.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            late.cancel()
            self._slots.release(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore errors of a connection: a client that closes it is no event."""


def _handler(page: Callable[[str, str], HttpResponse]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = TIMEOUT_S
        server_version = "caesura"
        sys_version = ""

        def do_GET(self) -> None:
            self._answer(with_body=True)

        def do_HEAD(self) -> None:
            self._answer(with_body=False)

        def _answer(self, *, with_body: bool) -> None:
            status, content_type, body = page(self.path, self.headers.get("Accept", ""))
            self.send_response(status)
            self.send_header("Content-Type", content_type)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if with_body:
                self.wfile.write(body)

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - its base's name
            """Log nothing: probes come every few seconds."""

    return Handler


def _page_of(health: Health) -> HttpResponse:
    return HttpResponse(200 if health.healthy else 503, PLAIN, f"{health.reason}\n".encode())

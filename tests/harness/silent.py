"""Connections that come to nothing: silent ones, and ones that hang up, as of a scanner or an attacker."""

from __future__ import annotations

import selectors
import socket
import ssl
import threading
from contextlib import suppress

CONNECT_S = 5.0


class Silent:
    """So many silent connections to a port of this machine; one that is closed comes again at once.

    source: the address of this machine that they come from. tls: first they finish a handshake, without a
    certificate.
    """

    def __init__(self, port: int, count: int, *, source: str = "127.0.0.1", tls: bool = False) -> None:
        self.closed = 0  # by the other end
        self._port, self._count, self._source, self._tls = port, count, source, tls
        self._ends: list[socket.socket] = []
        self._over, self._wake = socket.socketpair()
        self._thread = threading.Thread(target=self._stay, name="silent", daemon=True)

    def __enter__(self) -> Silent:
        for _ in range(self._count):
            with suppress(OSError):  # a firewall may refuse it
                self._open()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._wake.close()
        self._thread.join()
        for end in (*self._ends, self._over):
            end.close()

    def _open(self) -> socket.socket:
        end = socket.create_connection(("127.0.0.1", self._port), CONNECT_S, (self._source, 0))
        self._ends.append(end)
        if self._tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
            context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
            with suppress(OSError):
                self._ends[-1] = end = context.wrap_socket(end)
        end.setblocking(False)
        return end

    def _stay(self) -> None:
        with selectors.DefaultSelector() as ready:
            for one in (*self._ends, self._over):
                ready.register(one, selectors.EVENT_READ)
            while True:
                for key, _ in ready.select():
                    end = key.fileobj
                    if end is self._over:
                        return
                    assert isinstance(end, socket.socket)
                    if _is_open(end):
                        continue
                    self.closed += 1
                    ready.unregister(end)
                    self._ends.remove(end)
                    end.close()
                    with suppress(OSError):
                        ready.register(self._open(), selectors.EVENT_READ)


def _is_open(end: socket.socket) -> bool:
    """Take what the other end said; False where it has closed."""
    try:
        return bool(end.recv(65536))
    except (BlockingIOError, ssl.SSLWantReadError):
        return True
    except OSError:
        return False


def client_hello() -> bytes:
    """How a TLS client begins."""
    said = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        ssl.create_default_context().wrap_bio(
            ssl.MemoryBIO(), said, server_hostname="localhost"
        ).do_handshake()
    return said.read()


class HangUps:
    """So many connections a second, from one address of this machine, that say something and hang up."""

    def __init__(self, port: int, per_s: float, said: bytes = b"", *, source: str = "127.0.0.1") -> None:
        self.done = 0
        self._port, self._pause_s, self._said, self._source = port, 1.0 / per_s, said, source
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._go_on, name="hang-ups", daemon=True)

    def __enter__(self) -> HangUps:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _go_on(self) -> None:
        while not self._over.wait(self._pause_s):
            with suppress(OSError), socket.socket() as end:
                end.settimeout(1.0)
                end.bind((self._source, 0))
                end.connect(("127.0.0.1", self._port))
                end.sendall(self._said)
            self.done += 1

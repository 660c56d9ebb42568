"""Robotiq's URCap as far as reading goes: GET POS, STA and FLT over TCP, on a free port of the loopback."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

Answer = Callable[[str, int], bytes | None]  # of a variable and its value; None: none is sent


def whole_line(variable: str, value: int) -> bytes:
    return f"{variable} {value}\n".encode()


class FakeUrcap:
    """Answers each line that it receives; what it answers may be changed at any time."""

    def __init__(self, position: int = 3, status: int = 3) -> None:
        self.values = {"POS": position, "STA": status, "FLT": 0}
        self.answer: Answer = whole_line
        self.in_fragments = False  # a byte each
        self.asked: list[str] = []
        self._listener: socket.socket | None = None
        self._clients: set[socket.socket] = set()
        self._threads: list[threading.Thread] = []
        self._accepting: threading.Thread | None = None
        self._lock = threading.Lock()
        self.port = 0
        self.open()

    def open(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._accepting = self._begin(self._accept, self._listener)

    def close(self) -> None:
        """Refuse connections, and close those that there are."""
        assert self._listener is not None
        assert self._accepting is not None
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._accepting.join()
        self.cut()
        for thread in self._threads:
            thread.join()

    def cut(self) -> None:
        """Close the connections that there are."""
        with self._lock:
            for client in self._clients:
                with suppress(OSError):
                    client.shutdown(socket.SHUT_RDWR)

    @property
    def clients(self) -> int:
        with self._lock:
            return len(self._clients)

    def count(self, variable: str) -> int:
        return self.asked.count(variable)

    def _begin(self, target: Callable[[socket.socket], None], of: socket.socket) -> threading.Thread:
        thread = threading.Thread(target=target, args=(of,), name="fake urcap", daemon=True)
        self._threads.append(thread)
        thread.start()
        return thread

    def _accept(self, listener: socket.socket) -> None:
        with suppress(OSError):
            while True:
                client, _ = listener.accept()
                with self._lock:
                    self._clients.add(client)
                self._begin(self._talk, client)

    def _talk(self, client: socket.socket) -> None:
        try:
            with client, client.makefile("rb") as lines, suppress(OSError):
                for line in lines:
                    verb, variable = line.decode().split()
                    assert verb == "GET", "a source commands nothing"
                    answer = self.answer(variable, self.values[variable])
                    self.asked.append(variable)
                    for part in self._parts(answer or b""):
                        client.sendall(part)
        finally:
            with self._lock:
                self._clients.discard(client)

    def _parts(self, answer: bytes) -> list[bytes]:
        return [bytes([byte]) for byte in answer] if self.in_fragments else [answer]


@contextmanager
def fake_urcap(position: int = 3, status: int = 3) -> Iterator[FakeUrcap]:
    urcap = FakeUrcap(position, status)
    try:
        yield urcap
    finally:
        urcap.close()

"""A viewer that speaks Foxglove's protocol (`foxglove.sdk.v1`, RFC 6455): what it is sent, by topic."""

from __future__ import annotations

import json
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from io import BufferedReader
from typing import Any

UPGRADE = (
    "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
    "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)
TEXT, BINARY, CLOSED, PING, PONG = 1, 2, 8, 9, 10  # opcodes of frames
MESSAGE_DATA = 1  # opcode of a binary message: u8 opcode, u32 subscription, u64 log time [ns], payload


@dataclass
class Viewer:
    """Subscribes to every channel that is advertised; one that hangs stops reading at the first message."""

    link: socket.socket
    hangs: bool = False
    schemas: dict[str, tuple[str, dict[str, Any]]] = field(default_factory=dict)  # by topic
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=dict)  # by topic: log time, payload
    statuses: list[str] = field(default_factory=list)
    subscribed: threading.Event = field(default_factory=threading.Event)

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [json.loads(payload) for _, payload in list(self.messages.get(topic, ()))]

    def count(self, topic: str) -> int:
        return len(self.messages.get(topic, ()))

    def read(self, stream: BufferedReader) -> None:
        """Until the connection ends."""
        topics: dict[int, str] = {}
        for opcode, content in frames(stream):
            if opcode == PONG:
                self.subscribed.set()
            elif opcode == TEXT:
                self._said(json.loads(content), topics)
            elif opcode == BINARY and self.hangs:
                return
            elif opcode == BINARY:
                kind, subscription, log_time = struct.unpack("<BIQ", content[:13])
                assert kind == MESSAGE_DATA
                self.messages.setdefault(topics[subscription], []).append((log_time, content[13:]))

    def _said(self, message: dict[str, Any], topics: dict[int, str]) -> None:
        if message["op"] == "status":
            self.statuses.append(message["message"])
        if message["op"] != "advertise":
            return
        for channel in message["channels"]:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
            topics[int(channel["id"])] = channel["topic"]
            self.schemas[channel["topic"]] = (channel["schemaName"], json.loads(channel["schema"]))
        wanted = [{"id": int(one["id"]), "channelId": int(one["id"])} for one in message["channels"]]
        content = json.dumps({"op": "subscribe", "subscriptions": wanted}).encode()
        # A client masks what it sends; the mask 0 leaves it as it is.
        self.link.sendall(struct.pack(">BBH4x", 0x80 | TEXT, 0x80 | 126, len(content)) + content)
        self.link.sendall(struct.pack(">BB4x", 0x80 | PING, 0x80))  # answered once it has subscribed


def frames(stream: BufferedReader) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of every frame that a server sends, until the connection ends."""
    with suppress(ConnectionError):
        yield from _frames(stream)


def _frames(stream: BufferedReader) -> Iterator[tuple[int, bytes]]:
    while len(head := stream.read(2)) == 2:
        size = head[1]
        if size == 126:
            (size,) = struct.unpack(">H", stream.read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", stream.read(8))
        opcode, content = head[0] & 0x0F, stream.read(size)
        if opcode == CLOSED or len(content) < size:
            return
        yield opcode, content


@contextmanager
def viewing(port: int, *, hangs: bool = False) -> Iterator[Viewer]:
    """A viewer of a server on this machine. It leaves as a process that was killed does."""
    with socket.create_connection(("127.0.0.1", port), timeout=30.0) as link, link.makefile("rb") as stream:
        link.settimeout(None)
        link.sendall(UPGRADE.encode())
        answer = b"".join(iter(stream.readline, b"\r\n")).lower()
        assert answer.startswith(b"http/1.1 101")
        assert b"sec-websocket-protocol: foxglove.sdk.v1" in answer
        viewer = Viewer(link, hangs)
        thread = threading.Thread(target=viewer.read, args=(stream,), daemon=True)
        thread.start()
        try:
            yield viewer
        finally:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
            thread.join(10.0)

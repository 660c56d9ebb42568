"""A controller of Universal Robots as far as RTDE 2 goes: handshake, one recipe, packages, on the loopback.

It is a process of its own: ur_rtde holds the interpreter's lock while it connects.
"""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PORT = 30004  # ur_rtde takes no other
TYPES = {
    "timestamp": "DOUBLE",
    "safety_status_bits": "UINT32",
    "robot_status_bits": "UINT32",
}  # others: six numbers
VERSION, CONTROLLER, OUTPUTS, START, PAUSE, PACKAGE = (ord(one) for one in "VvOSPU")


@contextmanager
def rtde_server(values: dict[str, list[float]]) -> Iterator[subprocess.Popen[str]]:
    """A controller that sends `values` by name, time rising by 2 ms, until it is killed."""
    command = [sys.executable, __file__, json.dumps(values)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            yield child
        finally:
            child.kill()


class RtdeServer:
    """One connection of one client."""

    def __init__(self, values: dict[str, list[float]]) -> None:
        self.values = values
        self.recipe: list[str] = []

    def serve(self) -> None:
        with socket.create_server(("127.0.0.1", PORT)) as listener:
            print("ready", flush=True)
            client, _ = listener.accept()
            with client:
                self._talk(client)

    def _talk(self, client: socket.socket) -> None:
        sending = False
        sent = 0
        client.settimeout(0.002)
        while True:
            try:
                size, kind = struct.unpack(">HB", _exactly(client, 3))
                payload = _exactly(client, size - 3)
            except TimeoutError:
                if sending:
                    _send(client, PACKAGE, self._package(sent))
                    sent += 1
                continue
            sending = kind == START or (sending and kind != PAUSE)
            _send(client, kind, self._answer(kind, payload))

    def _answer(self, kind: int, payload: bytes) -> bytes:
        if kind == CONTROLLER:
            return struct.pack(">4I", 5, 12, 0, 0)
        if kind == OUTPUTS:
            self.recipe = payload[8:].decode().strip(",").split(",")
            kinds = ",".join(TYPES.get(name, "VECTOR6D") for name in self.recipe)
            return b"\x01" + kinds.encode()
        return b"\x01"

    def _package(self, sent: int) -> bytes:
        parts = [b"\x01"]
        for name in self.recipe:
            if name == "timestamp":
                parts.append(struct.pack(">d", 100.0 + 0.002 * sent))
            elif name in TYPES:
                parts.append(struct.pack(">I", int(self.values.get(name, [1])[0])))
            else:
                parts.append(struct.pack(">6d", *self.values[name]))
        return b"".join(parts)


def _send(client: socket.socket, kind: int, payload: bytes) -> None:
    client.sendall(struct.pack(">HB", len(payload) + 3, kind) + payload)


def _exactly(client: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = client.recv(count - len(data))
        if not part:
            raise ConnectionError("closed")
        data += part
    return data


if __name__ == "__main__":
    RtdeServer(json.loads(sys.argv[1])).serve()

"""A password is demanded, and does not cross the wire, not even where nothing is encrypted."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import zenoh

from caesura_service.server.network_join import SETTINGS
from clients.conftest import free_port
from harness.peer import DEADLINE_S

PASSWORD = "correct-horse-battery-staple"


@contextmanager
def recording_proxy(port: int) -> Iterator[tuple[int, bytearray]]:
    """A listener that passes one connection on; yields its port and everything that passes."""
    passed = bytearray()

    def pump(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while chunk := source.recv(4096):
                passed.extend(chunk)
                sink.sendall(chunk)

    with (
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.create_connection(("127.0.0.1", port)) as there,
    ):

        def serve() -> None:
            here, _ = server.accept()
            with here:
                back = threading.Thread(target=pump, args=(there, here), daemon=True)
                back.start()
                pump(here, there)
                there.shutdown(socket.SHUT_RDWR)
                back.join(DEADLINE_S)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield server.getsockname()[1], passed
        thread.join(DEADLINE_S)


def opened(**settings: object) -> zenoh.Session:
    config = zenoh.Config()
    for key, value in {**SETTINGS, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def test_the_password_does_not_cross_the_wire(tmp_path):
    (tmp_path / "users.txt").write_text(f"me:{PASSWORD}\n")
    port = free_port()
    router = opened(
        **{
            "mode": "router",
            "listen/endpoints": [f"tcp/127.0.0.1:{port}"],
            "transport/auth/usrpwd/dictionary_file": str(tmp_path / "users.txt"),
        }
    )
    with recording_proxy(port) as (through, passed):
        client = opened(
            **{
                "mode": "client",
                "connect/endpoints": [f"tcp/127.0.0.1:{through}"],
                "connect/timeout_ms": round(1000 * DEADLINE_S),
                "transport/auth/usrpwd": {"user": "me", "password": PASSWORD},
            }
        )
        assert not list(client.get("anything", timeout=DEADLINE_S))
        client.put("said/in/clear", b"everything else does", congestion_control=zenoh.CongestionControl.BLOCK)
        assert not list(client.get("anything", timeout=DEADLINE_S))  # behind the put
        client.close()
    router.close()
    assert b"me" in passed
    assert b"everything else does" in passed
    assert PASSWORD.encode() not in passed

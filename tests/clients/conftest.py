from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from functools import partial
from random import SystemRandom

import pytest
import zenoh

from caesura_clients.bridge import BridgeSettings
from caesura_protocol.transport.memory import MemoryNetwork
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.transport.zenoh_transport import SETTINGS, ZenohTransport

FULL_S = 3600.0  # that a batch may wait until it is full: longer than a test may take
BELOW_EPHEMERAL = range(10_240, 32_768)  # no outgoing connection of another test takes a port of these


def free_port() -> int:
    """Return a port that nothing listens on, drawn at random, so that parallel tests seldom meet."""
    while True:
        port = SystemRandom().choice(BELOW_EPHEMERAL)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("", port))
            return port


def open_router(port: int) -> zenoh.Session:
    config = zenoh.Config()
    own = {"mode": "router", "listen/endpoints": [f"tcp/127.0.0.1:{port}"], "scouting/delay": 0}
    for key, value in {**SETTINGS, **own}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class RouterNetwork:
    """Real Zenoh over loopback: a router in this process, on a free port."""

    def __init__(self) -> None:
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self._stack = ExitStack()
        self._router: zenoh.Session | None = None

    def __enter__(self) -> RouterNetwork:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        self.stop()

    def start(self) -> None:
        self._router = open_router(self.port)

    def stop(self) -> None:
        if self._router is not None:
            self._router.close()
            self._router = None

    def transport(self) -> Transport:
        return self._stack.enter_context(ZenohTransport(self.endpoint, timeout_s=20.0))


@pytest.fixture
def router() -> Iterator[RouterNetwork]:
    with RouterNetwork() as network:
        yield network


@pytest.fixture
def full_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """`caesura bridge` puts no batch before it is full: by default one goes after 0.1 s, full or not."""
    settings = partial(BridgeSettings, max_latency_s=FULL_S)
    monkeypatch.setattr("caesura_clients.cli.bridge.BridgeSettings", settings)


@pytest.fixture
def memory() -> MemoryNetwork:
    return MemoryNetwork()


@pytest.fixture(params=["memory", "zenoh"])
def network(request: pytest.FixtureRequest) -> MemoryNetwork | RouterNetwork:
    """Both implementations of the transport: one contract."""
    return request.getfixturevalue("memory" if request.param == "memory" else "router")

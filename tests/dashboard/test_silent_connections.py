"""Connections that ask nothing, or do not end what they ask: they take no visitor's place."""

from __future__ import annotations

import socket
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

pytest.importorskip("nicegui")

from websockets.sync.client import connect

from caesura_clients.dashboard.silent_connections import MOST_SILENT
from dashboard.stage import Dashboard
from harness.processes import DEADLINE_S, running, serving

FURTHER = 40


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Host and port of a dashboard."""
    with (
        serving(tmp_path_factory.mktemp("silent")) as service,
        running(Dashboard(service.endpoint)) as dashboard,
    ):
        yield dashboard.url.removeprefix("http://")


@pytest.fixture
def connected(place: str) -> Iterator[Callable[[], socket.socket]]:
    """Opens connections to the dashboard, which are closed after the test."""
    host, port = place.split(":")
    with ExitStack() as stack:
        yield lambda: stack.enter_context(socket.create_connection((host, int(port)), timeout=DEADLINE_S))


def is_closed(one: socket.socket) -> bool:
    """Whether the other side closes it within the deadline, without a word."""
    try:
        return one.recv(1) == b""
    except ConnectionResetError:
        return True


def test_beyond_a_bound_the_connection_that_is_silent_for_longest_is_closed(place, connected):
    """A thousand silent ones kept every visitor out of the dashboard, also of one with a password."""
    silent = [connected() for _ in range(MOST_SILENT + FURTHER)]
    assert all(is_closed(one) for one in silent[:FURTHER])
    with urllib.request.urlopen(f"http://{place}/", timeout=DEADLINE_S) as page:
        assert page.status == 200
    last = silent[-1]
    last.sendall(f"GET / HTTP/1.1\r\nHost: {place}\r\n\r\n".encode())
    assert b"200 OK" in last.recv(1 << 16)


def test_open_pages_are_not_silent(place, connected):
    with ExitStack() as stack:
        address = f"ws://{place}/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        pages = [stack.enter_context(connect(address, proxy=None)) for _ in range(MOST_SILENT // 2)]
        silent = [connected() for _ in range(MOST_SILENT + FURTHER)]
        assert all(is_closed(one) for one in silent[:FURTHER])
        for page in pages:
            assert page.recv(DEADLINE_S).startswith("0{"), "the greeting of engine.io"
            page.send("40")
            assert page.recv(DEADLINE_S).startswith("4")

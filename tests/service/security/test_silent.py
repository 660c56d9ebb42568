"""Connections that say nothing keep nobody out. `make faults ARGS=silent` does it for longer."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from caesura_protocol.keys import service_key
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from caesura_service.security import zenoh_files
from harness.fake_pipeline import make_fake_pipeline
from harness.silent import Silent
from service.security.acl_world import certificates

CONNECTIONS = 150  # Zenoh's own limit is 100
DEADLINE_S = 20.0


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("certs")
    certificates(path)
    return path


@contextmanager
def listening(directory: Path, protocol: str, file: str | None) -> Iterator[tuple[str, int]]:
    config = ServiceConfig(
        instance="west",
        listen=f"{protocol}/127.0.0.1:0",
        preset="fake",
        zenoh_config=directory / file if file else None,
    )
    with Service(config, pipeline_factory=make_fake_pipeline) as service:
        yield service.endpoint, int(service.endpoint.rpartition(":")[2])


@pytest.mark.parametrize(
    ("protocol", "router", "client", "tls"),
    [
        ("tcp", None, None, False),
        ("tls", "router.json5", "dashboard.wall.json5", False),
        ("tls", "router.password.json5", "dashboard.wall.password.json5", True),
    ],
    ids=["without credentials", "certificates", "passwords, after the handshake"],
)
def test_silent_connections_keep_no_other_out(directory, protocol, router, client, tls):
    file = directory / client if client else None
    with (
        listening(directory, protocol, router) as (endpoint, port),
        Silent(port, CONNECTIONS, tls=tls),
        ZenohTransport(endpoint, config_file=file, timeout_s=DEADLINE_S) as transport,
    ):
        assert transport.list_tokens(service_key("*", "alive")) == (service_key("west", "alive"),)


def test_a_handshake_may_take_as_long_as_we_say(directory, monkeypatch):
    """After each that fails Zenoh accepts nothing for 100 ms, so few may fail: its default is 10 s."""
    monkeypatch.setattr(zenoh_files, "HANDSHAKE_MS", 300)
    old = (directory / "router.json5").read_text()
    file = directory / "old.json5"
    file.write_text(old.replace(f"#tls_handshake_timeout_ms={60 * 60 * 1000}", ""))
    assert file.read_text() != old, "the files that are written say it to zenohd as well"
    with (
        listening(directory, "tls", "old.json5") as (_, port),
    ):
        began = time.monotonic()
        with socket.create_connection(("127.0.0.1", port), DEADLINE_S) as silent:
            assert silent.recv(1) == b""
        assert time.monotonic() - began > 0.2

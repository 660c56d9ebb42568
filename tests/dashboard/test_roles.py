"""With a reader's certificate the dashboard shows everything; to correct it needs an operator's."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from caesura_clients import query, session_corrections
from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.file import FileSource
from caesura_clients.dashboard.correction_requests import EditRefused, correct, corrector
from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_protocol.keys import SampleRange
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from harness.demonstrations import guided
from harness.processes import eventually
from service.security.acl_world import certificates

INSERT = {"do": "insert", "t": 1.4, "session": "s1", "revision": 0, "author": "Ann"}


@pytest.fixture
def network(tmp_path) -> Iterator[tuple]:
    """Where the service listens, and a way to connect in a role."""
    certificates(tmp_path)
    config = ServiceConfig(instance="west", listen="tls/127.0.0.1:0", zenoh_config=tmp_path / "router.json5")
    with Service(config) as service:
        yield lambda label: ZenohTransport(
            service.endpoint, config_file=tmp_path / f"{label}.json5", timeout_s=10.0
        )


def test_a_reader_sees_and_an_operator_corrects(network, monkeypatch):
    monkeypatch.setattr(session_corrections, "SILENCE_S", 0.3)
    with (
        network("dashboard.wall") as wall,
        network("operator.boss") as boss,
        network("bridge.cell-1") as robot,
        NetworkFollower(wall, refresh_s=0.2) as gateway,
    ):
        eventually(lambda: gateway.world.alive and gateway.world.services)
        with Bridge(robot, "cell-1", FileSource(guided(), pace=math.inf), session="s1") as bridge:
            bridge.run()
        eventually(lambda: gateway.world.update("cell-1") and gateway.world.update("cell-1").closed)
        eventually(lambda: "cell-1" in gateway.received)  # samples are let through to a reader
        past = query.samples(wall, "cell-1", "s1", SampleRange(0.0, 10.0, 100))
        assert past.counts[0] > 100, "and those of the journal"

        with pytest.raises(EditRefused, match="or it is forbidden"):
            correct(corrector(wall), "cell-1", INSERT)
        assert correct(corrector(boss), "cell-1", INSERT).words == "Changepoint inserted at 1.35 s."
        eventually(lambda: gateway.world.update("cell-1").program.author == "Ann")

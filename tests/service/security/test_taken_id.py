"""A station that takes the Zenoh id of an instance: the router then keeps the instance out.

Every reply states the id of the session that answered. A router refuses a second session with the same id.
"""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import pytest

from caesura_protocol.codec import encode
from caesura_protocol.keys import station_key
from caesura_protocol.messages import Control
from caesura_service.app import Service, run_service
from caesura_service.config import ServiceConfig
from caesura_service.server import NetworkError, router_link
from clients.conftest import free_port
from faults.suite.proxy import proxied
from harness.fake_pipeline import make_fake_pipeline
from harness.processes import DEADLINE_S, eventually
from harness.sessions import opening
from service.security.acl_world import certificates, opened


@pytest.fixture
def quick(monkeypatch) -> None:
    monkeypatch.setattr(router_link, "LOOK_S", 0.1)
    monkeypatch.setattr(router_link, "KEPT_OUT_S", 1.0)


@pytest.mark.usefixtures("quick")
def test_an_instance_whose_id_a_station_has_taken_ends_and_comes_in_with_another(tmp_path):
    certificates(tmp_path)
    port, over = free_port(), threading.Event()
    router = opened(tmp_path / "router.json5", **{"listen/endpoints": [f"tls/127.0.0.1:{port}"]})
    at_router = {"connect/endpoints": [f"tls/127.0.0.1:{port}"], "connect/timeout_ms": 20_000}
    try:
        with proxied(f"tcp/127.0.0.1:{port}") as line, ThreadPoolExecutor(1) as pool:
            config = ServiceConfig(
                instance="west",
                connect=f"tls/127.0.0.1:{line.port}",
                zenoh_config=tmp_path / "service.west.json5",
                preset="fake",
            )
            ready: SimpleQueue[Service] = SimpleQueue()
            running = pool.submit(
                run_service, config, ready=ready.put, over=over, pipeline_factory=make_fake_pipeline
            )
            try:
                service = ready.get(timeout=DEADLINE_S)
                taken = _id_of_the_instance(tmp_path, at_router)
                line.flows = False
                line.cut()
                eventually(lambda: service._edge.router_fault is not None)
                hostile = opened(tmp_path / "bridge.cell-1.json5", **at_router, id=taken)
                try:
                    line.flows = True
                    with pytest.raises(NetworkError, match="refuses this one: another client"):
                        running.result(DEADLINE_S)
                    with Service(config, pipeline_factory=make_fake_pipeline) as again:
                        assert again._edge.router_fault is None
                        assert _id_of_the_instance(tmp_path, at_router) != taken
                finally:
                    hostile.close()
            finally:
                over.set()
    finally:
        router.close()


def _id_of_the_instance(directory, at_router) -> str:
    """As a station learns it, by a command of its own."""
    bridge = opened(directory / "bridge.cell-1.json5", **at_router)
    try:
        content = encode(Control(command=opening()))
        key = station_key("cell-1", "control")
        (reply,) = bridge.get(key, payload=content.payload, encoding=content.encoding)
        assert reply.ok
        return str(reply.replier_id.zid)
    finally:
        bridge.close()

"""A router that accepts no declaration is noticed, and so is that it accepts them again."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest

from caesura_service.server.router_probe import WHY_STUCK, RouterProbe
from harness.peer import Peer
from harness.processes import eventually, started

ROUTER = """
import threading
from caesura_service.server import NetworkSettings
from caesura_service.server.network_join import join
from caesura_service.server.router_probe import RouterProbe
network, endpoint = join(NetworkSettings(listen="tcp/127.0.0.1:0"), threading.Event())
with RouterProbe(lambda: network.declare_subscriber("watch", 1), pause_s=0.05, stuck_s=1.0) as probe:
    print(endpoint, flush=True)
    while not probe.is_stuck:
        threading.Event().wait(0.05)
        probe.update(0.05)
    print("stuck", flush=True)
    threading.Event().wait()
"""


class WaitingRouter:
    """It accepts a declaration once `accepts` is set."""

    def __init__(self) -> None:
        self.asked, self.accepts = threading.Event(), threading.Event()

    def declare(self) -> WaitingRouter:
        self.asked.set()
        self.accepts.wait()
        return self

    def undeclare(self) -> None:
        pass


def test_a_router_is_stuck_from_a_declaration_that_takes_long_until_it_ends(caplog: pytest.LogCaptureFixture):
    router = WaitingRouter()
    try:
        with RouterProbe(router.declare, pause_s=0.0, stuck_s=2.0) as probe:
            router.asked.wait()
            probe.update(1.0)
            assert not probe.is_stuck
            probe.update(1.0)
            assert probe.is_stuck
            probe.update(1.0)
            assert caplog.messages == [WHY_STUCK]

            router.accepts.set()

            def recovered() -> bool:
                probe.update(0.0)
                return not probe.is_stuck

            eventually(recovered)
            assert caplog.messages[1:] == ["the router accepts declarations again"]
    finally:
        router.accepts.set()


def test_a_real_router_that_compares_costly_keys_is_stuck():
    with started([sys.executable, "-c", ROUTER], stdout=subprocess.PIPE) as router:
        assert router.stdout is not None
        endpoint = router.stdout.readline().strip()
        with Peer(endpoint) as one, Peer(endpoint) as other:
            one.network.declare_subscriber("x/" + "a" * 64, lambda _: None)
            other.network.declare_publisher("x/" + "$*a" * 8 + "$*b").put(b"1")
            assert router.stdout.readline() == "stuck\n"
            router.kill()

"""A service that is killed and started again, and what somebody at the dashboard is told meanwhile."""

from __future__ import annotations

from contextlib import closing

import pytest

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.dashboard.station_summary import StationSummary, glances
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from dashboard.stage import Bridges
from harness.demonstrations import taught
from harness.processes import eventually, serving


def seen(gateway: NetworkFollower) -> StationSummary | None:
    found = glances(gateway.world, gateway.received, gateway.clock(), gateway.began)
    return found[0] if found else None


def state(gateway: NetworkFollower) -> str:
    one = seen(gateway)
    return "" if one is None else one.state


@pytest.mark.slow
@pytest.mark.parametrize("end", ["kill", "freeze"])
def test_a_station_without_its_service_is_stale_until_it_is_back(tmp_path, end):
    with (
        serving(tmp_path / "journal") as service,
        ZenohTransport(service.endpoint, timeout_s=10.0) as transport,
        NetworkFollower(transport, refresh_s=0.5) as gateway,
        closing(Bridges(service, tmp_path)) as bridges,
    ):
        bridges.teach("cell-1", taught(1, 120.0))
        eventually(lambda: state(gateway) == "teaching" and seen(gateway).segments > 1)
        getattr(service, end)()
        eventually(lambda: state(gateway) == "stale")
        known = seen(gateway).segments
        assert known > 1, "what was known stays"
        if end == "kill":
            service.start()
        else:
            service.thaw()
        eventually(lambda: state(gateway) == "teaching" and seen(gateway).segments > known)
        assert seen(gateway).gaps == 0

"""One who attacks the router's port and one who holds a certificate. Prints how long the latter needed [s].

python front_scene.py DIRECTORY LISTEN REACHED: certificates, the port of the router, and the port that is
reached. The attacker has another address of this machine.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from caesura_protocol.errors import CaesuraError
from caesura_protocol.keys import service_key
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from caesura_service.app import Service
from caesura_service.config import ServiceConfig
from harness.fake_pipeline import make_fake_pipeline
from harness.processes import eventually
from harness.silent import HangUps, Silent, client_hello

ATTACKER = "127.0.0.2"
PATIENCE_S = 5.0
HANG_UPS = 90  # they are refused at first, or they fill the router's queue for longer than PATIENCE_S


def main(directory: Path, listen: int, reached: int) -> None:
    """Attack, connect, and print."""
    config = ServiceConfig(
        instance="west",
        listen=f"tls/127.0.0.1:{listen}",
        zenoh_config=directory / "router.json5",
        preset="fake",
    )
    with (
        Service(config, pipeline_factory=make_fake_pipeline),
        Silent(reached, 150, source=ATTACKER),
        HangUps(reached, 60, source=ATTACKER) as hang_ups,
        HangUps(reached, 60, client_hello(), source=ATTACKER) as half_way,
    ):
        eventually(lambda: min(hang_ups.done, half_way.done) >= HANG_UPS)
        began = time.monotonic()
        came_in = connects(directory, reached)
        print(f"{time.monotonic() - began:.2f}" if came_in else "not", flush=True)


def connects(directory: Path, port: int) -> bool:
    """Does a holder of a certificate get in, and see the service?"""
    file = directory / "dashboard.wall.json5"
    try:
        with ZenohTransport(f"tls/127.0.0.1:{port}", config_file=file, timeout_s=PATIENCE_S) as transport:
            return bool(transport.list_tokens(service_key("*", "alive")))
    except CaesuraError:
        return False


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))

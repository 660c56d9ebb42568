"""A live robot and its bridge in a process of their own, to be killed.

`python -m faults.suite.bridge_process ENDPOINT NUMBER EPOCH FILE`; the robot's clock began at the time of
day that the file says as soon as there is one, and goes on whatever becomes of the bridge. Prints `ready` as
soon as the session is open, and the last word of the service in the end.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources import Chunk
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.stations import SETTINGS, LiveRobot, demonstration, station_name
from harness.processes import SESSION, eventually

PACE = 1.0  # a bridge that starts anew on a loaded machine takes 8 s, and has to find samples then
LATE_S = 0.1  # a sample that is older is gone


class OngoingRobot(LiveRobot):
    """A robot that does not care whether its bridge lives: who comes late misses what was before."""

    def __init__(self, number: int, began: Path) -> None:
        super().__init__(demonstration(number), pace=PACE)
        self._began = began

    def chunks(self) -> Iterator[Chunk]:
        eventually(self._began.exists)
        began_s = float(self._began.read_text())
        for chunk in LiveRobot(self.recording, pace=np.inf).chunks():
            wait_s = began_s + float(chunk[-1, 0]) / PACE - time.time()
            if wait_s > 0.0:
                time.sleep(wait_s)
            if wait_s > -LATE_S:
                yield chunk


def main() -> None:
    endpoint, number, epoch = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    robot = OngoingRobot(number, Path(sys.argv[4]))
    with (
        ZenohTransport(endpoint, timeout_s=10.0) as transport,
        Bridge(
            transport, station_name(number), robot, session=SESSION, epoch=epoch, settings=SETTINGS
        ) as bridge,
    ):
        bridge.wait_open(30.0)
        print("ready", flush=True)
        ack = bridge.run()
    print(ack.model_dump_json(), flush=True)


if __name__ == "__main__":
    main()

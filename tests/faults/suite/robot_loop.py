"""A robot's control loop at 1 kHz that gives each sample to a bridge; how long does `send` keep it?

A process of its own: `python -m faults.suite.robot_loop ENDPOINT SECONDS`. The loop's thread has a real-time
priority where the system gives it one, as such loops do: what is measured is then the bridge, not who else
uses the machine. Prints `ready` once the session is open, and the times in the end.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
from contextlib import suppress

import numpy as np

from caesura_clients.bridge import Bridge, BridgeSettings
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.transport.zenoh_transport import ZenohTransport
from faults.suite.stations import LiveRobot
from harness.demonstrations import taught
from harness.processes import SESSION

PERIOD_S = 0.001
PRIORITY = 10


def main() -> None:
    endpoint, seconds = sys.argv[1], float(sys.argv[2])
    source = LiveRobot(taught(0, 5.0))
    settings = BridgeSettings(close_timeout_s=20.0)
    with (
        ZenohTransport(endpoint, timeout_s=10.0) as transport,
        Bridge(transport, "cell-1", source, session=SESSION, settings=settings) as bridge,
    ):
        bridge.wait_open(30.0)
        gc.collect()
        gc.freeze()  # what a process loads at its start need not be looked at again and again
        print("ready", flush=True)
        real_time = _real_time(PRIORITY)
        sent, slept = loop(bridge, round(seconds / PERIOD_S), len(source.columns))
        _real_time(0)
        outcome = {"sent": sent, "late": slept, "real_time": real_time, "closed": False, "why": ""}
        try:
            outcome["closed"] = bridge.finish().state == "closed"
        except (CaesuraError, ProtocolError) as error:
            outcome["why"] = str(error)
    print(json.dumps(outcome), flush=True)


def loop(bridge: Bridge, cycles: int, columns: int) -> tuple[list[float], list[float]]:
    """[s] of each `send`, and how late each cycle began: what the machine did to it."""
    sent, late = np.empty(cycles), np.empty(cycles)
    row = np.full((1, columns), 0.3)
    begun = time.perf_counter()
    for cycle in range(cycles):
        due = begun + cycle * PERIOD_S
        if (wait_s := due - time.perf_counter()) > 0.0:
            time.sleep(wait_s)
        row[0, 0] = cycle * PERIOD_S
        before = time.perf_counter()
        bridge.send(row)
        sent[cycle] = time.perf_counter() - before
        late[cycle] = before - due
    return sent.tolist(), late.tolist()


def _real_time(priority: int) -> bool:
    """Whether this thread is let have it; 0 gives it back."""
    policy = os.SCHED_FIFO if priority else os.SCHED_OTHER
    with suppress(OSError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))
        return True
    return False


if __name__ == "__main__":
    main()

"""A bridge for your robot: a class that yields matrices of samples, and `run`.

Here the robot is a sine; put the reading of yours into `chunks`. The bridge numbers the samples, keeps the
last two minutes for replay, finds the service again after an absence, and closes the session.
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np

from caesura_clients import connect
from caesura_clients.bridge.sources import Chunk


class Sine:
    """Up and down along z, for some seconds."""

    columns = ("t", "px", "py", "pz", "fx", "fy", "fz")  # time [s] first, then what there is
    wrench_source = "flange_sensor"  # where the force is measured; contact and load stay off without it
    hand_on_robot = "yes"  # does a person guide this robot by hand?
    force_frame = "base"
    length_unit = "m"
    can_wait = False  # a live robot does not
    # robot = "my_arm"  # a name of `caesura robots`: joints, q1 to q7, are read as those of this arm

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds

    def chunks(self) -> Iterator[Chunk]:
        """20 samples every 20 ms, each a row of `columns`."""
        begun = time.monotonic()
        for first in range(0, round(self.seconds * 1000), 20):
            t = (first + np.arange(20)) / 1000.0
            still = np.zeros_like(t)
            yield np.column_stack([t, still + 0.4, still, 0.3 + 0.1 * np.sin(t), still, still, still])
            time.sleep(max(0.0, begun + t[-1] - time.monotonic()))


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("seconds", type=float, nargs="?", default=5.0)
seconds = parser.parse_args().seconds

with connect() as caesura, caesura.bridge("cell-1", Sine(seconds)) as bridge:
    ack = bridge.run()
    print(f"session {bridge.session}: {ack.next_seq} batches, {ack.lost} of them lost")

"""Plays a recording as if the robot were there: at its speed, at a multiple of it, or without waiting."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from caesura_clients.bridge.sources import Chunk
from caesura_clients.recording import Recording
from caesura_protocol.messages import ForceFrame, LengthUnit, WrenchSource

FAST = float("inf")


class FileSource:
    """A recording as a Source.

    pace: how many seconds of the recording pass in one second, FAST for no waiting at all;
    chunk_s: how much comes at once [s], as a robot's driver would deliver it.
    """

    can_wait = True

    def __init__(
        self,
        recording: Recording,
        *,
        pace: float = 1.0,
        chunk_s: float = 0.02,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not pace > 0.0:
            raise ValueError(f"pace is {pace}, expected more than 0")
        self.columns: tuple[str, ...] = recording.columns
        self.wrench_source: WrenchSource = recording.wrench_source
        self.force_frame: ForceFrame = recording.force_frame
        self.length_unit: LengthUnit = recording.length_unit
        self._samples = recording.matrix()
        self._pace = pace
        self._chunk_s = chunk_s
        self._clock = clock
        self._sleep = sleep

    def chunks(self) -> Iterator[Chunk]:
        """Pieces of about `chunk_s`, each when its last sample is due. Repeated times stay as they are."""
        passed = np.maximum.accumulate(self._samples[:, 0] - self._samples[0, 0])  # (n,) [s]
        piece = np.floor(passed / self._chunk_s)
        started = self._clock()
        for samples in np.split(np.arange(len(piece)), np.flatnonzero(np.diff(piece)) + 1):
            wait_s = started + passed[samples[-1]] / self._pace - self._clock()
            if wait_s > 0.0:
                self._sleep(wait_s)
            yield self._samples[samples[0] : samples[-1] + 1]


def parse_pace(text: str) -> float:
    """`real` is 1, `fast` does not wait, a number is a multiple of real time. Raises ValueError."""
    named = {"real": 1.0, "fast": FAST}
    try:
        pace = named.get(text) or float(text)
    except ValueError:
        pace = 0.0
    if not pace > 0.0:
        raise ValueError(f"pace is {text!r}, expected real, fast or a number above 0")
    return pace

"""Plays a recording as a live source: at its speed, at a multiple of it, or without waiting."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from caesura_clients.bridge.sources import Chunk
from caesura_clients.bridge.sources.paced_source import PacedSource
from caesura_protocol.recording import Recording

CHUNK_S = 0.02  # what a robot's driver delivers at once


class FileSource(PacedSource):
    """A recording as a Source; see PacedSource for the pace."""

    def __init__(
        self,
        recording: Recording,
        *,
        pace: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.recording = recording
        self.description = recording.description
        super().__init__(
            lambda: pieces(recording.matrix()),
            columns=recording.columns,
            wrench_source=recording.wrench_source,
            hand_on_robot=recording.hand_on_robot,
            force_frame=recording.force_frame,
            length_unit=recording.length_unit,
            declared_units=recording.declared_units,
            assumed=recording.assumptions,
            setting=recording.setting,
            pace=pace,
            clock=clock,
            sleep=sleep,
        )


def pieces(samples: Chunk, piece_s: float = CHUNK_S) -> Iterator[Chunk]:
    """Yield samples (n, columns) in pieces of `piece_s`.

    A time that goes back stays in the piece before it.
    """
    passed = np.maximum.accumulate(samples[:, 0] - samples[0, 0])  # (n,) [s]
    piece = np.floor(passed / piece_s)
    yield from np.split(samples, np.flatnonzero(np.diff(piece)) + 1)

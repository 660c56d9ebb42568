"""Plays recorded samples at the pace of a robot."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from caesura_clients.bridge.sources import Chunk
from caesura_protocol.messages import Assumption, ForceFrame, HandOnRobot, LengthUnit, Quantity, WrenchSource
from caesura_protocol.programs.safety import UNSET, CellSettings

FAST = float("inf")


class PacedSource:
    """A Source that delays each chunk until its last sample is due.

    read: returns an iterator of chunks (k, columns); pace: seconds of the demonstration per second, FAST for
    no waiting. Raises ValueError for a pace that is not above 0.
    """

    can_wait = True

    def __init__(
        self,
        read: Callable[[], Iterator[Chunk]],
        *,
        columns: tuple[str, ...],
        wrench_source: WrenchSource | None,
        hand_on_robot: HandOnRobot = "unknown",
        force_frame: ForceFrame = "base",
        length_unit: LengthUnit = "m",
        declared_units: tuple[Quantity, ...] = (),
        assumed: tuple[Assumption, ...] = (),
        setting: CellSettings = UNSET,
        pace: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not pace > 0.0:
            raise ValueError(f"pace is {pace}, expected more than 0")
        self.columns = columns
        self.wrench_source: WrenchSource | None = wrench_source
        self.hand_on_robot: HandOnRobot = hand_on_robot
        self.force_frame: ForceFrame = force_frame
        self.length_unit: LengthUnit = length_unit
        self.declared_units = declared_units
        self.assumed = assumed
        self.setting = setting
        self._read = read
        self._pace = pace
        self._clock = clock
        self._sleep = sleep

    def chunks(self) -> Iterator[Chunk]:
        """Yield the chunks of `read`, each when it is due.

        A time that repeats or goes back is not waited for.
        """
        begun_s, first = self._clock(), None
        for chunk in self._read():
            times = chunk[:, 0]
            first = float(times[0]) if first is None else first
            wait_s = begun_s + (float(times.max()) - first) / self._pace - self._clock()
            if wait_s > 0.0:
                self._sleep(wait_s)
            yield chunk


def parse_pace(text: str) -> float:
    """Return the pace of a text: `real` is 1, `fast` does not wait, a number is a multiple of real time.

    Raises ValueError for any other text.
    """
    named = {"real": 1.0, "fast": FAST}
    try:
        pace = named.get(text) or float(text)
    except ValueError:
        pace = 0.0
    if not pace > 0.0:
        raise ValueError(f"pace is {text!r}, expected real, fast or a number above 0")
    return pace

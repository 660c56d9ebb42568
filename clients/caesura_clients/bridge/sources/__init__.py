"""Sources of samples: one file for each robot or file format, each with the interface `Source`.

A new robot needs one module with a class that implements `Source`, and one line in `registry.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import ForceFrame, HandOnRobot, LengthUnit, WrenchSource

Chunk = NDArray[np.floating]  # (k, columns), as declared; time [s] first


class Mark(NamedTuple):
    """A changepoint that a pedal or button requests: one segment ends and the next begins."""

    t: float  # [s] session clock


class Source(Protocol):
    """One robot, or a player of its samples.

    A source whose robot reports a hand-guiding button also has `button_pressed`: see the function below. A
    source with joints states its arm in `robot`, a name listed by `caesura robots`. Without it seven joints
    are those of a Panda, and another number of joints without a position is refused.
    """

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of every chunk, `t` first (see `COLUMNS_OF_SIGNAL`)."""

    @property
    def wrench_source(self) -> WrenchSource | None:
        """The place where the wrench is measured; None: not stated, and contact and load stay off."""

    @property
    def hand_on_robot(self) -> HandOnRobot:
        """Whether a person guides this robot by hand: `yes`, `no` or `unknown`."""

    @property
    def force_frame(self) -> ForceFrame:
        """The frame in which forces are given."""

    @property
    def length_unit(self) -> LengthUnit:
        """The unit of positions."""

    @property
    def can_wait(self) -> bool:
        """Whether the bridge may pause the source while the service catches up; a live robot cannot wait."""

    def chunks(self) -> Iterator[Chunk | Mark]:
        """Yield samples in the order of arrival, and marks, until the demonstration ends."""


def button_pressed(source: Source) -> bool | None:
    """Return whether the hand-guiding button of the source's robot is pressed, as of its newest chunk.

    None if the source does not report a button: it then has no property `button_pressed`, or None there.
    """
    pressed: bool | None = getattr(source, "button_pressed", None)
    return pressed

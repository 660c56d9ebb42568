"""What nothing can change any more of a demonstration, as it is shown: kept, not gathered at every look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from caesura_protocol.messages import Changepoint, Segment
from caesura_service.changepoint.segments import Stretch


class Part(NamedTuple):
    """A stretch, and what is shown of it."""

    stretch: Stretch
    segment: Segment
    changepoint: Changepoint  # its start; the first part's is never shown


class Settled:
    """The first parts of a demonstration, in order."""

    def __init__(self) -> None:
        self.parts: list[Part] = []
        self.stretches: list[Stretch] = []
        self._segments: tuple[Segment, ...] = ()
        self._changepoints: tuple[Changepoint, ...] = ()

    def __len__(self) -> int:
        return len(self.parts)

    def take(self, parts: Sequence[Part]) -> None:
        """These have settled too."""
        self.parts += parts
        self.stretches += [part.stretch for part in parts]
        self._segments += tuple(part.segment for part in parts)
        self._changepoints += tuple(part.changepoint for part in parts)

    def segments(self, parts: Sequence[Part]) -> tuple[Segment, ...]:
        """Of all parts (of which the first have settled)."""
        return self._segments + tuple(part.segment for part in parts[len(self) :])

    def changepoints(self, parts: Sequence[Part]) -> tuple[Changepoint, ...]:
        """Likewise; one fewer, for the first part has none."""
        return (self._changepoints + tuple(part.changepoint for part in parts[len(self) :]))[1:]

"""The final segments and changepoints of a session, stored so that a view does not rebuild them.

Segments that the program still needs are stored as objects; earlier ones encoded, in a fifth of the memory.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from caesura_protocol.messages import Changepoint, Segment
from caesura_service.cooperative_scheduler import give_way
from caesura_service.segmentation.encoded_log import EncodedMessageLog, MessageSequence

_AT_ONCE = 100  # parts that are read before others have their turn


class SegmentEntry(NamedTuple):
    """A segment from observation start to end, which is not included, and its changepoint, as shown."""

    start: int
    end: int
    segment: Segment
    changepoint: Changepoint  # its start; the first part's is never shown


class FinalizedSegments:
    """The settled segments of a demonstration with their changepoints, in order."""

    def __init__(self) -> None:
        self._starts = array("q", [0])  # of those that are packed, and of the first that is not
        self._segments = EncodedMessageLog(Segment)
        self._changepoints = EncodedMessageLog(Changepoint)
        self._parts: list[SegmentEntry] = []  # behind those

    def __len__(self) -> int:
        return len(self._segments) + len(self._parts)

    def add(self, parts: Iterable[SegmentEntry], quiet: int) -> None:
        """Add settled parts, and encode those before part number `quiet`, which no later program reads."""
        self._parts += parts
        count = max(min(quiet - len(self._segments), len(self._parts)), 0)
        packed, self._parts = self._parts[:count], self._parts[count:]
        self._starts.extend(part.end for part in packed)
        self._changepoints.extend(part.changepoint for part in packed)
        self._segments.extend(part.segment for part in packed)

    def since(self, number: int) -> list[SegmentEntry]:
        """Return the parts from this number on."""
        count = len(self._segments)
        if number >= count:
            return self._parts[number - count :]
        parts: list[SegmentEntry] = []
        for first in range(number, count, _AT_ONCE):
            parts += self._read(first, min(first + _AT_ONCE, count))
            give_way()
        return parts + self._parts

    def _read(self, start: int, stop: int) -> Iterator[SegmentEntry]:
        """Return the encoded parts from start to stop, which is not included."""
        spans = pairwise(self._starts[start : stop + 1])
        shown = zip(self._segments.read(start, stop), self._changepoints.read(start, stop), strict=True)
        return (SegmentEntry(*span, *one) for span, one in zip(spans, shown, strict=True))

    def segments(self, rest: Sequence[SegmentEntry]) -> Sequence[Segment]:
        """Return the segments of all parts; rest: the parts that have not settled."""
        return MessageSequence(self._segments, (part.segment for part in (*self._parts, *rest)))

    def changepoints(self, rest: Sequence[SegmentEntry]) -> Sequence[Changepoint]:
        """Return the changepoints of all parts, without that of the first part; rest: as `segments`."""
        return MessageSequence(
            self._changepoints, (part.changepoint for part in (*self._parts, *rest)), first=1
        )

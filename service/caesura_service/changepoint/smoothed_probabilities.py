"""The probability that a segment starts at an observation, given the observations after it.

Within the window it depends on all observations so far; before it, it keeps its value from when it left the
window. When the filter is conditioned on a start, the probabilities of INTERVAL_REACH observations to either
side are stored as they were just before, and do not change.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence_window import FinalPath, PathSegment, outline_of
from caesura_service.changepoint.segment_model_set import SegmentModelSet

Array = NDArray[np.float64]

INTERVAL_REACH = 5  # observations to either side at which the same event may lie


class RunLengthFilterBase:
    """The smoothed probability of every observation so far."""

    def __init__(self) -> None:
        self.window: Array = np.zeros(0)  # of the last observations, now
        self._past = array("d")  # of those before them
        # Around a start, from an observation on: doubles, as bytes. Each segment of a session has one, and of
        # arrays the garbage collector would visit every one, again and again, while all stations wait.
        self._undecided: dict[int, tuple[int, bytes]] = {}

    @property
    def count(self) -> int:
        """The number of observations so far."""
        return len(self._past) + self.window.size

    def follow(self, window: Array, count: int) -> None:
        """Store the probabilities of the last observations, after `count` observations in all."""
        leaving = count - window.size - len(self._past)
        self.leave(self.window[:leaving].tolist(), window)

    def leave(self, left: Iterable[float], window: Array) -> None:
        """Store the probabilities that have left the window, and those of the observations in it."""
        self._past.extend(left)
        self.window = window

    def decide(self, start: int) -> None:
        """Store the probabilities around a start on which the filter is conditioned from now on."""
        first = max(start - INTERVAL_REACH, len(self._past))
        around = self.window[first - len(self._past) : start + INTERVAL_REACH + 1 - len(self._past)]
        self._undecided[start] = first, around.tobytes()

    def probability(self, start: int, about: int | None = None) -> float:
        """Return the probability that a segment starts at observation `start`.

        about: a conditioned start; its neighbours have the probabilities stored just before that.
        """
        return self.between(start, start, about)[0]

    def between(self, first: int, last: int, about: int | None = None) -> list[float]:
        """Return `probability` of every observation from the first to the last, both included."""
        past = len(self._past)
        found = self._past[first : last + 1].tolist() if first < past else []
        found += self.window[max(first - past, 0) : max(last + 1 - past, 0)].tolist()
        if about in self._undecided:
            begin, packed = self._undecided[about]
            around = array("d", packed)
            for s in range(max(first, begin), min(last + 1, begin + len(around))):
                found[s - first] = around[s - begin]
        return found

    def stands(self, start: int) -> bool:
        """Whether later observations can no longer change the probabilities at and next to a start.

        They are fixed once the INTERVAL_REACH observations after it have left the window, or are stored by
        `decide`.
        """
        first, packed = self._undecided.get(start, (0, b""))
        return start + INTERVAL_REACH < max(first + len(packed) // self._past.itemsize, len(self._past))

    def event(self, start: int, others: Collection[int] = ()) -> float:
        """Return the probability that a segment starts at this observation or a neighbour: one event on this
        grid.

        others: neighbours that are separate events.
        """
        first = max(start - 1, 0)
        near = self.between(first, min(start + 1, self.count - 1), about=start)
        return min(1.0, sum(p for s, p in enumerate(near, start=first) if s not in others))

    def everything(self, starts: Collection[int]) -> Array:
        """Return (n,) the probability at every observation.

        starts: those of all segments, as separate events.
        """
        result = np.array([*self._past, *self.window])
        for start in self._undecided:
            for s in self._near(start, {*starts} - {start}):
                result[s] = self.probability(s, about=start)
        return result

    def _near(self, start: int, others: Collection[int]) -> list[int]:
        return [s for s in (start - 1, start, start + 1) if 0 <= s < self.count and s not in others]


class SmoothedProbabilities(ABC):
    """The results computed from a filter's log joints and smoothed probabilities, for both filters."""

    lattice: SegmentModelSet
    final: FinalPath
    _smoothing: RunLengthFilterBase

    @property
    @abstractmethod
    def log_joint(self) -> Array:
        """(h,) log joint probability of each hypothesis and all observations so far."""

    @abstractmethod
    def map_path(self) -> list[PathSegment]:
        """The segments of the best segmentation from the root on, oldest first; the last is still growing."""

    def outline(self) -> list[tuple[int, int]]:
        """Return (start, number of the kind) for each segment of `map_path`."""
        return outline_of(self.lattice, self.map_path())

    @property
    def posterior(self) -> Array:
        """(h,) probability of each hypothesis."""
        joint = self.log_joint
        weight = np.exp(joint - joint.max(initial=-np.inf))
        result: Array = weight / weight.sum()
        return result

    @property
    def smoothed(self) -> Array:
        """(n,) smoothed probability at every observation.

        Around a conditioned start, that before the condition.
        """
        return self._smoothing.everything({segment.start for segment in (*self.final, *self.map_path())})

    def changepoint_probability(self, start: int, *, about: int | None = None) -> float:
        """Return the smoothed probability that a segment starts at observation `start`.

        It is conditional on all observations so far while it is in the window, and constant after that.
        about: a conditioned start; its neighbours have the probabilities stored just before that.
        """
        return self._smoothing.probability(start, about)

    def changepoint_probabilities(self, first: int, last: int, *, about: int | None = None) -> list[float]:
        """Return `changepoint_probability` of every observation from the first to the last, both included."""
        return self._smoothing.between(first, last, about)

    def stands(self, start: int) -> bool:
        """Whether later observations can no longer change the probabilities at and next to this start."""
        return self._smoothing.stands(start)

    def event_probability(self, start: int, others: Collection[int] = ()) -> float:
        """Return the smoothed probability of a start here or at a neighbour: one event, at the grid's
        resolution.

        others: neighbours that are separate events.
        """
        return self._smoothing.event(start, others)

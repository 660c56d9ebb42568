"""How probable it is that a segment starts at some observation, given what came after it.

Within the window that is what is known now, behind it what was known as the observation left the window.
Where a start was taken for certain, what is said of it and its neighbours stays as it was just before: of
INTERVAL_REACH observations to either side it is remembered.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Collection, Iterable

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.best_path_window import FinalPath, PathSegment, outline_of
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
        """Observations so far."""
        return len(self._past) + self.window.size

    def follow(self, window: Array, count: int) -> None:
        """Take what is known of the last observations, of `count`."""
        leaving = count - window.size - len(self._past)
        self.leave(self.window[:leaving].tolist(), window)

    def leave(self, left: Iterable[float], window: Array) -> None:
        """Take what has left the window, and what is known of those in it."""
        self._past.extend(left)
        self.window = window

    def decide(self, start: int) -> None:
        """A segment starts there for certain from now on; remember how probable it was."""
        first = max(start - INTERVAL_REACH, len(self._past))
        around = self.window[first - len(self._past) : start + INTERVAL_REACH + 1 - len(self._past)]
        self._undecided[start] = first, around.tobytes()

    def probability(self, start: int, about: int | None = None) -> float:
        """That a segment starts at observation `start`.

        about: where this start was taken for certain, its neighbours as they were just before, of what had
        been seen then.
        """
        return self.between(start, start, about)[0]

    def between(self, first: int, last: int, about: int | None = None) -> list[float]:
        """The same of every observation from the first to the last."""
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
        """Can nothing change any more that is said of a start and its neighbours?"""
        first, packed = self._undecided.get(start, (0, b""))
        return start + INTERVAL_REACH < max(first + len(packed) // self._past.itemsize, len(self._past))

    def event(self, start: int, others: Collection[int] = ()) -> float:
        """That a segment starts here or next to it: the same event, to the grid's resolution.

        others: neighbours that are events of their own.
        """
        first = max(start - 1, 0)
        near = self.between(first, min(start + 1, self.count - 1), about=start)
        return min(1.0, sum(p for s, p in enumerate(near, start=first) if s not in others))

    def everything(self, starts: Collection[int]) -> Array:
        """(n,) at every observation; starts: those of all segments, which are events of their own."""
        result = np.array([*self._past, *self.window])
        for start in self._undecided:
            for s in self._near(start, {*starts} - {start}):
                result[s] = self.probability(s, about=start)
        return result

    def _near(self, start: int, others: Collection[int]) -> list[int]:
        return [s for s in (start - 1, start, start + 1) if 0 <= s < self.count and s not in others]


class SmoothedProbabilities(ABC):
    """What follows from the joints and the smoothed probabilities of a filter, however it computes them."""

    lattice: SegmentModelSet
    final: FinalPath
    _smoothing: RunLengthFilterBase

    @property
    @abstractmethod
    def log_joint(self) -> Array:
        """(h,) log joint of each hypothesis and everything so far."""

    @abstractmethod
    def map_path(self) -> list[PathSegment]:
        """The segments of the best segmentation from the root on, oldest first; the last is still growing."""

    def outline(self) -> list[tuple[int, int]]:
        """Of each segment of `map_path` where it starts and the number of its kind."""
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
        """(n,) smoothed probability at every observation; about what was taken for certain, that before."""
        return self._smoothing.everything({segment.start for segment in (*self.final, *self.map_path())})

    def changepoint_probability(self, start: int, *, about: int | None = None) -> float:
        """Smoothed probability that a segment starts at observation `start`.

        Given everything so far while it is in the window, and as of its leaving the window after that.
        about: where this start was taken for certain, its neighbours as they were just before, of what had
        been seen then.
        """
        return self._smoothing.probability(start, about)

    def changepoint_probabilities(self, first: int, last: int, *, about: int | None = None) -> list[float]:
        """The same of every observation from the first to the last."""
        return self._smoothing.between(first, last, about)

    def stands(self, start: int) -> bool:
        """Can nothing change any more that is said of this start and those next to it?"""
        return self._smoothing.stands(start)

    def event_probability(self, start: int, others: Collection[int] = ()) -> float:
        """Smoothed probability of a start here or next to it: the same event, to the grid's resolution.

        others: neighbours that are events of their own.
        """
        return self._smoothing.event(start, others)

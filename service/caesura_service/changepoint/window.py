"""The evidence of the last few seconds, kept: what smoothing looks back on, and what taking a boundary for
certain sums anew.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard

Array = NDArray[np.float64]
Starts = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Ended:
    """A segment of the best segmentation up to some start: where it began, and what it was."""

    start: int
    kind_log_evidence: Array  # (kinds,)


class FinalPath(Sequence[Ended]):
    """The segments that no later observation can undo, oldest first, as rows of numbers; only grows."""

    def __init__(self, kinds: int) -> None:
        self._starts = array("q")
        self._evidence = array("d")  # row by row, one of `kinds` each
        self._kinds = kinds

    def __len__(self) -> int:
        return len(self._starts)

    @overload
    def __getitem__(self, index: int) -> Ended: ...
    @overload
    def __getitem__(self, index: slice) -> list[Ended]: ...
    def __getitem__(self, index: int | slice) -> Ended | list[Ended]:
        if isinstance(index, slice):
            return [self._read(i) for i in range(len(self))[index]]
        return self._read(range(len(self))[index])

    def __iter__(self) -> Iterator[Ended]:
        return map(self._read, range(len(self)))

    def extend(self, settled: Iterable[Ended]) -> None:
        """These are final too."""
        for ended in settled:
            self._starts.append(ended.start)
            self._evidence.extend(ended.kind_log_evidence.tolist())

    def _read(self, i: int) -> Ended:
        return Ended(self._starts[i], np.array(self._evidence[i * self._kinds : (i + 1) * self._kinds]))


class Window:
    """Of every start among the last `size` observations: its priors, and its evidence at every age since."""

    def __init__(self, size: int, kinds: int) -> None:
        self.size = size
        self._evidence = np.full((size, size), -np.inf)  # [start mod size, age]
        self._kinds = np.zeros((size, size, kinds))  # the same of each kind
        self._prior = np.full(size, -np.inf)  # A(start) at [start mod size]
        self._map = np.full(size, -np.inf)  # the same with maximum

    def oldest(self, count: int) -> int:
        """The first observation still in the window, of `count`."""
        return max(0, count - self.size)

    def priors(self, starts: Starts) -> tuple[Array, Array]:
        """A of some starts (h,), and the same with maximum."""
        return self._prior[starts % self.size], self._map[starts % self.size]

    def remember(
        self, now: int, starts: Starts, log_evidence: Array, kinds: Array, log_prior: float, map_prior: float
    ) -> None:
        """Evidence (h,), and that of each kind (h, kinds), of what ends now; the priors of a start there."""
        self._evidence[now % self.size] = -np.inf
        self._prior[now % self.size], self._map[now % self.size] = log_prior, map_prior
        recent = starts > now - self.size
        starts = starts[recent]
        self._evidence[starts % self.size, now - starts] = log_evidence[recent]
        self._kinds[starts % self.size, now - starts] = kinds[recent]

    def smoothed(self, count: int, hazard: Hazard, log_total: float) -> Array:
        """(size,) probability that a segment starts, at every observation still in the window.

        log_total: log evidence of everything.
        """
        first = self.oldest(count)
        size = count - first
        ages = np.arange(size)
        log_mass, log_survival = hazard.log_mass(ages + 1), hazard.log_survival(ages)
        backward = np.empty(size)
        for i in range(size - 1, -1, -1):
            evidence = self._evidence[(first + i) % self.size, : size - i]
            terms = log_mass[: size - i] + evidence
            terms[:-1] += backward[i + 1 :]
            terms[-1] = log_survival[size - 1 - i] + evidence[-1]
            backward[i] = log_sum_exp(terms)
        prior = self._prior[(first + ages) % self.size]
        result: Array = np.exp(np.minimum(prior + backward - log_total, 0.0))
        return result

    def sum_from(self, start: int, count: int, hazard: Hazard) -> tuple[dict[int, Ended], float, float]:
        """Keep only the segmentations with a boundary at `start`, and sum priors anew from there.

        Returns what ends at each later start of the best segmentation, and the next start's two priors.
        """
        for before in range(self.oldest(count), start):
            self._evidence[before % self.size, start - before :] = -np.inf
        ended: dict[int, Ended] = {}
        starts = np.arange(start, count)
        rows, log_mass = starts % self.size, hazard.log_mass(1 + np.arange(starts.size))
        for end in range(start + 1, count + 1):
            size = end - start
            mass = log_mass[:size][::-1] + self._evidence[rows[:size], end - 1 - starts[:size]]
            total = float(log_sum_exp(self._prior[rows[:size]] + mass))
            scores = self._map[rows[:size]] + mass
            best = int(np.argmax(scores))
            ended[end] = Ended(start + best, self._kinds[rows[best], size - 1 - best].copy())
            if end < count:
                self._prior[end % self.size], self._map[end % self.size] = total, scores[best]
        return ended, total, float(scores[best])

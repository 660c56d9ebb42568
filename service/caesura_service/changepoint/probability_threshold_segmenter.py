"""The thesis' decision: a changepoint is where the smoothed probability is above a threshold (thesis 4.1).

Neighbouring samples above it are one changepoint, at the most probable of them; the kind of a segment between
two changepoints follows from the evidence of its samples. Unlike the best segmentation, the result may
contain changepoints that exclude each other, and no changepoint where the probability is spread over many
samples.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence_window import PathSegment
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.segment_model_set import SegmentModelSet

Array = NDArray[np.float64]

THRESHOLD = 0.2
LOOK_BACK = 8  # samples before its start that a segment's models look at, at most


class Run(NamedTuple):
    """Neighbouring samples above the threshold, from first to last, and the most probable of them."""

    first: int
    last: int
    start: int


def check_level(level: float) -> None:
    """Raise ValueError for a threshold that is not between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"threshold is {level}, expected a probability between 0 and 1")


def runs_above(
    probability: ArrayLike, level: float = THRESHOLD, *, offset: int = 0, boundaries: Collection[int] = ()
) -> list[Run]:
    """Return the changepoints in a smoothed probability (n,), whose first sample is number `offset`.

    boundaries: starts that a correction makes certain; each begins a run of its own. Raises ValueError as
    `check_level`.
    """
    check_level(level)
    p = np.asarray(probability, float)
    runs: list[list[int]] = []
    for s in np.flatnonzero(p > level).tolist():
        if runs and runs[-1][-1] == s - 1 and s + offset not in boundaries:
            runs[-1].append(s)
        else:
            runs.append([s])
    return [Run(r[0] + offset, r[-1] + offset, r[int(np.argmax(p[r]))] + offset) for r in runs]


def threshold_path(
    lattice: SegmentModelSet,
    data: Sequence[ModelInput],
    probability: ArrayLike,
    level: float = THRESHOLD,
    *,
    boundaries: Collection[int] = (),
) -> tuple[PathSegment, ...]:
    """Return the segments between the changepoints in a smoothed probability, the first from observation 0
    on.

    probability: (n,) that a segment starts at each observation; boundaries: as for `runs_above`. Raises
    ValueError if the numbers of probabilities and observations differ, or as `runs_above`.
    """
    if np.shape(probability) != (len(data),):
        raise ValueError(f"probability is {np.shape(probability)}, expected ({len(data)},)")
    runs = runs_above(probability, level, boundaries=boundaries)
    starts = sorted({0, *(run.start for run in runs)})
    return tuple(
        PathSegment(start, _Tape(lattice, data[:end], start, _last_gap(start, boundaries)).kinds[-1])
        for start, end in pairwise([*starts, len(data)])
    )


def _last_gap(start: int, boundaries: Collection[int]) -> int:
    """Return the latest boundary up to a start; 0 if there is none."""
    return max((boundary for boundary in boundaries if boundary <= start), default=0)


@dataclass
class ThresholdSegmenter:
    """Computes `threshold_path` online: steps a filter, and keeps the evidence from each start.

    A changepoint is final once it and the samples next to it have left the filter's window.
    """

    online: ChangepointFilter
    level: float = THRESHOLD
    final: list[PathSegment] = field(default_factory=list)  # the segments before the root
    root: int = 0  # the latest final start

    def __post_init__(self) -> None:
        check_level(self.level)
        self._data: list[ModelInput] = []
        self._undecided = 0  # the first sample that may yet be part of a changepoint
        self._runs: list[Run] = []
        self._tapes: dict[int, _Tape] = {}
        self._said: set[int] = set()  # starts that are given

    def step(self, observed: ModelInput, boundary: bool = False, *, changepoint: bool | None = None) -> None:
        """Process one observation. Raises ValueError as `RunLengthFilter.step`."""
        if changepoint:
            self._said.add(self.online.count)
        self.online.step(observed, boundary=boundary, changepoint=changepoint)
        self._data.append(observed)
        for tape in self._tapes.values():
            tape.extend(observed)
        self._choose()
        self._settle()

    def path(self) -> list[PathSegment]:
        """The segments from the root on, oldest first; the last is still growing."""
        starts = [*self._starts, self.online.count]
        return [self._ended(start, end) for start, end in pairwise(starts)]

    @property
    def _starts(self) -> list[int]:
        return [self.root, *(run.start for run in self._runs if run.start > self.root)]

    def _choose(self) -> None:
        undecided = range(self._undecided, self.online.count)
        self._runs = runs_above(
            [self.online.changepoint_probability(s) for s in undecided],
            self.level,
            offset=self._undecided,
            boundaries=self._said.union(self.online.boundaries),
        )
        self._tapes = {start: self._tapes.get(start) or self._tape(start) for start in self._starts}

    def _tape(self, start: int) -> _Tape:
        return _Tape(self.online.lattice, self._data, start, _last_gap(start, self.online.boundaries))

    def _settle(self) -> None:
        left = max(0, self.online.count - self.online.parameters.window)  # the window; what is before stands
        while self._runs and self._runs[0].last + 1 < left:
            start = self._runs.pop(0).start
            if start > self.root:
                self.final.append(self._ended(self.root, start))
                del self._tapes[self.root]
                self.root = start
        self._undecided = min([left, *(run.first for run in self._runs)])

    def _ended(self, start: int, end: int) -> PathSegment:
        return PathSegment(start, self._tapes[start].kinds[end - start - 1])


class _Tape:
    """The evidence of each kind from one start on, up to every sample after it.

    since: the first sample that the segment's evidence depends on, at or before its start.
    """

    def __init__(self, lattice: SegmentModelSet, data: Sequence[ModelInput], start: int, since: int) -> None:
        self.kinds: list[Array] = []  # (kinds,) log evidence of data[start : start + 1 + i]
        self._lattice = lattice
        self._rows = lattice.empty()
        self._first = int(lattice.stepwise and start == since)  # the sample with which the evidence begins
        for observed in data[max(start - LOOK_BACK, since) : start]:
            self._rows = lattice.select(lattice.extend(self._rows, observed), np.array([-1]))
        for observed in data[start:]:
            self.extend(observed)

    def extend(self, observed: ModelInput) -> None:
        """Add the evidence of one more sample."""
        mine = 0 if len(self.kinds) > self._first else -1  # its own row comes last, and then stays first
        rows = self._lattice.extend(self._rows, observed)
        self._rows = self._lattice.select(rows, np.array([mine]))
        self.kinds.append(self._lattice.kind_log_evidence(self._rows)[0])

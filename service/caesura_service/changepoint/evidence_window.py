"""The evidence of the last few seconds, which smoothing and conditioning sum again."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard, log_mass
from caesura_service.changepoint.segment_model_set import SegmentModelSet

Array = NDArray[np.float64]
Starts = NDArray[np.int64]
Groups = NDArray[np.int64]
Node = tuple[int, int]  # a start, and the group of the segment that ends there

NOTHING = -1  # the group before the first segment


@dataclass(frozen=True, slots=True)
class PathSegment:
    """A segment of the best segmentation up to some start: its start and the evidence of its kinds.

    kind_log_evidence: (kinds,); group: that of its kind, None without groups; before: the group of the
    segment that ends at its start.
    """

    start: int
    kind_log_evidence: Array
    group: int | None = None
    before: int = NOTHING

    @property
    def node(self) -> Node:
        """The key of the best segmentation before this segment: its start, and the group before it."""
        return self.start, self.before


def outline_of(lattice: SegmentModelSet, path: Iterable[PathSegment]) -> list[tuple[int, int]]:
    """Return (start, number of the best kind) for each segment of a path."""
    return [(ended.start, lattice.best_kind(ended.kind_log_evidence, ended.group)) for ended in path]


class FinalPath(Sequence[PathSegment]):
    """The segments that no later observation can change, oldest first, as rows of numbers; append-only."""

    def __init__(self, kinds: int) -> None:
        self._starts = array("q")
        self._groups = array("q")
        self._evidence = array("d")  # row by row, one of `kinds` each
        self._kinds = kinds

    def __len__(self) -> int:
        return len(self._starts)

    @overload
    def __getitem__(self, index: int) -> PathSegment: ...
    @overload
    def __getitem__(self, index: slice) -> list[PathSegment]: ...
    def __getitem__(self, index: int | slice) -> PathSegment | list[PathSegment]:
        if isinstance(index, slice):
            return [self._read(i) for i in range(len(self))[index]]
        return self._read(range(len(self))[index])

    def __iter__(self) -> Iterator[PathSegment]:
        return map(self._read, range(len(self)))

    def extend(self, settled: Iterable[PathSegment]) -> None:
        """Append segments that have become final."""
        for ended in settled:
            self._starts.append(ended.start)
            self._groups.append(NOTHING if ended.group is None else ended.group)
            self._evidence.extend(ended.kind_log_evidence.tolist())

    def _read(self, i: int) -> PathSegment:
        kinds = np.array(self._evidence[i * self._kinds : (i + 1) * self._kinds])
        return PathSegment(self._starts[i], kinds, self._groups[i], self._groups[i - 1] if i else NOTHING)


class Links(NamedTuple):
    """The sums and maxima over the segmentations before one start, for each group of a segment that begins
    there.

    prior, best: (groups,) A(start), and the same with maximum; before: (groups,) the group of the segment
    that the best segmentation has before it; total, ended: (groups,) log sum, and log maximum, over the
    segmentations that end there, by the group of their last segment, of which `likeliest` has the largest
    maximum; free: whether every group may follow every other here; opens: whether the past before the start
    is unknown, as at the first observation and after a gap.
    """

    prior: Array
    best: Array
    before: Groups
    total: Array
    ended: Array
    likeliest: int
    free: bool
    opens: bool = False

    @property
    def nodes(self) -> set[int]:
        """The groups of the segments that end here and precede a possible segment, the likeliest included."""
        return {*self.before[self.best > -np.inf].tolist(), self.likeliest}


def first_links(groups: int) -> Links:
    """Return the links of the first segment, which has no segment before it."""
    zero = np.zeros(groups)
    return Links(zero, zero, np.full(groups, NOTHING), zero, zero, NOTHING, free=True, opens=True)


def link(total: Array, ended: Array, lattice: SegmentModelSet, *, free: bool, opens: bool = False) -> Links:
    """Return the links of a start; total, ended: (groups,) log sum and log maximum of the paths before it."""
    scores = ended[:, None] + _weights(lattice.log_transition, free=free)
    before = scores.argmax(axis=0)
    best = scores[before, np.arange(before.size)]
    prior = log_sum_exp(total[:, None] + _weights(lattice.tempered_transition, free=free), axis=0)
    return Links(prior, best, before, total, ended, int(ended.argmax()), free, opens)


def _weights(log_transition: Array, *, free: bool) -> Array:
    """Return (groups, groups) log weight of a group after another at a start, 0 if the start is free."""
    return np.zeros_like(log_transition) if free else log_transition


class Window:
    """The links of each of the last `size` observations as a start, and its evidence at every age since.

    hazard: to the power of the model set.
    """

    def __init__(self, size: int, kinds: int, groups: int, hazard: Hazard) -> None:
        self.size = size
        self._tables = [_tables(one, size) for one in (hazard, hazard.residual)]
        self._evidence = np.full((size, size, groups), -np.inf)  # [start mod size, age] to its power
        self._map_evidence = np.full((size, size, groups), -np.inf)  # the same as it is
        self._kinds = np.zeros((size, size, kinds))  # the same of each kind
        self._links: list[Links] = [first_links(groups)] * size  # at [start mod size]

    def oldest(self, count: int) -> int:
        """Return the first observation in the window after `count` observations."""
        return max(0, count - self.size)

    def links(self, start: int) -> Links:
        """Return the links of a start in the window."""
        return self._links[start % self.size]

    def remember(
        self, now: int, starts: Starts, log_evidence: Array, map_evidence: Array, kinds: Array, links: Links
    ) -> None:
        """Store the evidence (h, groups), twice, and (h, kinds) of segments that end now, and a start's
        links.
        """
        self._evidence[now % self.size] = self._map_evidence[now % self.size] = -np.inf
        self._links[now % self.size] = links
        recent = starts > now - self.size
        starts = starts[recent]
        self._evidence[starts % self.size, now - starts] = log_evidence[recent]
        self._map_evidence[starts % self.size, now - starts] = map_evidence[recent]
        self._kinds[starts % self.size, now - starts] = kinds[recent]

    def smoothed(self, count: int, log_transition: Array, log_total: float) -> Array:
        """Return (size,) the probability that a segment starts, at every observation in the window.

        log_transition: to the power of the model set. log_total: log evidence of all observations.
        """
        first = self.oldest(count)
        size = count - first
        followed = np.empty((size, len(log_transition)))  # [start], by the group of the segment before
        started = np.empty((size, len(log_transition)))  # [start], by the group of the segment that starts
        for i in range(size - 1, -1, -1):
            evidence, links = self._evidence[(first + i) % self.size, : size - i], self.links(first + i)
            log_mass, log_survival = self._tables[links.opens]
            terms = log_mass[: size - i] + evidence
            terms[:-1] += followed[i + 1 :]
            terms[-1] = log_survival[size - 1 - i] + evidence[-1]
            backward = log_sum_exp(terms, axis=0)
            followed[i] = log_sum_exp(backward + _weights(log_transition, free=links.free), axis=1)
            started[i] = links.prior + backward
        result: Array = np.exp(np.minimum(log_sum_exp(started) - log_total, 0.0))
        return result

    def sum_from(
        self, start: int, before: int | None, count: int, hazard: Hazard, lattice: SegmentModelSet
    ) -> tuple[dict[Node, PathSegment], Links]:
        """Keep only the segmentations with a boundary at `start`, and sum again from there.

        before: the group of the segment that ends at `start`, if it is certain from now on. Returns the best
        segments that end at each later start, and the next start's links.
        """
        for earlier in range(self.oldest(count), start):
            self._evidence[earlier % self.size, start - earlier :] = -np.inf
            self._map_evidence[earlier % self.size, start - earlier :] = -np.inf
        if before is not None:
            self._links[start % self.size] = _with_past(self.links(start), before, lattice.log_transition)
        ended: dict[Node, PathSegment] = {}
        starts = np.arange(start, count)
        rows, opens = starts % self.size, np.array([self.links(s).opens for s in starts.tolist()])
        for end in range(start + 1, count + 1):
            size = end - start
            at = rows[:size], end - 1 - starts[:size]
            past = [self.links(s) for s in range(start, end)]
            mass = log_mass(hazard, end - starts[:size], opens[:size])[:, None]
            evidence = lattice.power * mass + self._evidence[at]
            total = log_sum_exp(np.array([one.prior for one in past]) + evidence, axis=0)
            scores = np.array([one.best for one in past]) + (mass + self._map_evidence[at])
            best = scores.argmax(axis=0)
            kept = self.links(end) if end < count else None
            free, opens_here = (kept.free, kept.opens) if kept else (False, False)
            links = link(total, scores.max(axis=0), lattice, free=free, opens=opens_here)
            for group in links.nodes:
                s = int(best[group])
                kinds = self._kinds[rows[s], size - 1 - s].copy()
                ended[end, group] = PathSegment(start + s, kinds, group, int(past[s].before[group]))
            if end < count:
                self._links[end % self.size] = links
        return ended, links


def _tables(hazard: Hazard, size: int) -> tuple[Array, Array]:
    """Return (size, 1) log g(1…size) and (size,) log S(0…size − 1)."""
    ages = np.arange(size)
    return hazard.log_mass(ages + 1)[:, None], hazard.log_survival(ages)


def _with_past(links: Links, before: int, log_transition: Array) -> Links:
    """Return the links of a start at which a segment of the group `before` certainly ends."""
    best: Array = links.ended[before] + _weights(log_transition, free=links.free)[before]
    return links._replace(best=best, before=np.full(best.size, before))

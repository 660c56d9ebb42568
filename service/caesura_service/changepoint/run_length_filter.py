"""The run-length filter on starts: the probability of each start of the current segment after each sample.

With L_j(s,t) the evidence of samples s..t as one segment of group j, S and g from the hazard, and R the log
weight of a group after another (`SegmentModelSet.log_transition`). In sums all of them are taken to the power
of the model set, in maxima as they are:

    joint(s,t) = logsumexp_j [A_j(s) + log S(t−s) + L_j(s,t)]
    E_i(t+1)   = logsumexp_s [A_i(s) + log g(t−s+1) + L_i(s,t)]
    A_j(t+1)   = logsumexp_i [E_i(t+1) + R_ij]

the growth and changepoint steps of Adams & MacKay 2007 (thesis 2.1.5, steps 3–7) written on starts instead of
run lengths. The same with maximum in place of the sum is the MAP path (Fearnhead & Liu 2007). A backward pass
over the evidence kept for the last `window` samples gives the smoothed changepoint probability, exact inside
the window:

    B_i(τ) = logaddexp( log S(t−τ) + L_i(τ,t),  logsumexp_u,j [log g(u−τ) + L_i(τ,u−1) + R_ij + B_j(u)] )
    P(changepoint at τ | x) = exp(logsumexp_j [A_j(τ) + B_j(τ)] − log Z)

With a constant hazard P(run length 0) is 1/λ for any data; only this delayed probability and the MAP path are
informative.

A changepoint becomes final, never to be revised, in one of two ways: all living hypotheses descend from it,
or it is certain, and the filter is conditioned on it: segments that would reach across it leave the window's
evidence, and A and its maximum are summed anew from there. Either way all living hypotheses descend from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.evidence_window import (
    NOTHING,
    FinalPath,
    Groups,
    Node,
    PathSegment,
    Starts,
    Window,
    first_links,
    link,
)
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Hazard, Tempered, log_mass, log_survival
from caesura_service.changepoint.segment_model_set import LatticeRows, SegmentModelSet
from caesura_service.changepoint.smoothed_probabilities import RunLengthFilterBase, SmoothedProbabilities

Array = NDArray[np.float64]


@dataclass
class RunLengthFilter(SmoothedProbabilities):
    """Processes observations one by one; the same observations give the same state, bit for bit."""

    lattice: SegmentModelSet
    hazard: Hazard
    parameters: FilterParameters = field(default_factory=FilterParameters)

    def __post_init__(self) -> None:
        kinds, groups = len(self.lattice.kinds), len(self.lattice.log_transition)
        self._tempered = Tempered(self.hazard, self.lattice.power)
        with np.errstate(divide="ignore"):
            self._log_prune_ratio = float(np.log(self.parameters.prune_ratio))
        self.count = 0  # observations taken
        self.starts: Starts = np.zeros(0, np.int64)  # (h,) ascending
        self.log_prior: Array = np.zeros((0, groups))  # (h, groups) A(s)
        self.map_prior: Array = np.zeros((0, groups))  # (h, groups) the same with maximum
        self.before: Groups = np.zeros((0, groups), np.int64)  # (h, groups) of the best segmentation before
        self.opening = 0  # the last observation that has no step from one before
        self.rows: LatticeRows = self.lattice.empty()
        self.kind_log_evidence: Array = np.zeros((0, kinds))  # (h, kinds)
        self.log_evidence: Array = np.zeros(
            (0, groups)
        )  # (h, groups) over the kinds of a group, to its power
        self.map_evidence: Array = np.zeros((0, groups))  # (h, groups) the same as it is, for the maximum
        self.ended: dict[Node, PathSegment] = {}  # what ends at a start that living hypotheses descend from
        self.root_node: Node = (0, NOTHING)  # the latest that every living hypothesis descends from
        self.final = FinalPath(kinds)  # the segments before the root
        self.boundaries: list[int] = []  # starts that a correction makes certain
        self.capped = 0  # steps on which the cap bit
        self._window = Window(self.parameters.window, kinds, groups, self._tempered)
        self._smoothing = RunLengthFilterBase()
        self._next = first_links(groups)  # of the hypothesis that the next observation starts

    @property
    def root(self) -> int:
        """The latest start from which all living hypotheses descend."""
        return self.root_node[0]

    def step(self, observed: ModelInput, boundary: bool = False, *, changepoint: bool | None = None) -> None:
        """Process one observation. boundary: whether it follows a gap, so that it begins an unconnected
        segment.

        changepoint: whether a segment starts at it, if known (a hazard of 1 or 0). False is ignored for the
        first observation, and for the first after a gap. After a gap or a known start every kind may follow
        every other. Raises ValueError if a value is not finite, and then changes nothing.
        """
        check_finite(observed, self.count)
        if self.count and (boundary or changepoint):
            self._next = link(self._next.total, self._next.ended, self.lattice, free=True, opens=boundary)
        if boundary and self.count:
            self._keep(np.zeros(self.starts.size, bool))
            self.boundaries.append(self.count)
        self._grow(observed, changepoint)
        self._prepare_next()
        self._prune()
        self._settle()
        self._smooth()
        if (start := self._certain()) is not None:
            self.condition_on_start(start)

    def condition_on_start(self, start: int) -> None:
        """Condition on a segment that starts at observation `start`; the segments before it become final.

        Posterior, best segmentation and smoothed probabilities are from now on those over the segmentations
        with this boundary; `event_probability` keeps its probability before that. The segments before it are
        those of the best segmentation. Raises ValueError for a start that is final already, or out of the
        window.
        """
        check_start(start, self.root, self.count, self.parameters)
        self._smoothing.decide(start)
        before = self._group_before(start)
        self._sum_from(start, before)
        if before is None:  # now that the best segmentation has this start
            self._sum_from(start, self._group_before(start))
        self._settle()
        self._smooth()

    def _group_before(self, start: int) -> int | None:
        """Return the group of the segment that ends at a start of the best segmentation; None without one."""
        return {segment.start: segment.before for segment in self.map_path()}.get(start)

    def _sum_from(self, start: int, before: int | None) -> None:
        """Keep the hypotheses from a start on, and sum again over the segmentations before them."""
        keep = self.starts >= start
        ended, self._next = self._window.sum_from(start, before, self.count, self.hazard, self.lattice)
        self.ended |= ended
        links = [self._window.links(s) for s in self.starts[keep].tolist()]
        self._select(keep)
        self.log_prior = np.array([one.prior for one in links])
        self.map_prior = np.array([one.best for one in links])
        self.before = np.array([one.before for one in links])
        self._forget()

    @property
    def log_joint(self) -> Array:
        """(h,) log joint probability of each hypothesis and all observations so far."""
        return log_sum_exp(self._joint, axis=1)

    @property
    def _joint(self) -> Array:
        """Return (h, groups) log joint probability of each hypothesis, by the group of its segment."""
        survived = log_survival(self._tempered, self.count - 1 - self.starts, self._opens)[:, None]
        return self.log_prior + survived + self.log_evidence

    @property
    def _opens(self) -> NDArray[np.bool_]:
        """Return (h,) whether the past before the start of each hypothesis is unknown."""
        opens: NDArray[np.bool_] = self.starts == self.opening
        return opens

    def map_path(self) -> list[PathSegment]:
        """The segments of the best segmentation from the root on, oldest first; the last is still growing."""
        survived = log_survival(self.hazard, self.count - 1 - self.starts, self._opens)[:, None]
        scores = self.map_prior + survived + self.map_evidence
        best, group = np.unravel_index(int(np.argmax(scores)), scores.shape)
        path = [self._segment(int(best), int(group))]
        while path[-1].node != self.root_node:
            path.append(self.ended[path[-1].node])
        return path[::-1]

    def _segment(self, place: int, group: int) -> PathSegment:
        """Return a living hypothesis as a segment of this group; place: its index among the living."""
        kinds, before = self.kind_log_evidence[place].copy(), int(self.before[place, group])
        return PathSegment(int(self.starts[place]), kinds, group, before)

    def _grow(self, observed: ModelInput, changepoint: bool | None) -> None:
        if not self.starts.size:
            self.opening = self.count
        self.rows = self.lattice.extend(self.rows, observed)
        if self.lattice.stepwise and self.count == self.opening + 1 and not changepoint:
            self.rows = self.lattice.select(self.rows, np.array([1]))
        else:
            self.starts = np.append(self.starts, self.count)
            self.log_prior = np.concatenate([self.log_prior, self._next.prior[None]])
            self.map_prior = np.concatenate([self.map_prior, self._next.best[None]])
            self.before = np.concatenate([self.before, self._next.before[None]])
        self.kind_log_evidence = self.lattice.kind_log_evidence(self.rows)
        self.log_evidence = self.lattice.combine(self.lattice.temper(self.kind_log_evidence))
        self.map_evidence = self.lattice.combine(self.kind_log_evidence)
        self._heed(changepoint)
        born = self.count in self.starts[-1:]
        nowhere = np.full(len(self._next.prior), -np.inf)
        links = self._next if born else self._next._replace(prior=nowhere, best=nowhere)
        followed = self.log_prior > -np.inf
        tempered, plain = (np.where(followed, e, -np.inf) for e in (self.log_evidence, self.map_evidence))
        self._window.remember(self.count, self.starts, tempered, plain, self.kind_log_evidence, links)
        self.count += 1

    def _heed(self, changepoint: bool | None) -> None:
        """Keep only the newborn hypothesis if `changepoint` is true, all others if it is false."""
        newborn = self.starts == self.count
        if changepoint is not None and (changepoint or newborn.size > 1):
            self._keep(newborn == changepoint)

    def _prepare_next(self) -> None:
        ages = self.count - self.starts
        tempered, mass = (log_mass(one, ages, self._opens)[:, None] for one in (self._tempered, self.hazard))
        total = log_sum_exp(self.log_prior + (tempered + self.log_evidence), axis=0)
        scores = self.map_prior + (mass + self.map_evidence)
        self._next = link(total, scores.max(axis=0), self.lattice, free=False)
        for group in self._next.nodes:
            self.ended[self.count, group] = self._segment(int(scores[:, group].argmax()), group)

    def _prune(self) -> None:
        p, pairs, joint = self.parameters, self._joint, self.log_joint
        least = joint.max() + self._log_prune_ratio
        young = np.arange(joint.size) >= joint.size - p.keep_youngest
        dropped = (pairs < least) & ~young[:, None]
        self.log_prior[dropped] = self.map_prior[dropped] = -np.inf
        keep = (joint >= least) | young
        if keep.sum() > p.cap:
            self.capped += 1
            joint = np.where(keep, self.log_joint, -np.inf)
            ranked = np.argsort(joint[: keep.size - p.keep_youngest], kind="stable")
            keep[ranked[: keep.size - p.cap]] = False
        if dropped.any() or not keep.all():
            self._keep(keep)

    def _keep(self, keep: NDArray[np.bool_]) -> None:
        self._select(keep)
        self._forget()

    def _select(self, keep: NDArray[np.bool_]) -> None:
        self.starts, self.log_prior = self.starts[keep], self.log_prior[keep]
        self.map_prior, self.log_evidence = self.map_prior[keep], self.log_evidence[keep]
        self.map_evidence = self.map_evidence[keep]
        self.kind_log_evidence, self.before = self.kind_log_evidence[keep], self.before[keep]
        self.rows = self.lattice.select(self.rows, keep)

    @property
    def _nodes(self) -> set[Node]:
        """The nodes from which the living hypotheses, and the next one, descend."""
        living = np.argwhere(self.map_prior > -np.inf)
        nodes = {(int(self.starts[i]), int(self.before[i, g])) for i, g in living}
        return nodes | {(self.count, group) for group in self._next.nodes}

    def _forget(self) -> None:
        """Drop the nodes from which neither a living hypothesis nor the next one descends."""
        wanted: dict[Node, PathSegment] = {}
        for node in self._nodes:
            while node != self.root_node and node not in wanted:
                wanted[node] = self.ended[node]
                node = wanted[node].node
        self.ended = wanted

    def _settle(self) -> None:
        """Move the root to the latest node that all hypotheses, the next one included, have in common."""
        root = node = _common_ancestor(self._nodes, self.ended)
        settled: list[PathSegment] = []
        while node != self.root_node:
            settled.append(self.ended.pop(node))
            node = settled[-1].node
        self.final.extend(settled[::-1])
        self.root_node = root

    def _certain(self) -> int | None:
        """Return the latest start of the best segmentation that is certain and not yet final."""
        p = self.parameters
        oldest, youngest = self.count - p.window, self.count - 1 - p.certain_after
        starts = [segment.start for segment in self.map_path()]
        for i in range(len(starts) - 1, 0, -1):
            others = (starts[i - 1], *starts[i + 1 : i + 2])
            if oldest <= starts[i] <= youngest and self.event_probability(starts[i], others) > p.certain:
                return starts[i]
        return None

    def _smooth(self) -> None:
        total, transition = float(log_sum_exp(self.log_joint)), self.lattice.tempered_transition
        smoothed = self._window.smoothed(self.count, transition, total)
        self._smoothing.follow(smoothed, self.count)


def _common_ancestor(nodes: set[Node], ended: Mapping[Node, PathSegment]) -> Node:
    """Return the latest node that the ancestries of all nodes share, the nodes themselves included."""
    nodes = set(nodes)
    while len(nodes) > 1:
        latest = max(nodes)
        nodes.remove(latest)
        nodes.add(ended[latest].node)
    return nodes.pop()


def check_finite(observed: ModelInput, count: int) -> None:
    """Raise ValueError for an observation with a value that is not finite."""
    for name in ("position", "force", "rotation", "torsion"):
        value = getattr(observed, name)
        if not np.isfinite(value).all():
            raise ValueError(f"observation {count}: {name} is {value.tolist()}, expected finite numbers")


def check_start(start: int, root: int, count: int, parameters: FilterParameters) -> None:
    """Raise ValueError for a start that is final already, or out of the window."""
    first = max(root, count - parameters.window - 1) + 1
    if not first <= start < count:
        raise ValueError(f"start is {start}, expected {first} to {count - 1}")

"""The exact posterior over all segmentations of a whole recording. Fearnhead 2006; thesis 2.1.4.

With P_j(t,s) the evidence of observations t..s as one segment of group j, g and S from the hazard, R the
weight of a group after another (`SegmentModelSet.log_transition`), and n the last:

    Q_j(t) = Σ_{s<n} P_j(t,s) g(s−t+1) F_j(s+1) + P_j(t,n) S(n−t),    F_i(t) = Σ_j R_ij Q_j(t)

is the evidence of observations t..n, given a segment of group j that starts at t, and

    C_j(0) = Q_j(0) / Σ_k Q_k(0),    C_j(e) = Σ_{t<e,i} C_i(t) P_i(t,e−1) g(e−t) R_ij Q_j(e) / Q_i(t)

the probability that a segment of group j starts at e: thesis (2.13)–(2.18), corrected, without a second prior
on the number of changepoints. The same recursion with maximum gives the best segmentation. In sums, evidence,
hazard and R are to the power of the model set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.evidence_window import NOTHING, PathSegment
from caesura_service.changepoint.hazard import Hazard, Tempered, log_mass, log_survival
from caesura_service.changepoint.probability_threshold_segmenter import THRESHOLD, threshold_path
from caesura_service.changepoint.segment_model_set import SegmentModelSet

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OfflinePosterior:
    """The result of segmenting a whole recording at once.

    changepoint_probability: (n,) that a segment starts at each observation; path: the best segmentation.
    """

    log_evidence: float
    changepoint_probability: Array
    path: tuple[PathSegment, ...]
    lattice: SegmentModelSet = field(repr=False)
    data: tuple[ModelInput, ...] = field(repr=False)

    def threshold_path(self, level: float = THRESHOLD) -> tuple[PathSegment, ...]:
        """The segments between changepoints whose probability is above a level. Raises as `runs_above`."""
        return threshold_path(self.lattice, self.data, self.changepoint_probability, level)


@dataclass(frozen=True)
class _Evidence:
    """Log P(t,s) for every start t: values[t][i] is that of t..t+i, (groups,), to the lattice's power.

    best: the same without the power, for the maximum; kinds: (kinds,). Pruned entries are absent.
    """

    values: list[Array]
    best: list[Array]
    kinds: list[Array]


def segment_offline(
    lattice: SegmentModelSet, hazard: Hazard, data: Sequence[ModelInput], *, prune_ratio: float = 0.0
) -> OfflinePosterior:
    """Segment a whole recording at once.

    prune_ratio: starts whose share of the probability so far falls below it are dropped (thesis (2.34), with
    the inequality corrected); 0 keeps all, at quadratic cost. Raises ValueError for an empty recording.
    """
    if not data:
        raise ValueError("no observations, expected at least one")
    tempered = Tempered(hazard, lattice.power)
    evidence, n = _collect(lattice, tempered, data, prune_ratio), len(data)
    backward = _Backward(evidence, tempered, hazard, lattice, n)
    return OfflinePosterior(
        log_evidence=float(log_sum_exp(backward.total[0])),
        changepoint_probability=_marginals(evidence, tempered, lattice.tempered_transition, backward),
        path=_path(evidence, backward, n),
        lattice=lattice,
        data=tuple(data),
    )


def _collect(
    lattice: SegmentModelSet, hazard: Hazard, data: Sequence[ModelInput], prune_ratio: float
) -> _Evidence:
    values: list[list[Array]] = [[] for _ in data]
    best: list[list[Array]] = [[] for _ in data]
    kinds: list[list[Array]] = [[] for _ in data]
    rows, starts = lattice.empty(), np.zeros(0, np.int64)
    transition = lattice.tempered_transition
    prior = np.full((len(data) + 1, len(transition)), -np.inf)  # A(s): everything before s, a start there
    prior[0] = 0.0
    for now, observed in enumerate(data):
        rows, starts = lattice.extend(rows, observed), np.append(starts, now)
        if lattice.stepwise and now == 1:  # the first segment's first step
            rows, starts = lattice.select(rows, np.array([1])), starts[:1]
        each = lattice.kind_log_evidence(rows)
        total, plain = lattice.combine(lattice.temper(each)), lattice.combine(each)
        for start, value, largest, kind in zip(starts.tolist(), total, plain, each, strict=True):
            values[start].append(value)
            best[start].append(largest)
            kinds[start].append(kind)
        mass = log_mass(hazard, now + 1 - starts, starts == 0)[:, None]
        ended = log_sum_exp(prior[starts] + mass + total, axis=0)
        prior[now + 1] = log_sum_exp(ended[:, None] + transition, axis=0)
        if prune_ratio > 0.0:
            survived = log_survival(hazard, now - starts, starts == 0)[:, None]
            joint = log_sum_exp(prior[starts] + survived + total, axis=1)
            keep = joint >= joint.max() + np.log(prune_ratio)
            keep[-1] = True
            rows, starts = lattice.select(rows, keep), starts[keep]
    if lattice.stepwise and len(data) > 1:  # which is no segment's start
        for known in (values, best, kinds):
            known[1].append(np.full_like(known[0][0], -np.inf))
    return _Evidence(*([np.array(one) for one in each] for each in (values, best, kinds)))


class _Backward:
    """Q, its maximum version, and for that the length and the next group of the first segment.

    total, best: (n + 1, groups) log; length, after: (n, groups).
    """

    def __init__(
        self, evidence: _Evidence, tempered: Hazard, hazard: Hazard, lattice: SegmentModelSet, n: int
    ) -> None:
        transition = lattice.log_transition
        groups = len(transition)
        self.total, self.best = np.zeros((n + 1, groups)), np.zeros((n + 1, groups))
        self.length, self.after = (np.zeros((n, groups), np.int64) for _ in range(2))
        followed, best_followed = np.zeros((n + 1, groups)), np.zeros((n + 1, groups))
        chosen = np.zeros((n + 1, groups), np.int64)  # the group that follows, by the one before
        for start in range(n - 1, -1, -1):
            self.total[start] = log_sum_exp(_terms(evidence.values, tempered, followed, start, n), axis=0)
            terms = _terms(evidence.best, hazard, best_followed, start, n)
            step = terms.argmax(axis=0)
            self.best[start] = terms.max(axis=0)
            self.length[start] = step + 1
            self.after[start] = chosen[start + step + 1, np.arange(groups)]
            followed[start] = log_sum_exp(lattice.tempered_transition + self.total[start], axis=1)
            scores = transition + self.best[start]
            chosen[start], best_followed[start] = scores.argmax(axis=1), scores.max(axis=1)


def _terms(evidence: list[Array], hazard: Hazard, ahead: Array, start: int, n: int) -> Array:
    """Return (lengths, groups) the contribution of each end of a segment from `start`.

    ahead: (n + 1, groups) the value of all observations from one on, by the group of the segment before.
    """
    values = evidence[start]
    lengths = np.arange(1, len(values) + 1)
    prior = hazard if start else hazard.residual
    terms: Array = values + prior.log_mass(lengths)[:, None] + ahead[start + lengths]
    if len(values) == n - start:
        terms[-1] = values[-1] + prior.log_survival(lengths[-1:] - 1)[0]
    return terms


def _marginals(evidence: _Evidence, hazard: Hazard, transition: Array, backward: _Backward) -> Array:
    n = len(backward.total) - 1
    log_c = np.full((n, len(transition)), -np.inf)
    log_c[0] = backward.total[0] - log_sum_exp(backward.total[0])
    for start in range(n):
        values = evidence.values[start]
        ends = start + 1 + np.arange(len(values))
        inside = ends < n
        ends = ends[inside]
        if np.isfinite(log_c[start]).any():
            reached = log_c[start] - np.where(np.isfinite(log_c[start]), backward.total[start], 0.0)
            prior = hazard if start else hazard.residual
            ending = reached + values[inside] + prior.log_mass(ends - start)[:, None]
            starting = log_sum_exp(ending[:, :, None] + transition, axis=1) + backward.total[ends]
            log_c[ends] = np.logaddexp(log_c[ends], starting)
    result: Array = np.exp(np.minimum(log_sum_exp(log_c, axis=1), 0.0))
    return result


def _path(evidence: _Evidence, backward: _Backward, n: int) -> tuple[PathSegment, ...]:
    path: list[PathSegment] = []
    start, before, group = 0, NOTHING, int(backward.best[0].argmax())
    while start < n:
        length = int(backward.length[start, group])
        path.append(PathSegment(start, evidence.kinds[start][length - 1], group, before))
        start, before, group = start + length, group, int(backward.after[start, group])
    return tuple(path)

"""The exact posterior over all segmentations of a whole recording. Fearnhead 2006; thesis 2.1.4.

With P(t,s) the evidence of observations t..s as one segment, g and S from the hazard, and n the last:

    Q(n+1) = 1,  Q(t) = Σ_{s<n} P(t,s) g(s−t+1) Q(s+1) + P(t,n) S(n−t)

is the evidence of observations t..n, given a segment that starts at t, and

    C(0) = 1,    C(e) = Σ_{t<e} C(t) P(t,e−1) g(e−t) Q(e) / Q(t)

the probability that a segment starts at e: thesis (2.13)–(2.18) put right, with no second prior on the
number of changepoints. The same recursion with maximum gives the best segmentation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.lattice import Lattice
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.threshold import THRESHOLD, threshold_path
from caesura_service.changepoint.window import Ended

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Offline:
    """What a whole recording says.

    changepoint_probability: (n,) that a segment starts at each observation; path: the best segmentation.
    """

    log_evidence: float
    changepoint_probability: Array
    path: tuple[Ended, ...]
    lattice: Lattice = field(repr=False)
    data: tuple[Observed, ...] = field(repr=False)

    def threshold_path(self, level: float = THRESHOLD) -> tuple[Ended, ...]:
        """The segments between changepoints whose probability is above a level. Raises as `runs_above`."""
        return threshold_path(self.lattice, self.data, self.changepoint_probability, level)


@dataclass(frozen=True)
class _Evidence:
    """Log P(t,s) for every start t: values[t][i] is that of t..t+i, (kinds,) beside it; −inf once pruned."""

    values: list[Array]
    kinds: list[Array]


def segment_offline(
    lattice: Lattice, hazard: Hazard, data: Sequence[Observed], *, prune_ratio: float = 0.0
) -> Offline:
    """Segment a whole recording at once.

    prune_ratio: starts whose share of what is known so far falls below it are followed no further
    (thesis (2.34), the right way round); 0 follows all, at quadratic cost.
    Raises ValueError for an empty recording.
    """
    if not data:
        raise ValueError("no observations, expected at least one")
    evidence = _collect(lattice, hazard, data, prune_ratio)
    backward, step = _backward(evidence, hazard, len(data))
    return Offline(
        log_evidence=float(backward[0]),
        changepoint_probability=_marginals(evidence, hazard, backward),
        path=_path(evidence, step, len(data)),
        lattice=lattice,
        data=tuple(data),
    )


def _collect(lattice: Lattice, hazard: Hazard, data: Sequence[Observed], prune_ratio: float) -> _Evidence:
    values: list[list[float]] = [[] for _ in data]
    kinds: list[list[Array]] = [[] for _ in data]
    rows, starts = lattice.empty(), np.zeros(0, np.int64)
    prior = np.full(len(data) + 1, -np.inf)  # A(s): everything before s, a segment starting there
    prior[0] = 0.0
    for now, observed in enumerate(data):
        rows, starts = lattice.extend(rows, observed), np.append(starts, now)
        each = lattice.kind_log_evidence(rows)
        total = lattice.combine(each)
        for start, value, kind in zip(starts.tolist(), total.tolist(), each, strict=True):
            values[start].append(value)
            kinds[start].append(kind)
        prior[now + 1] = log_sum_exp(prior[starts] + hazard.log_mass(now + 1 - starts) + total)
        if prune_ratio > 0.0:
            joint = prior[starts] + hazard.log_survival(now - starts) + total
            keep = joint >= joint.max() + np.log(prune_ratio)
            keep[-1] = True
            rows, starts = lattice.select(rows, keep), starts[keep]
    return _Evidence([np.array(v) for v in values], [np.array(k) for k in kinds])


def _terms(evidence: _Evidence, hazard: Hazard, ahead: Array, start: int, n: int) -> Array:
    """What each end of a segment from `start` contributes; ahead[t] is the value of all from t on."""
    values = evidence.values[start]
    lengths = np.arange(1, values.size + 1)
    terms: Array = values + hazard.log_mass(lengths) + ahead[start + lengths]
    if values.size == n - start:
        terms[-1] = values[-1] + hazard.log_survival(lengths[-1:] - 1)[0]
    return terms


def _backward(evidence: _Evidence, hazard: Hazard, n: int) -> tuple[Array, NDArray[np.int64]]:
    """Q, and the length of the first segment of the best segmentation, for every start."""
    total, best, step = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n, np.int64)
    for start in range(n - 1, -1, -1):
        total[start] = log_sum_exp(_terms(evidence, hazard, total, start, n))
        terms = _terms(evidence, hazard, best, start, n)
        step[start] = int(np.argmax(terms)) + 1
        best[start] = terms[step[start] - 1]
    return total, step


def _marginals(evidence: _Evidence, hazard: Hazard, backward: Array) -> Array:
    n = backward.size - 1
    log_c = np.full(n + 1, -np.inf)
    log_c[0] = 0.0
    for start in range(n):
        values = evidence.values[start]
        ends = start + 1 + np.arange(values.size)
        inside = ends < n
        ends = ends[inside]
        reached = values[inside] + hazard.log_mass(ends - start) + backward[ends] - backward[start]
        log_c[ends] = np.logaddexp(log_c[ends], log_c[start] + reached)
    result: Array = np.exp(np.minimum(log_c[:n], 0.0))
    return result


def _path(evidence: _Evidence, step: NDArray[np.int64], n: int) -> tuple[Ended, ...]:
    path, start = [], 0
    while start < n:
        length = int(step[start])
        path.append(Ended(start, evidence.kinds[start][length - 1]))
        start += length
    return tuple(path)

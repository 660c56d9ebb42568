"""The run-length filter on starts: which hypothesis is the current segment, now that one more sample is in.

With L(s,t) the evidence of samples s..t as one segment, S and g from the hazard:

    joint(s,t) = A(s) + log S(t−s) + L(s,t)
    A(t+1)     = logsumexp_s [A(s) + log g(t−s+1) + L(s,t)]

the growth and changepoint steps of Adams & MacKay 2007 (thesis 2.1.5, steps 3–7) written on starts instead
of run lengths. The same with maximum in place of the sum is the MAP path (Fearnhead & Liu 2007). A backward
pass over the evidence kept for the last `window` samples gives the smoothed changepoint probability,
exact inside the window:

    B(τ) = logaddexp( log S(t−τ) + L(τ,t),  logsumexp_u [log g(u−τ) + L(τ,u−1) + B(u)] )
    P(changepoint at τ | x) = exp(A(τ) + B(τ) − log Z)

A constant hazard makes P(run length 0) equal 1/λ whatever the data say; only this delayed probability and
the MAP path tell anything.

A changepoint becomes final, never to be revised, in one of two ways: all living hypotheses descend from it,
or it is certain, and the filter is conditioned on it: segments that would reach across it leave the window's
evidence, and A and its maximum are summed anew from there. Either way all living hypotheses descend from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.lattice import Lattice, LatticeRows
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.parameters import FilterParameters
from caesura_service.changepoint.smoothing import Smoothed, Smoothing
from caesura_service.changepoint.window import Ended, FinalPath, Starts, Window

Array = NDArray[np.float64]


@dataclass
class OnlineFilter(Smoothed):
    """Takes observations one by one; the same observations give the same state, bit for bit."""

    lattice: Lattice
    hazard: Hazard
    parameters: FilterParameters = field(default_factory=FilterParameters)

    def __post_init__(self) -> None:
        self.count = 0  # observations taken
        self.starts: Starts = np.zeros(0, np.int64)  # (h,) ascending
        self.log_prior: Array = np.zeros(0)  # (h,) A(s)
        self.map_prior: Array = np.zeros(0)  # (h,) the same with maximum
        self.rows: LatticeRows = self.lattice.empty()
        self.kind_log_evidence: Array = np.zeros((0, len(self.lattice.kinds)))  # (h, kinds)
        self.log_evidence: Array = np.zeros(0)  # (h,) the same over all kinds
        self.ended: dict[int, Ended] = {}  # by the start that follows; what living hypotheses descend from
        self.root = 0  # the latest start that every living hypothesis descends from
        self.final = FinalPath(len(self.lattice.kinds))  # the segments before the root
        self.boundaries: list[int] = []  # starts that are certain because somebody said so
        self.capped = 0  # steps on which the cap bit
        self._window = Window(self.parameters.window, len(self.lattice.kinds))
        self._smoothing = Smoothing()
        self._next_prior = 0.0  # A and its maximum for the hypothesis that the next observation starts
        self._next_map = 0.0

    def step(self, observed: Observed, boundary: bool = False, *, changepoint: bool | None = None) -> None:
        """Take one observation. `boundary`: it follows a gap, and begins a segment that joins on to nothing.

        changepoint: whether a segment starts here, where somebody knows (a hazard of 1 or 0). What is not
        possible, that the first one does not, is not heeded. Raises ValueError where a value is not finite;
        nothing has changed then.
        """
        check_finite(observed, self.count)
        if boundary and self.count:
            self._keep(np.zeros(self.starts.size, bool))
            self.boundaries.append(self.count)
        self._grow(observed, changepoint)
        self._prepare_next()
        self._prune()
        self._settle()
        self._smooth()
        if (start := self._certain()) is not None:
            self.condition(start)

    def condition(self, start: int) -> None:
        """Take it for certain that a segment starts at observation `start`; what lies before it is final.

        Posterior, best segmentation and smoothed probabilities are from now on those over the segmentations
        that have this boundary; `event_probability` remembers how probable it was. Raises ValueError for a
        start that is final already, or out of the window.
        """
        check_start(start, self.root, self.count, self.parameters)
        self._smoothing.decide(start)
        ended, self._next_prior, self._next_map = self._window.sum_from(start, self.count, self.hazard)
        self.ended |= ended
        self._keep(self.starts >= start)
        self.log_prior, self.map_prior = self._window.priors(self.starts)
        self._settle()
        self._smooth()

    @property
    def log_joint(self) -> Array:
        """(h,) log joint of each hypothesis and everything so far."""
        survived = self.hazard.log_survival(self.count - 1 - self.starts)
        return self.log_prior + survived + self.log_evidence

    def map_path(self) -> list[Ended]:
        """The segments of the best segmentation from the root on, oldest first; the last is still growing."""
        survived = self.hazard.log_survival(self.count - 1 - self.starts)
        best = int(np.argmax(self.map_prior + survived + self.log_evidence))
        path = [Ended(int(self.starts[best]), self.kind_log_evidence[best])]
        while path[-1].start != self.root:
            path.append(self.ended[path[-1].start])
        return path[::-1]

    def _grow(self, observed: Observed, changepoint: bool | None) -> None:
        self.rows = self.lattice.extend(self.rows, observed)
        self.starts = np.append(self.starts, self.count)
        self.log_prior = np.append(self.log_prior, self._next_prior)
        self.map_prior = np.append(self.map_prior, self._next_map)
        self.kind_log_evidence = self.lattice.kind_log_evidence(self.rows)
        self.log_evidence = self.lattice.combine(self.kind_log_evidence)
        self._heed(changepoint)
        born = self.count in self.starts[-1:]
        priors = (self._next_prior, self._next_map) if born else (-np.inf, -np.inf)
        self._window.remember(self.count, self.starts, self.log_evidence, self.kind_log_evidence, *priors)
        self.count += 1

    def _heed(self, changepoint: bool | None) -> None:
        """Keep the hypotheses that agree with what is known of the newest start."""
        newborn = self.starts == self.count
        if changepoint is not None and (changepoint or newborn.size > 1):
            self._keep(newborn == changepoint)

    def _prepare_next(self) -> None:
        mass = self.hazard.log_mass(self.count - self.starts) + self.log_evidence
        self._next_prior = float(log_sum_exp(self.log_prior + mass))
        scores = self.map_prior + mass
        best = int(np.argmax(scores))
        self._next_map = float(scores[best])
        self.ended[self.count] = Ended(int(self.starts[best]), self.kind_log_evidence[best].copy())

    def _prune(self) -> None:
        p, joint = self.parameters, self.log_joint
        with np.errstate(divide="ignore"):
            keep = joint >= joint.max() + np.log(p.prune_ratio)
        keep[max(keep.size - p.keep_youngest, 0) :] = True
        if keep.sum() > p.cap:
            self.capped += 1
            ranked = np.argsort(joint[: keep.size - p.keep_youngest], kind="stable")
            keep[ranked[: keep.size - p.cap]] = False
        if not keep.all():
            self._keep(keep)

    def _keep(self, keep: NDArray[np.bool_]) -> None:
        self.starts, self.log_prior = self.starts[keep], self.log_prior[keep]
        self.map_prior, self.log_evidence = self.map_prior[keep], self.log_evidence[keep]
        self.kind_log_evidence = self.kind_log_evidence[keep]
        self.rows = self.lattice.select(self.rows, keep)
        self._forget()

    def _forget(self) -> None:
        """Drop what no living hypothesis, nor the next one, descends from."""
        wanted: dict[int, Ended] = {}
        for start in (*map(int, self.starts), self.count):
            while start != self.root and start not in wanted:
                wanted[start] = self.ended[start]
                start = wanted[start].start
        self.ended = wanted

    def _settle(self) -> None:
        """Move the root to where the ancestries of all hypotheses, the next one included, first part."""
        root = _common_ancestor({*map(int, self.starts), self.count}, self.ended)
        settled: list[Ended] = []
        start = root
        while start != self.root:
            settled.append(self.ended.pop(start))
            start = settled[-1].start
        self.final.extend(settled[::-1])
        self.root = root

    def _certain(self) -> int | None:
        """The latest start of the best segmentation that is certain and not yet final."""
        p = self.parameters
        oldest, youngest = self.count - p.window, self.count - 1 - p.certain_after
        starts = [segment.start for segment in self.map_path()]
        for i in range(len(starts) - 1, 0, -1):
            others = (starts[i - 1], *starts[i + 1 : i + 2])
            if oldest <= starts[i] <= youngest and self.event_probability(starts[i], others) > p.certain:
                return starts[i]
        return None

    def _smooth(self) -> None:
        total = float(log_sum_exp(self.log_joint))
        self._smoothing.follow(self._window.smoothed(self.count, self.hazard, total), self.count)


def _common_ancestor(nodes: set[int], ended: dict[int, Ended]) -> int:
    """The latest start shared by the ancestries of all nodes, themselves included."""
    nodes = set(nodes)
    while len(nodes) > 1:
        latest = max(nodes)
        nodes.remove(latest)
        nodes.add(ended[latest].start)
    return nodes.pop()


def check_finite(observed: Observed, count: int) -> None:
    """Raises ValueError for an observation that holds anything else."""
    for name in ("position", "force"):
        value = getattr(observed, name)
        if not np.isfinite(value).all():
            raise ValueError(f"observation {count}: {name} is {value.tolist()}, expected finite numbers")


def check_start(start: int, root: int, count: int, parameters: FilterParameters) -> None:
    """Raises ValueError for a start that is final already, or out of the window."""
    first = max(root, count - parameters.window - 1) + 1
    if not first <= start < count:
        raise ValueError(f"start is {start}, expected {first} to {count - 1}")

"""Every segmentation of a short series, written out."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import combinations, pairwise

import numpy as np

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.lattice import Lattice
from caesura_service.changepoint.models import Observed


def demonstration(seed: int, n: int = 12) -> list[Observed]:
    """A rest, a move and a press, noisy and short."""
    rng = np.random.default_rng(seed)
    moving = np.clip(np.arange(n) - n // 3, 0, n // 3) / (n // 3)
    pressing = np.clip(np.arange(n) - 2 * n // 3, 0, 2) / 2
    position = moving[:, None] * [0.05, -0.1, 0.02] + rng.normal(0, 1e-3, (n, 3))
    force = pressing[:, None] * [0.5, 0.0, 9.0] + rng.normal(0, 0.3, (n, 3))
    holding = rng.choice([0.0, 1.0, np.nan], n)
    return [Observed(*row) for row in zip(position, force, holding, strict=True)]


Kinds = dict[tuple[int, int], np.ndarray]


def kind_log_evidence(lattice: Lattice, data: list[Observed]) -> Kinds:
    """(kinds,) of every data[start:end] as one segment, built alone; it may look at the samples before."""
    found: Kinds = {}
    for start in range(len(data)):
        rows = lattice.empty()
        for observed in data[:start]:  # of what comes before only the last hypothesis is left
            rows = lattice.select(lattice.extend(rows, observed), np.array([-1]))
        for end, observed in enumerate(data[start:], start + 1):
            rows = lattice.select(lattice.extend(rows, observed), np.array([-1 if end == start + 1 else 0]))
            found[start, end] = lattice.kind_log_evidence(rows)[0]
    return found


def segmentations(n: int) -> Iterator[tuple[int, ...]]:
    """All 2^(n−1) sets of segment starts."""
    for k in range(n):
        for inner in combinations(range(1, n), k):
            yield (0, *inner)


class BruteForce:
    """Log joint of the data and every segmentation of it, or of those with some starts and without others."""

    def __init__(
        self,
        lattice: Lattice,
        data: list[Observed],
        hazard: Hazard,
        boundaries: Collection[int] = (),
        without: Collection[int] = (),
        *,
        free: Collection[int] = (),
        kinds: Kinds | None = None,
    ) -> None:
        """free: starts at which every kind may follow every other; kinds: of these data and perhaps more."""
        n = len(data)
        self.n, self.hazard, self.free, self.transition = n, hazard, free, lattice.log_transition
        known = kinds or kind_log_evidence(lattice, data)
        self.kinds = {span: kinds for span, kinds in known.items() if span[1] <= n}
        evidence = {
            key: (lattice.combine(lattice.temper(kinds[None]))[0], lattice.combine(kinds[None])[0])
            for key, kinds in self.kinds.items()
        }
        lengths = np.arange(n + 1)
        self.mass = [-np.inf, *hazard.log_mass(lengths[1:]).tolist()]  # by length
        self.survival = hazard.log_survival(lengths).tolist()
        self.paths = [
            path for path in segmentations(n) if set(boundaries) <= set(path) and not set(without) & set(path)
        ]
        each = [self.log_joints(path, n, evidence) for path in self.paths]
        self.joint = np.array([total for total, _ in each])
        self.best_joint = np.array([best for _, best in each])
        self.total = float(log_sum_exp(self.joint))

    def log_joints(
        self, path: tuple[int, ...], n: int, evidence: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]
    ) -> tuple[float, float]:
        """The sum, and the largest, over all sequences of groups along a path."""
        total = best = np.zeros(len(self.transition))
        for start, end in pairwise(path):
            weight = np.zeros_like(self.transition) if end in self.free else self.transition
            tempered, plain = (self.mass[end - start] + one for one in evidence[start, end])
            total = log_sum_exp((total + tempered)[:, None] + weight, axis=0)
            best = ((best + plain)[:, None] + weight).max(axis=0)
        last = path[-1]
        tempered, plain = (self.survival[n - 1 - last] + one for one in evidence[last, n])
        return float(log_sum_exp(total + tempered)), float((best + plain).max())

    def probability(self, holds: list[bool]) -> float:
        chosen = self.joint[np.array(holds)]
        return float(np.exp(log_sum_exp(chosen) - self.total)) if chosen.size else 0.0

    def changepoint_probability(self) -> list[float]:
        """That a segment starts at each observation."""
        return [self.probability([start in path for path in self.paths]) for start in range(self.n)]

    @property
    def best(self) -> tuple[int, ...]:
        """Starts of the most probable segmentation."""
        return self.paths[int(np.argmax(self.best_joint))]

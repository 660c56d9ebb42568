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
    """(kinds,) of every data[start:end] as one segment, built alone; it may look at the sample before."""
    found: Kinds = {}
    for start in range(len(data)):
        rows = lattice.empty()
        for end, observed in enumerate(data[max(start - 1, 0) :], max(start, 1)):
            rows = lattice.extend(rows, observed)
            if end > start:
                alone = lattice.select(rows, np.array([min(start, 1)]))
                found[start, end] = lattice.kind_log_evidence(alone)[0]
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
        kinds: Kinds | None = None,
    ) -> None:
        """kinds: of these data and perhaps some behind them, where they are known."""
        n = len(data)
        self.n, self.hazard = n, hazard
        known = kinds or kind_log_evidence(lattice, data)
        self.kinds = {span: kinds for span, kinds in known.items() if span[1] <= n}
        evidence = {key: float(lattice.combine(kinds[None])[0]) for key, kinds in self.kinds.items()}
        lengths = np.arange(n + 1)
        self.mass = [-np.inf, *hazard.log_mass(lengths[1:]).tolist()]  # by length
        self.survival = hazard.log_survival(lengths).tolist()
        self.paths = [
            path for path in segmentations(n) if set(boundaries) <= set(path) and not set(without) & set(path)
        ]
        self.joint = np.array([self.log_joint(path, n, evidence) for path in self.paths])
        self.total = float(log_sum_exp(self.joint))

    def log_joint(self, path: tuple[int, ...], n: int, evidence: dict[tuple[int, int], float]) -> float:
        result = 0.0
        for start, end in pairwise(path):
            result += self.mass[end - start] + evidence[start, end]
        last = path[-1]
        return result + self.survival[n - 1 - last] + evidence[last, n]

    def probability(self, holds: list[bool]) -> float:
        chosen = self.joint[np.array(holds)]
        return float(np.exp(log_sum_exp(chosen) - self.total)) if chosen.size else 0.0

    def changepoint_probability(self) -> list[float]:
        """That a segment starts at each observation."""
        return [self.probability([start in path for path in self.paths]) for start in range(self.n)]

    @property
    def best(self) -> tuple[int, ...]:
        """Starts of the most probable segmentation."""
        return self.paths[int(np.argmax(self.joint))]

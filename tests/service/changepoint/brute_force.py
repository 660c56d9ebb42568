"""Every segmentation of a short series, written out."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import cache
from itertools import combinations

import numpy as np

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.hazard import Hazard, Refractory
from caesura_service.changepoint.segment_model_set import SegmentModelSet


def demonstration(seed: int, n: int = 12) -> list[ModelInput]:
    """A rest, a move and a press in which the tool turns, noisy and short."""
    rng = np.random.default_rng(seed)
    moving = np.clip(np.arange(n) - n // 3, 0, n // 3) / (n // 3)
    pressing = np.clip(np.arange(n) - 2 * n // 3, 0, 2) / 2
    position = moving[:, None] * [0.05, -0.1, 0.02] + rng.normal(0, 1e-3, (n, 3))
    force = pressing[:, None] * [0.5, 0.0, 9.0] + rng.normal(0, 0.3, (n, 3))
    holding = rng.choice([0.0, 1.0, np.nan], n)
    rotation = pressing[:, None] * [0.1, 0.0, 0.8] + rng.normal(0, 0.01, (n, 3))
    torsion = pressing[:, None] * [0.0, 0.0, -0.5] + rng.normal(0, 0.05, (n, 3))
    rows = zip(position, force, holding, rotation, torsion, strict=True)
    return [ModelInput(*row) for row in rows]


Kinds = dict[tuple[int, int], np.ndarray]


KINDS: dict[tuple[int, bytes], tuple[SegmentModelSet, Kinds]] = {}  # by segment model set and data


def kind_log_evidence(lattice: SegmentModelSet, data: list[ModelInput]) -> Kinds:
    """(kinds,) of every data[start:end] as one segment, built alone; it may look at the samples before.

    Computed once for a segment model set and data, which many tests have in common.
    """
    key = id(lattice), b"".join(np.asarray(value).tobytes() for observed in data for value in observed)
    if key not in KINDS:
        KINDS[key] = lattice, _kind_log_evidence(lattice, data)  # with the set: its id stays its own
    return KINDS[key][1]


def _kind_log_evidence(lattice: SegmentModelSet, data: list[ModelInput]) -> Kinds:
    found: Kinds = {}
    before = lattice.empty()
    for start in range(len(data)):
        rows = before
        for end, observed in enumerate(data[start:], start + 1):
            rows = lattice.select(lattice.extend(rows, observed), np.array([-1 if end == start + 1 else 0]))
            found[start, end] = lattice.kind_log_evidence(rows)[0]
        # Of what comes before only the last hypothesis is left.
        before = lattice.select(lattice.extend(before, data[start]), np.array([-1]))
    return found


def segmentations(n: int) -> Iterator[tuple[int, ...]]:
    """All 2^(n−1) sets of segment starts."""
    for k in range(n):
        for inner in combinations(range(1, n), k):
            yield (0, *inner)


@cache
def places(n: int) -> tuple[list[tuple[int, ...]], np.ndarray]:
    """All segmentations, and (segmentations, n) whether each has a start there."""
    paths = list(segmentations(n))
    return paths, np.array([[start in path for start in range(n)] for path in paths])


class BruteForce:
    """Log joint of the data and every segmentation of it, or of those with some starts and without others."""

    def __init__(
        self,
        lattice: SegmentModelSet,
        data: list[ModelInput],
        hazard: Hazard,
        boundaries: Collection[int] = (),
        without: Collection[int] = (),
        *,
        free: Collection[int] = (),
        kinds: Kinds | None = None,
    ) -> None:
        """free: starts at which every kind may follow every other; kinds: of these data and perhaps more."""
        self.n, self.hazard, self.free, self.transition = len(data), hazard, free, lattice.log_transition
        known = kinds or kind_log_evidence(lattice, data)
        self.kinds = {span: kinds for span, kinds in known.items() if span[1] <= self.n}
        if is_stepwise := lattice.stepwise and 1 not in boundaries:
            self.kinds |= {(0, end): kinds for (start, end), kinds in self.kinds.items() if start == 1}
        paths, holds = places(self.n)
        absent = [start for start in (*without, *[1] * is_stepwise) if start < self.n]
        is_meant = holds[:, list(boundaries)].all(axis=1) & ~holds[:, absent].any(axis=1)
        self.paths = [paths[number] for number in np.flatnonzero(is_meant)]
        self.holds = holds[is_meant]
        self.joint, self.best_joint = self.log_joints(lattice)
        self.total = float(log_sum_exp(self.joint))

    def log_joints(self, lattice: SegmentModelSet) -> tuple[np.ndarray, np.ndarray]:
        """(paths,) the sum, to the power, and (paths,) the largest, over all sequences of groups."""
        power = lattice.power
        tempered, plain = np.full((2, self.n, self.n + 1, len(self.transition)), -np.inf)
        for span, kinds in self.kinds.items():
            tempered[span] = lattice.combine(lattice.temper(kinds[None]))[0]
            plain[span] = lattice.combine(kinds[None])[0]
        mass, survival = self.priors()
        total, best = np.zeros((2, len(self.paths), len(self.transition)))
        last = np.zeros(len(self.paths), dtype=int)  # (paths,) where each one's segment has begun
        for end in range(1, self.n):
            ends = self.holds[:, end]
            start = last[ends]
            weight = np.zeros_like(self.transition) if end in self.free else self.transition
            length = mass[start, end][:, None]
            before = total[ends] + power * length + tempered[start, end]
            total[ends] = log_sum_exp(before[:, :, None] + power * weight, axis=1)
            before = best[ends] + length + plain[start, end]
            best[ends] = (before[:, :, None] + weight).max(axis=1)
            last[ends] = end
        lasting = survival[last][:, None]
        total = total + power * lasting + tempered[last, self.n]
        best = best + lasting + plain[last, self.n]
        return log_sum_exp(total, axis=1), best.max(axis=1)

    def priors(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, n) of a length from each start to each end, and (n,) of lasting from each start beyond the end.

        Of the first segment it is the prior given that it has lasted beyond its early samples already.
        """
        early = self.hazard.early if isinstance(self.hazard, Refractory) else 0
        known = self.hazard.log_survival(np.array(early))
        mass, survival = np.full((self.n, self.n), -np.inf), np.zeros(self.n)
        for start in range(self.n):
            lasted, past = (early, known) if start == 0 else (0, 0.0)
            lengths = np.arange(1, self.n - start) + lasted
            mass[start, start + 1 :] = self.hazard.log_mass(lengths) - past
            survival[start] = self.hazard.log_survival(np.array(self.n - 1 - start + lasted)) - past
        return mass, survival

    def probability(self, holds: Sequence[bool] | np.ndarray) -> float:
        chosen = self.joint[np.array(holds)]
        return float(np.exp(log_sum_exp(chosen) - self.total)) if chosen.size else 0.0

    def changepoint_probability(self) -> list[float]:
        """That a segment starts at each observation."""
        return [self.probability(self.holds[:, start]) for start in range(self.n)]

    @property
    def best(self) -> tuple[int, ...]:
        """Starts of the most probable segmentation."""
        return self.paths[int(np.argmax(self.best_joint))]

"""Segment models made of channel models: each kind of segment says what every channel does.

{motion, steady, turning} × {free, contact, transport}; the thesis uses three of the nine (3.61). Channel
models are shared, so a lattice costs what its channels cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ChannelModel, Choice, ModelInput, Rows, select
from caesura_service.changepoint.constant_models import GripperHoldingChain, HoldingStates
from caesura_service.changepoint.evidence import log_sum_exp

Array = NDArray[np.float64]
LatticeRows = tuple[Rows, ...]
ContactState = Literal["free", "contact", "transport"]


@dataclass(frozen=True)
class SegmentKind:
    """One kind of segment: its name, what moves, what is touched, and its prior weight.

    beside_movement: how much less likely the kind is directly before or after another movement, at most 1.
    """

    name: str
    motion: Literal["motion", "steady"]
    contact: ContactState
    channels: tuple[str, ...]
    weight: float = 1.0
    beside_movement: float = 1.0


@dataclass(frozen=True)
class SegmentModelSet:
    """Kinds over named channel models.

    `choice`: the evidence of a segment is the prior-weighted mixture over its kinds, or their maximum
    (thesis (3.64)).

    `unrepeated` has groups of kinds, by name, of which no two segments follow each other: two rests in a row
    are one rest, whether the hand holds something or not. Movements that are less likely beside a movement
    (`beside_movement`) are one more group, and all other kinds are one. Where neither is stated there is a
    single group, and every kind may follow every other.

    `power` is that of the joint of a segmentation and the observations in every probability, priors and
    evidence alike. The best segmentation is the same for every power. Below 1 the posterior allows for models
    that are only nearly right. Miller & Dunson 2019 take the evidence alone to a power; a boundary of the
    best segmentation that the prior speaks against then has a probability that is too low.

    `stepwise`: the models look at steps from the observation before. The first observation of all, and the
    first one after a gap, has none. Then the first segment's evidence begins with the second observation,
    which starts no segment of its own: a rest of one observation would explain a step that is not there.

    groups: (kinds,) the group of each kind; members: the numbers of the kinds of each group; log_weight:
    (kinds,) log prior weight of each kind; log_transition: (groups, groups) log weight of the second after
    the first, which replaces the prior weights of the kinds by those that may follow, normalised;
    tempered_transition: the same to the power.
    Raises ValueError where a kind names a channel that is not there.
    """

    channels: Mapping[str, ChannelModel]
    kinds: tuple[SegmentKind, ...]
    choice: Choice = "mixture"
    unrepeated: tuple[tuple[str, ...], ...] = ()
    power: float = 1.0
    stepwise: bool = False
    groups: NDArray[np.int64] = field(init=False, repr=False, compare=False)
    members: tuple[tuple[int, ...], ...] = field(init=False, repr=False, compare=False)
    log_weight: Array = field(init=False, repr=False, compare=False)
    log_transition: Array = field(init=False, repr=False, compare=False)
    tempered_transition: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        unknown = {c for kind in self.kinds for c in kind.channels} - set(self.channels)
        if unknown or not self.kinds:
            raise ValueError(
                f"kinds name channels {', '.join(sorted(unknown))}, known: {', '.join(sorted(self.channels))}"
            )
        if not all(kind.weight > 0.0 for kind in self.kinds):
            raise ValueError(f"weights are {[kind.weight for kind in self.kinds]}, expected all above 0")
        if not all(0.0 < kind.beside_movement <= 1.0 for kind in self.kinds):
            found = [kind.beside_movement for kind in self.kinds]
            raise ValueError(f"beside_movement is {found}, expected all above 0 and at most 1")
        if not 0.0 < self.power <= 1.0:
            raise ValueError(f"power is {self.power}, expected 0 < power ≤ 1")
        groups = _groups(self.kinds, self.unrepeated)
        members = tuple(tuple(np.flatnonzero(groups == group).tolist()) for group in range(groups.max() + 1))
        weights = np.array([kind.weight for kind in self.kinds], np.float64)
        object.__setattr__(self, "groups", groups)
        object.__setattr__(self, "members", members)
        object.__setattr__(self, "log_weight", np.log(weights / weights.sum()))
        object.__setattr__(self, "log_transition", self._log_transition(groups))
        object.__setattr__(self, "tempered_transition", self.power * self.log_transition)

    def _log_transition(self, groups: NDArray[np.int64]) -> Array:
        """(groups, groups): −inf where the second never follows the first, rows normalised."""
        weights = np.array([kind.weight for kind in self.kinds])
        total = np.bincount(groups, weights) / weights.sum()
        allowed = np.ones((total.size, total.size))
        apart = {name for names in self.unrepeated for name in names}
        for (i, before), (j, after) in product(enumerate(self.kinds), repeat=2):
            repeated = groups[i] == groups[j] and before.name in apart
            allowed[groups[i], groups[j]] = 0.0 if repeated else _weight_beside(before, after)
        if total.size == 1:
            return np.zeros((1, 1))
        with np.errstate(divide="ignore"):
            result: Array = np.log(allowed) - np.log(allowed @ total)[:, None]
        return result

    def empty(self) -> LatticeRows:
        """Rows of no hypothesis, one entry a channel."""
        return tuple(channel.empty() for channel in self.channels.values())

    def extend(self, rows: LatticeRows, observed: ModelInput) -> LatticeRows:
        """Take one observation in every channel."""
        return tuple(
            channel.extend(part, observed) for channel, part in zip(self.channels.values(), rows, strict=True)
        )

    def select(self, rows: LatticeRows, index: NDArray[np.generic]) -> LatticeRows:
        """The rows of some hypotheses."""
        return tuple(select(part, index) for part in rows)

    def kind_log_evidence(self, rows: LatticeRows) -> Array:
        """(h, kinds) log evidence of each kind, its prior weight included."""
        parts = zip(self.channels.items(), rows, strict=True)
        channel = {name: model.log_evidence(part) for (name, model), part in parts}
        total = sum(kind.weight for kind in self.kinds)
        columns = [
            sum(channel[c] for c in kind.channels) + np.log(kind.weight / total) for kind in self.kinds
        ]
        return np.column_stack(columns)

    def temper(self, kind_log_evidence: Array) -> Array:
        """Return (…, kinds) log evidence times `power`."""
        tempered: Array = self.power * kind_log_evidence
        return tempered

    def best_kind(self, kind_log_evidence: Array, group: int | None) -> int:
        """Number of the kind with most evidence, (kinds,), of a group, or of all without one."""
        inside = range(len(self.kinds)) if group is None else self.members[group]
        return max(inside, key=kind_log_evidence.tolist().__getitem__)

    def weigh(self, kind_log_evidence: Array, states: HoldingStates | None = None) -> Array:
        """(kinds,) log weight of each kind of one segment: its evidence to the power, its prior as it is.

        How often a hand carries something is known, however wrong the models of signals are. So is how often
        a gripper's state errs, which is all that its model consists of. states: the gripper's in the segment,
        None where none is known.
        """
        known = self.log_weight if states is None else self.log_weight + self._log_likelihood(states)
        weighed: Array = known + self.power * (kind_log_evidence - known)
        return weighed

    def _log_likelihood(self, states: HoldingStates) -> Array:
        """(kinds,) log likelihood of the gripper's states in a segment of each kind."""
        chains = {name: one for name, one in self.channels.items() if isinstance(one, GripperHoldingChain)}
        each = {name: one.log_likelihood(states) for name, one in chains.items()}
        return np.array([sum(each.get(channel, 0.0) for channel in kind.channels) for kind in self.kinds])

    def combine(self, kind_log_evidence: Array) -> Array:
        """Return (h, groups) log evidence over the kinds of each group, from (h, kinds)."""
        columns = [
            self._over(kind_log_evidence[:, self.groups == group])
            for group in range(len(self.log_transition))
        ]
        return np.column_stack(columns)

    def _over(self, kind_log_evidence: Array) -> Array:
        """Return (h,) the maximum or the log sum over the given kinds."""
        if self.choice == "maximum":
            best: Array = kind_log_evidence.max(axis=1)
            return best
        return log_sum_exp(kind_log_evidence, axis=1)


def _groups(kinds: tuple[SegmentKind, ...], unrepeated: tuple[tuple[str, ...], ...]) -> NDArray[np.int64]:
    """(kinds,) the group of each kind; those that may follow each other are the first group."""
    number = {name: i for i, names in enumerate(unrepeated) for name in names}
    movements_matter = any(kind.beside_movement < 1.0 for kind in kinds)
    found = [
        (number.get(kind.name, -1), -kind.beside_movement, movements_matter and kind.motion == "steady")
        for kind in kinds
    ]
    order = {group: place for place, group in enumerate(sorted(set(found)))}
    return np.array([order[group] for group in found], dtype=np.int64)


def _weight_beside(before: SegmentKind, after: SegmentKind) -> float:
    """Return the factor on a kind's prior weight for the case that it directly follows another kind."""
    if "steady" in (before.motion, after.motion):
        return 1.0
    return min(before.beside_movement, after.beside_movement)

"""Segment models made of channel models: each kind of segment says what every channel does.

{motion, steady} × {free, contact, transport}; the thesis uses three of the six (3.61). Channel models are
shared, so a lattice costs what its channels cost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.evidence import log_sum_exp
from caesura_service.changepoint.models import ChannelModel, Choice, Observed, Rows, select

Array = NDArray[np.float64]
LatticeRows = tuple[Rows, ...]


@dataclass(frozen=True)
class Kind:
    """One kind of segment: its name, what moves, what is touched, and its prior weight."""

    name: str
    motion: Literal["motion", "steady"]
    contact: Literal["free", "contact", "transport"]
    channels: tuple[str, ...]
    weight: float = 1.0


@dataclass(frozen=True)
class Lattice:
    """Kinds over named channel models.

    `choice`: the evidence of a segment is the prior-weighted mixture over its kinds, or their maximum
    (thesis (3.64)).
    Raises ValueError where a kind names a channel that is not there.
    """

    channels: Mapping[str, ChannelModel]
    kinds: tuple[Kind, ...]
    choice: Choice = "mixture"

    def __post_init__(self) -> None:
        unknown = {c for kind in self.kinds for c in kind.channels} - set(self.channels)
        if unknown or not self.kinds:
            raise ValueError(f"kinds name channels {sorted(unknown)}, known: {sorted(self.channels)}")

    def empty(self) -> LatticeRows:
        """Rows of no hypothesis, one entry a channel."""
        return tuple(channel.empty() for channel in self.channels.values())

    def extend(self, rows: LatticeRows, observed: Observed) -> LatticeRows:
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

    def combine(self, kind_log_evidence: Array) -> Array:
        """(h,) log evidence of each hypothesis over all kinds."""
        if self.choice == "maximum":
            best: Array = kind_log_evidence.max(axis=1)
            return best
        return log_sum_exp(kind_log_evidence, axis=1)

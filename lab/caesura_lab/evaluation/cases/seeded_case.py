"""A simulated case that its kind and its seed define."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SeededCase:
    """A demonstration of one kind; the same kind and seed give the same demonstration."""

    kind: str
    seed: int

    @property
    def name(self) -> str:
        """A name from which the demonstration can be simulated again."""
        return f"{self.kind}-{self.seed}"

    @property
    def tags(self) -> tuple[str, ...]:
        """The kind."""
        return (self.kind,)

    @property
    def group(self) -> str:
        """Return the kind."""
        return self.kind

    @property
    def subject(self) -> str:
        """Return the demonstration: no two have a person in common."""
        return self.name

    @property
    def rng(self) -> np.random.Generator:
        """A new generator of random numbers, the same each time."""
        return np.random.default_rng([self.seed, zlib.crc32(self.kind.encode())])

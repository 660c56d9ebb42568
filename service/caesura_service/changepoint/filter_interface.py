"""The interface of a changepoint filter, compiled or in NumPy."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.evidence_window import PathSegment, Starts
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.hazard import Hazard
from caesura_service.changepoint.segment_model_set import SegmentModelSet

Array = NDArray[np.float64]


class ChangepointFilter(Protocol):
    """A filter that processes observations one by one; `RunLengthFilter` describes each member in full."""

    @property
    def lattice(self) -> SegmentModelSet:
        """The segment model set: the kinds of a segment with their channel models."""

    @property
    def hazard(self) -> Hazard:
        """The prior of a segment's length."""

    @property
    def parameters(self) -> FilterParameters:
        """The bounds on the filter's work, and its threshold for a certain changepoint."""

    @property
    def count(self) -> int:
        """The number of observations processed."""

    @property
    def starts(self) -> Starts:
        """(h,) starts of the living hypotheses, ascending."""

    @property
    def boundaries(self) -> Sequence[int]:
        """Starts that a correction makes certain."""

    @property
    def final(self) -> Sequence[PathSegment]:
        """The segments that no later sample can change."""

    @property
    def capped(self) -> int:
        """The number of steps on which the cap dropped hypotheses."""

    @property
    def posterior(self) -> Array:
        """(h,) probability of each hypothesis."""

    @property
    def smoothed(self) -> Array:
        """(n,) smoothed probability at every observation."""

    def step(self, observed: ModelInput, boundary: bool = False, *, changepoint: bool | None = None) -> None:
        """Process one observation; a gap or a known start may be stated with it. Raises ValueError."""

    def condition_on_start(self, start: int) -> None:
        """Condition on a segment that starts at observation `start`. Raises ValueError."""

    def map_path(self) -> list[PathSegment]:
        """The segments of the best segmentation from the final ones on; the last is still growing."""

    def outline(self) -> list[tuple[int, int]]:
        """Return (start, number of the kind) for each segment of `map_path`."""

    def changepoint_probability(self, start: int, *, about: int | None = None) -> float:
        """Return the smoothed probability that a segment starts at observation `start`."""

    def changepoint_probabilities(self, first: int, last: int, *, about: int | None = None) -> list[float]:
        """Return `changepoint_probability` of every observation from the first to the last, both included."""

    def stands(self, start: int) -> bool:
        """Whether later observations can no longer change the probabilities at and next to this start."""

    def event_probability(self, start: int, others: Collection[int] = ()) -> float:
        """Return the smoothed probability of a start here or at a neighbouring observation.

        others: neighbours that are separate events, and are not added.
        """

"""The interface between a session and its pipeline.

A pipeline processes samples in order and has a view of its results at any time. It contains conditioning,
changepoint filter and program. Ordering, numbering and the network are outside of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import (
    App,
    Change,
    Changepoint,
    Gap,
    Hint,
    LengthUnit,
    Phase,
    Segment,
    Vector,
    WrenchReport,
)
from caesura_protocol.recording import ASSUMED
from caesura_service.program.gaps import NOT_OBSERVED
from caesura_service.segmentation.corrections import ResolvedEdit

MOST_TOGETHER = 500  # samples of several pushes in one


class PipelineView(NamedTuple):
    """The results of a pipeline at one time. Immutable, so another thread may read it."""

    samples: int
    repeats: int  # samples whose time did not advance
    t: float  # [s] the last observation; -inf before the first
    observations: int
    changepoints: Sequence[Changepoint]
    segments: Sequence[Segment]
    posterior_starts: tuple[float, ...]  # [s] living hypotheses
    posterior_probabilities: tuple[float, ...]
    apps: Sequence[App]
    notes: tuple[str, ...]
    gaps: tuple[Gap, ...]
    wrench: WrenchReport
    delay_s: float
    hypotheses: int
    capped: int
    length_unit: LengthUnit = "m"  # of the samples that came
    force_limit_n: float | None = None  # [N] of the cell
    robot: str | None = None  # None: not stated
    up: Vector | None = None  # away from gravity, base frame; None: not stated, z is assumed
    phases: Sequence[Phase] = ()
    hints: tuple[Hint, ...] = ()  # active ones, and the newest of those that are cleared
    unapplied: Mapping[int, str] = MappingProxyType({})  # why corrections are not applied, by their numbers


def notes_beside_tables(view: PipelineView) -> tuple[str, ...]:
    """Return the notes of a recording's tables other than those on recording, wrench and gaps."""
    stated = (view.wrench.note, *ASSUMED.values())
    return tuple(
        note
        for note in view.notes
        if not any(note in one for one in stated) and not note.startswith(NOT_OBSERVED)
    )


class Pipeline(Protocol):
    """Maps samples to a view. Pure: the same pushes give the same view, whatever else runs."""

    @property
    def view(self) -> PipelineView:
        """The view of the samples so far."""

    @property
    def due_s(self) -> float:
        """The session time [s] of the first sample that changes more of the view than counts.

        Earlier samples, MOST_TOGETHER at most, may be pushed together with those of the next push: the
        results are the same, except that an error rejects the joint push. −inf if they must be pushed
        separately. Any thread may read it.
        """

    def push(self, samples: NDArray[np.float64]) -> bool:
        """Process the next samples, (n, columns) as declared in the opening, time first.

        Return whether the view has changed in anything except the number of samples.
        """

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        """Push samples as `push` does, and postpone a due program to `make_due_program`, which must
        follow.
        """

    @property
    def has_due_program(self) -> bool:
        """Whether a program has been postponed to `make_due_program`."""

    def make_due_program(self) -> None:
        """Make the postponed program."""

    def declare_gap(self) -> None:
        """Declare that samples between the last push and the next, or the end, are permanently lost."""

    def finish(self) -> None:
        """End the demonstration: decide everything that is still open."""

    def refresh(self) -> None:
        """Bring the view up to date, for an edit: between two updates it may lack newer observations."""

    @property
    def kinds(self) -> Sequence[str]:
        """The kinds of segment that a correction may name."""

    def resolve(self, change: Change) -> ResolvedEdit:
        """Return a correction, resolved against the view. Raises ProtocolError; nothing changes."""

    def observation_at(self, t: float) -> int:
        """Return the first observation of a segment whose changepoint is inserted at a time [s]."""

    def corrected(self, corrections: Sequence[ResolvedEdit]) -> Pipeline:
        """Return the pipeline with these corrections applied from the first sample on.

        It replaces this pipeline, which must not be used any more after that.
        """

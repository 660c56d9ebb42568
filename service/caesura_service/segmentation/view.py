"""The interface between a session and its pipeline.

A pipeline takes samples in order and can say at any time what it makes of them. Signals, changepoints
and the program lie behind it; ordering, numbering and the wire lie before it.
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
    """The results of a pipeline at one time. Nothing in it ever changes, so another thread may read it."""

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
    """Return the notes that tables of a recording state besides those on recording, wrench and gaps."""
    stated = (view.wrench.note, *ASSUMED.values())
    return tuple(
        note
        for note in view.notes
        if not any(note in one for one in stated) and not note.startswith(NOT_OBSERVED)
    )


class Pipeline(Protocol):
    """Samples in, view out. Pure: the same pushes give the same view, whatever else runs."""

    @property
    def view(self) -> PipelineView:
        """The view of the samples so far."""

    @property
    def due_s(self) -> float:
        """The session time [s] of the first sample that changes more of the view than counts.

        Samples before it, MOST_TOGETHER at most, and those of the next push may come in one push: with the
        same results, except that a push that raises is one of fewer samples. −inf where they may not. Any
        thread may read it.
        """

    def push(self, samples: NDArray[np.float64]) -> bool:
        """Take the next samples, (n, columns) as declared when the session was opened, time first.

        Return whether the view shows anything new, other than the number of samples.
        """

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        """Push samples as `push` does, but leave a due program to `make_due_program`, which has to follow."""

    @property
    def has_due_program(self) -> bool:
        """Whether a program has been left to `make_due_program`."""

    def make_due_program(self) -> None:
        """Make the program that was left."""

    def declare_gap(self) -> None:
        """Say that samples between the last push and the next, or the end, are lost for good."""

    def finish(self) -> None:
        """End the demonstration: decide everything that is still open."""

    def refresh(self) -> None:
        """Bring the view up to date, as an edit does: between two looks it may lack newer observations."""

    @property
    def kinds(self) -> Sequence[str]:
        """The kinds of segment that a correction may name."""

    def resolve(self, change: Change) -> ResolvedEdit:
        """Return a correction, resolved against what is shown. Raises ProtocolError; nothing changes."""

    def observation_at(self, t: float) -> int:
        """Return the observation at which a changepoint that is inserted at a time [s] starts a segment."""

    def corrected(self, corrections: Sequence[ResolvedEdit]) -> Pipeline:
        """Return the pipeline as if these corrections had been known from the first sample on.

        It takes the place of this pipeline, which is not to be used any more once it does.
        """

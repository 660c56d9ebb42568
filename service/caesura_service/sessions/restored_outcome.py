"""A closed session restored from its stored outcome: it answers queries and has no pipeline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import App, Change, Changepoint, Phase, Segment, Snapshot
from caesura_service.program_edits import log_of
from caesura_service.publishing.edited_programs import EditedPrograms
from caesura_service.publishing.events import Owner
from caesura_service.publishing.session_state import SessionCounters, SessionState, Stream
from caesura_service.segmentation.corrections import ResolvedEdit
from caesura_service.segmentation.encoded_log import packed
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView


class ClosedPipeline:
    """A finished pipeline: it has a view and accepts no input."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.view = view_from_snapshot(snapshot)

    @property
    def due_s(self) -> float:
        """Always −inf, because no sample is expected."""
        return float("-inf")

    def push(self, samples: NDArray[np.float64]) -> bool:
        """Raise RuntimeError: a closed session takes no samples."""
        raise RuntimeError("the session is closed")

    push_without_program = push
    has_due_program = False

    def make_due_program(self) -> None:
        """Make nothing, because the program is final."""

    def declare_gap(self) -> None:
        """Raise RuntimeError: a closed session has all its gaps."""
        raise RuntimeError("the session is closed")

    def finish(self) -> None:
        """Raise RuntimeError: a closed session has finished."""
        raise RuntimeError("the session is closed")

    def refresh(self) -> None:
        """Change nothing, because the view is final."""

    @property
    def kinds(self) -> Sequence[str]:
        """Always empty, because a correction needs a pipeline rebuilt from the journal."""
        return ()

    def resolve(self, change: Change) -> ResolvedEdit:
        """Raise RuntimeError: a correction needs a pipeline rebuilt from the journal."""
        raise RuntimeError("the session has to be rebuilt from the journal first")

    def observation_at(self, t: float) -> int:
        """Raise RuntimeError: a correction needs a pipeline rebuilt from the journal."""
        raise RuntimeError("the session has to be rebuilt from the journal first")

    def corrected(self, corrections: Sequence[ResolvedEdit]) -> Pipeline:
        """Raise RuntimeError: a correction needs a pipeline rebuilt from the journal."""
        raise RuntimeError("the session has to be rebuilt from the journal first")


def view_from_snapshot(snapshot: Snapshot) -> PipelineView:
    """Restore the view that a snapshot was made from."""
    status, posterior = snapshot.status, snapshot.posterior
    return PipelineView(
        t=status.t,
        samples=status.samples,
        repeats=status.repeats,
        observations=status.observations,
        changepoints=packed(Changepoint, snapshot.changepoints.changepoints),
        segments=packed(Segment, snapshot.segments.segments),
        posterior_starts=posterior.starts if posterior else (),
        posterior_probabilities=posterior.probabilities if posterior else (),
        apps=packed(App, snapshot.program.apps),
        notes=snapshot.program.notes,
        gaps=status.gaps,
        wrench=status.wrench,
        delay_s=status.delay_s,
        hypotheses=status.hypotheses,
        capped=status.capped,
        length_unit=status.length_unit,
        force_limit_n=snapshot.program.force_limit_n,
        robot=snapshot.program.robot,
        up=snapshot.program.up,
        phases=packed(Phase, snapshot.segments.phases),
        hints=snapshot.hints.hints if snapshot.hints else (),
        unapplied={one.number: one.reason for one in snapshot.program.corrections if one.reason is not None},
    )


def state_from_snapshot(snapshot: Snapshot, owner: Owner) -> SessionState:
    """Restore the state of a closed session under its current owner; counts of the process restart at 0."""
    status = snapshot.status
    last_seq: dict[Stream, int] = {
        "status": status.seq,
        "changepoints": snapshot.changepoints.seq,
        "segments": snapshot.segments.seq,
        "posterior": snapshot.posterior.seq if snapshot.posterior else -1,
        "hints": snapshot.hints.seq if snapshot.hints else -1,
    }
    bare: dict[str, Any] = {"apps": (), "edits": (), "edit_revision": 0}
    header = {"instance": owner.instance, "epoch": owner.epoch, **bare}
    view = view_from_snapshot(snapshot)
    return SessionState(
        station=status.station,
        session=status.session,
        owner=owner,
        preset=status.preset,
        lifecycle="closed",
        view=view,
        counters=SessionCounters(batches=status.batches, lost=status.lost, gaps_before=status.gaps_before),
        waiting_for=None,
        last_seq=last_seq,
        program_header=snapshot.program.model_copy(update=header),
        apps=view.apps,
        edited_programs=EditedPrograms(),
        revision=status.revision,
        undoable=status.undoable,
        redoable=status.redoable,
        description=status.description,
        described=status.described,
        described_by=status.described_by,
        opened=status.opened,
        program_edits=log_of(snapshot.program),
    )

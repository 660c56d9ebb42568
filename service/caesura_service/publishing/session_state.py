"""The published state of a session: immutable, so that any thread reads it without a lock.

The messages of a snapshot are made from the state at a query, not at every batch.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_protocol.messages import (
    MAX_GAPS,
    App,
    Changepoints,
    Description,
    DescriptionAuthor,
    Hints,
    Posterior,
    Program,
    Refusal,
    Segments,
    SessionStatus,
    Snapshot,
)
from caesura_service.program_edits import EditLog
from caesura_service.publishing.edited_programs import EditedPrograms
from caesura_service.publishing.events import Owner
from caesura_service.publishing.lifecycle_transitions import Lifecycle
from caesura_service.segmentation.encoded_log import since
from caesura_service.segmentation.pipeline_interface import PipelineView

Stream = Literal["status", "changepoints", "segments", "posterior", "hints"]


class SessionCounters(NamedTuple):
    """The counters of a session. The first three are of the session, the others since the process started."""

    batches: int = 0
    lost: int = 0
    gaps_before: int = 0  # gaps of a closed session beyond those in its view
    dropped: int = 0
    duplicates: int = 0
    refused: Mapping[ErrorCode, int] = MappingProxyType({})
    last_refusal: Refusal | None = None

    def with_refusal(self, error: ProtocolError) -> SessionCounters:
        """Return the counters with one refusal more."""
        counts = {**self.refused, error.code: self.refused.get(error.code, 0) + 1}
        return self._replace(refused=counts, last_refusal=Refusal(code=error.code, message=str(error)))


class SessionState(NamedTuple):
    """The published results, corrections, program edits and counters of a session at one time."""

    station: str
    session: str
    owner: Owner
    preset: str
    lifecycle: Lifecycle
    view: PipelineView
    counters: SessionCounters
    waiting_for: int | None  # the batch that is missing
    last_seq: Mapping[Stream, int]  # of each stream; -1 before its first message
    program_header: Program  # the task program without its apps
    apps: Sequence[App]  # of the task program
    edited_programs: EditedPrograms  # what was made last of header, apps and edits; no part of the state
    revision: int = 0  # edits so far
    undoable: bool = False
    redoable: bool = False
    description: Description = Description()
    described: int = 0  # changes of the description so far
    described_by: tuple[DescriptionAuthor, ...] = ()  # of the fields that `Describe` has changed
    opened: float | None = None  # [s] time of day of its first opening
    program_edits: EditLog = EditLog()

    @property
    def neutral_changes(self) -> int:
        """The number of changes that alter no result: of the description, and edits of the program."""
        return self.described + self.program_edits.revision

    @property
    def is_open(self) -> bool:
        """Whether the session accepts samples."""
        return self.lifecycle == "open"

    def with_counts(self, batches: int, samples: int) -> SessionState:
        """Return the state with more batches and samples that change nothing else."""
        return self._replace(
            view=self.view._replace(samples=self.view.samples + samples),
            counters=self.counters._replace(batches=self.counters.batches + batches),
        )

    def with_description(self, description: Description, author: str | None = None) -> SessionState:
        """Return the state with another description. author: of the `Describe`; None at a close."""
        before = dict(self.description)
        changed = [name for name, value in description if value != before[name]]
        authors = {one.field: one for one in self.described_by if one.field not in changed}
        if author is not None:
            named = [DescriptionAuthor.model_validate({"field": name, "author": author}) for name in changed]
            authors |= {one.field: one for one in named}
        described = self.described + (author is not None)
        return self._replace(
            description=description, described=described, described_by=tuple(authors.values())
        )

    def header(self, stream: Stream) -> dict[str, Any]:
        """Return the common fields of a stream's last published result."""
        return {
            "station": self.station,
            "session": self.session,
            "instance": self.owner.instance,
            "epoch": self.owner.epoch,
            "seq": self.last_seq[stream],
            "t": observed_until_s(self.view),
        }


def observed_until_s(view: PipelineView) -> float:
    """Return the time of the last observation [s]; 0 before the first."""
    return view.t if math.isfinite(view.t) else 0.0


def status_of(state: SessionState) -> SessionStatus:
    """Make the status message of a session."""
    view, counters = state.view, state.counters
    return SessionStatus(
        **state.header("status"),
        state="open" if state.is_open else "closed",
        preset=state.preset,
        wrench=view.wrench,
        delay_s=view.delay_s,
        batches=counters.batches,
        samples=view.samples,
        observations=view.observations,
        duplicates=counters.duplicates,
        repeats=view.repeats,
        waiting_for=state.waiting_for,
        gaps=view.gaps[-MAX_GAPS:],
        gaps_before=counters.gaps_before + max(0, len(view.gaps) - MAX_GAPS),
        refused=dict(counters.refused),
        last_refusal=counters.last_refusal,
        hypotheses=view.hypotheses,
        capped=view.capped,
        length_unit=view.length_unit,
        lost=counters.lost,
        dropped=counters.dropped,
        revision=state.revision,
        undoable=state.undoable,
        redoable=state.redoable,
        description=state.description,
        described=state.described,
        described_by=state.described_by,
        opened=state.opened,
    )


def changepoints_of(state: SessionState, first: int = 0) -> Changepoints:
    """Make the message of the changepoints from the `first` on."""
    bare = Changepoints(**state.header("changepoints"), first=first, changepoints=())
    return bare.model_copy(update={"changepoints": since(state.view.changepoints, first)})


def segments_of(state: SessionState, first: int = 0, first_phase: int = 0) -> Segments:
    """Make the message of the segments from the `first` on, and the phases from the `first_phase` on."""
    bare = Segments(**state.header("segments"), first=first, segments=(), first_phase=first_phase)
    view = state.view
    return bare.model_copy(
        update={"segments": since(view.segments, first), "phases": since(view.phases, first_phase)}
    )


def posterior_of(state: SessionState) -> Posterior:
    """Make the message of the posterior of the current segment's start."""
    return Posterior(
        **state.header("posterior"),
        starts=state.view.posterior_starts,
        probabilities=state.view.posterior_probabilities,
    )


def hints_of(state: SessionState) -> Hints:
    """Make the message of the active and the newest cleared hints."""
    return Hints(**state.header("hints"), hints=state.view.hints)


def program_of(state: SessionState) -> Program:
    """Make the task program message with its edits; its apps stay encoded as they are stored."""
    if not state.program_edits.revision:
        return inferred_program_of(state)
    inferred, log = inferred_program_of(state), state.program_edits
    return state.edited_programs.edited(state.program_header, inferred, log)


def inferred_program_of(state: SessionState) -> Program:
    """Make the task program as it was inferred, with a list of the edits that are not in its apps."""
    log = state.program_edits
    changes = {"apps": state.apps, "edits": log.listed, "edit_revision": log.revision}
    return state.program_header.model_copy(update=changes)


def program_at_edit(state: SessionState, number: int) -> Program:
    """Make the version of the program with the effective edits up to a number; 0: none."""
    inferred, log = inferred_program_of(state), state.program_edits
    return state.edited_programs.edited(state.program_header, inferred, log, number)


def check_program_edit(state: SessionState, log: EditLog) -> None:
    """Check that the last edit of a log applies to the current program. Raises ProtocolError `conflict`."""
    state.edited_programs.check_applies(inferred_program_of(state), log)


def snapshot_of(state: SessionState, program: Program | None = None) -> Snapshot:
    """Make the snapshot message of a session, with the last sequence number of each stream.

    program: by default the edited one.
    """
    return Snapshot(
        status=status_of(state),
        changepoints=changepoints_of(state),
        segments=segments_of(state),
        posterior=posterior_of(state) if state.last_seq["posterior"] >= 0 else None,
        program=program or program_of(state),
        hints=hints_of(state) if state.last_seq["hints"] >= 0 else None,
    )

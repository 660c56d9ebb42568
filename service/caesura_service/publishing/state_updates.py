"""Publishes the differences between one view and the next as messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

from caesura_protocol.messages import MAX_GAPS, Program
from caesura_service.program_edits import EditLog
from caesura_service.publishing.edited_programs import EditedPrograms
from caesura_service.publishing.events import Owner, Publish
from caesura_service.publishing.session_state import (
    SessionCounters,
    SessionState,
    Stream,
    changepoints_of,
    hints_of,
    observed_until_s,
    posterior_of,
    program_of,
    segments_of,
    status_of,
)
from caesura_service.segmentation.corrections import EditHistory, with_states
from caesura_service.segmentation.encoded_log import AT_ONCE, M, alike
from caesura_service.segmentation.pipeline_interface import PipelineView


@dataclass(frozen=True)
class EditOutcome:
    """The corrections of a session after an edit, with the edit's author and time of day [s]."""

    corrections: EditHistory
    author: str
    at: float


def initial_state(station: str, session: str, owner: Owner, preset: str, view: PipelineView) -> SessionState:
    """Return the state of a session before its first batch."""
    header = Program(
        station=station,
        session=session,
        instance=owner.instance,
        epoch=owner.epoch,
        version=0,
        t=observed_until_s(view),
        complete=False,
        apps=(),
        notes=view.notes,
        **_program_context(view),
    )
    silent: dict[Stream, int] = dict.fromkeys(get_args(Stream), -1)
    return SessionState(
        station=station,
        session=session,
        owner=owner,
        preset=preset,
        lifecycle="open",
        view=view,
        counters=SessionCounters(),
        waiting_for=None,
        last_seq=silent,
        program_header=header,
        apps=view.apps,
        edited_programs=EditedPrograms(),
    )


def initial_messages(state: SessionState) -> tuple[SessionState, list[Publish]]:
    """Publish the first message of every stream except the posterior, so that a snapshot can number them."""
    state = _advance_seq(_advance_seq(state, "changepoints"), "segments")
    outputs = [Publish(changepoints_of(state)), Publish(segments_of(state)), Publish(program_of(state))]
    state, status = publish_status(state)
    return state, [*outputs, status]


def publish_status(state: SessionState) -> tuple[SessionState, Publish]:
    """Publish the current status under its next sequence number."""
    state = _advance_seq(state, "status")
    return state, Publish(status_of(state))


def apply_view(
    state: SessionState, view: PipelineView, counters: SessionCounters
) -> tuple[SessionState, list[Publish]]:
    """Replace the view; publish its differences from the old one."""
    old = state.view
    first_changepoint = first_difference(old.changepoints, view.changepoints)
    first = first_difference(old.segments, view.segments)
    first_phase = first_difference(old.phases, view.phases)
    changed: dict[Stream, bool] = {
        "changepoints": first_changepoint is not None,
        "segments": first is not None or first_phase is not None,
        "posterior": _posterior_key(view) != _posterior_key(old),
        "hints": view.hints != old.hints,
    }
    last_seq = {**state.last_seq}
    for stream, has_changed in changed.items():
        last_seq[stream] += has_changed
    state = state._replace(view=view, counters=counters, last_seq=last_seq)
    outputs: list[Publish] = []
    if changed["changepoints"]:
        outputs.append(Publish(changepoints_of(state, first_changepoint or 0)))
    if changed["segments"]:
        first = len(view.segments) if first is None else first
        first_phase = len(view.phases) if first_phase is None else first_phase
        outputs.append(Publish(segments_of(state, first, first_phase)))
    if changed["posterior"]:
        outputs.append(Publish(posterior_of(state)))
    if changed["hints"]:
        outputs.append(Publish(hints_of(state)))
    return state, outputs


def update_program(state: SessionState, *, note: str | None = None) -> SessionState:
    """Return the state with the next version of the task program, if the program has changed."""
    header, view = state.program_header, state.view
    notes = (*view.notes, note) if note else view.notes
    complete = not state.is_open
    corrections = with_states(header.corrections, view.unapplied)
    known = (state.apps, header.notes, header.complete, header.corrections)
    if (view.apps, notes, complete, corrections) == known:
        return state
    return _next_program(state, notes=notes, complete=complete)


def apply_edit(
    state: SessionState, view: PipelineView, edited: EditOutcome
) -> tuple[SessionState, list[Publish]]:
    """Apply an edit: publish the differences, a version of the program with its author, and a status."""
    state, changes = apply_view(state, view, state.counters)
    corrections = edited.corrections
    state = state._replace(
        revision=corrections.revision, undoable=bool(corrections.active), redoable=bool(corrections.undone)
    )
    state = _next_program(
        state,
        notes=view.notes,
        complete=not state.is_open,
        revision=corrections.revision,
        corrections=corrections.listed,
        author=edited.author,
        edited=edited.at,
    )
    state, status = publish_status(state)
    return state, [*changes, Publish(program_of(state)), status]


def apply_program_edit(
    state: SessionState, log: EditLog, author: str, at: float
) -> tuple[SessionState, Publish]:
    """Replace the edits of the program, and publish its next version. at: time of day [s]."""
    header, complete = state.program_header, not state.is_open
    state = state._replace(program_edits=log)
    state = _next_program(state, notes=header.notes, complete=complete, author=author, edited=at)
    return state, Publish(program_of(state))


def replay_edit(state: SessionState, view: PipelineView, edited: EditOutcome, version: int) -> SessionState:
    """Apply an edit of the journal: as `apply_edit`, with the recorded version of its program."""
    state, _ = apply_edit(state, view, edited)
    return state._replace(program_header=state.program_header.model_copy(update={"version": version}))


def apply_corrected_view(state: SessionState, view: PipelineView) -> SessionState:
    """Replace the view by one whose corrections were counted before."""
    state, _ = apply_view(state, view, state.counters)
    corrections = with_states(state.program_header.corrections, view.unapplied)
    changes = {"t": observed_until_s(view), "notes": view.notes, "corrections": corrections}
    header = state.program_header.model_copy(update=changes)
    return state._replace(program_header=header, apps=view.apps)


def _next_program(state: SessionState, **changes: Any) -> SessionState:
    header, view = state.program_header, state.view
    corrections = with_states(changes.get("corrections", header.corrections), view.unapplied)
    changes |= {"version": header.version + 1, "t": observed_until_s(view), "corrections": corrections}
    changes |= _program_context(view)
    return state._replace(program_header=header.model_copy(update=changes), apps=view.apps)


def _program_context(view: PipelineView) -> dict[str, Any]:
    """Return the fields of a program other than its apps that a check uses."""
    return {
        "gaps": view.gaps[-MAX_GAPS:],
        "wrench": view.wrench,
        "force_limit_n": view.force_limit_n,
        "robot": view.robot,
        "up": view.up,
    }


def _posterior_key(view: PipelineView) -> tuple[object, ...]:
    return view.observations, view.posterior_starts, view.posterior_probabilities


def first_difference(old: Sequence[M], new: Sequence[M]) -> int | None:
    """Return the first index at which two sequences differ; None where they are equal."""
    if old is new:
        return None
    known = alike(old, new)
    for first in range(known, min(len(old), len(new)), AT_ONCE):
        last = first + AT_ONCE
        for index, (before, after) in enumerate(zip(old[first:last], new[first:last], strict=False), first):
            if before is not after and before != after:
                return index
    return None if len(old) == len(new) else min(len(old), len(new))


def _advance_seq(state: SessionState, stream: Stream) -> SessionState:
    return state._replace(last_seq={**state.last_seq, stream: state.last_seq[stream] + 1})

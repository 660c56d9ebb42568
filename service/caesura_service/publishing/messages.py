"""Publishes the changes from one view to the next, as messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from caesura_protocol.messages import MAX_GAPS, Program
from caesura_service.publishing.events import Owner, Publish
from caesura_service.publishing.session_state import (
    SessionCounters,
    SessionState,
    Stream,
    changepoints_of,
    posterior_of,
    program_of,
    segments_of,
    status_of,
    time_of,
)
from caesura_service.segmentation.corrections import EditHistory
from caesura_service.segmentation.encoded_log import AT_ONCE, M, alike
from caesura_service.segmentation.view import PipelineView


@dataclass(frozen=True)
class EditOutcome:
    """The corrections of a session after an edit, whose it was, and when [s, time of day]."""

    corrections: EditHistory
    author: str
    at: float


def beginning(station: str, session: str, owner: Owner, preset: str, view: PipelineView) -> SessionState:
    """A session that has taken nothing yet."""
    heading = Program(
        station=station,
        session=session,
        instance=owner.instance,
        epoch=owner.epoch,
        version=0,
        t=time_of(view),
        complete=False,
        apps=(),
        notes=view.notes,
        **_of_the_demonstration(view),
    )
    silent: dict[Stream, int] = {"status": -1, "changepoints": -1, "segments": -1, "posterior": -1}
    return SessionState(
        station=station,
        session=session,
        owner=owner,
        preset=preset,
        state="open",
        view=view,
        tally=SessionCounters(),
        waiting_for=None,
        last_seq=silent,
        heading=heading,
        apps=view.apps,
    )


def first_words(standing: SessionState) -> tuple[SessionState, list[Publish]]:
    """Every stream but the posterior begins with what is there, so that a snapshot can number it."""
    standing = _bump(_bump(standing, "changepoints"), "segments")
    said = [Publish(changepoints_of(standing)), Publish(segments_of(standing)), Publish(program_of(standing))]
    standing, status = with_status(standing)
    return standing, [*said, status]


def with_status(standing: SessionState) -> tuple[SessionState, Publish]:
    """A status, as of now."""
    standing = _bump(standing, "status")
    return standing, Publish(status_of(standing))


def with_view(
    standing: SessionState, view: PipelineView, tally: SessionCounters
) -> tuple[SessionState, list[Publish]]:
    """Take a new view and say what differs from the old one."""
    old, standing = standing.view, standing._replace(view=view, tally=tally)
    said: list[Publish] = []
    if (first := first_difference(old.changepoints, view.changepoints)) is not None:
        standing = _bump(standing, "changepoints")
        said.append(Publish(changepoints_of(standing, first)))
    first = first_difference(old.segments, view.segments)
    first_phase = first_difference(old.phases, view.phases)
    if first is not None or first_phase is not None:
        standing = _bump(standing, "segments")
        first = len(view.segments) if first is None else first
        first_phase = len(view.phases) if first_phase is None else first_phase
        said.append(Publish(segments_of(standing, first, first_phase)))
    if _posterior(view) != _posterior(old):
        standing = _bump(standing, "posterior")
        said.append(Publish(posterior_of(standing)))
    return standing, said


def with_program(standing: SessionState, *, note: str | None = None) -> SessionState:
    """With the next version of the task program, where it differs from the last one."""
    heading, view = standing.heading, standing.view
    notes = (*view.notes, note) if note else view.notes
    complete = not standing.is_open
    if (view.apps, notes, complete) == (standing.apps, heading.notes, heading.complete):
        return standing
    return _next_program(standing, notes=notes, complete=complete)


def with_edit(
    standing: SessionState, view: PipelineView, edited: EditOutcome
) -> tuple[SessionState, list[Publish]]:
    """What an edit makes of it: what differs, a version of the program with its author, and a status."""
    standing, changes = with_view(standing, view, standing.tally)
    done = edited.corrections
    standing = standing._replace(
        revision=done.revision, undoable=bool(done.active), redoable=bool(done.undone)
    )
    standing = _next_program(
        standing,
        notes=view.notes,
        complete=not standing.is_open,
        revision=done.revision,
        author=edited.author,
        edited=edited.at,
    )
    standing, status = with_status(standing)
    return standing, [*changes, Publish(program_of(standing)), status]


def with_repeated_edit(
    standing: SessionState, view: PipelineView, edited: EditOutcome, version: int
) -> SessionState:
    """What an edit of the journal made of it: as `with_edit`, with the version that its program had."""
    standing, _ = with_edit(standing, view, edited)
    return standing._replace(heading=standing.heading.model_copy(update={"version": version}))


def settled(standing: SessionState, view: PipelineView) -> SessionState:
    """With the view that the corrections come to which have been counted already."""
    standing, _ = with_view(standing, view, standing.tally)
    heading = standing.heading.model_copy(update={"t": time_of(view), "notes": view.notes})
    return standing._replace(heading=heading, apps=view.apps)


def _next_program(standing: SessionState, **changes: Any) -> SessionState:
    heading, view = standing.heading, standing.view
    changes |= {"version": heading.version + 1, "t": time_of(view)} | _of_the_demonstration(view)
    return standing._replace(heading=heading.model_copy(update=changes), apps=view.apps)


def _of_the_demonstration(view: PipelineView) -> dict[str, Any]:
    """What a check compares the program with, beside its apps."""
    return {"gaps": view.gaps[-MAX_GAPS:], "wrench": view.wrench, "force_limit_n": view.force_limit_n}


def _posterior(view: PipelineView) -> tuple[object, ...]:
    return view.observations, view.posterior_starts, view.posterior_probabilities


def first_difference(old: Sequence[M], new: Sequence[M]) -> int | None:
    """The first index at which two sequences differ; None where they are alike."""
    if old is new:
        return None
    known = alike(old, new)
    for first in range(known, min(len(old), len(new)), AT_ONCE):
        last = first + AT_ONCE
        for index, (before, after) in enumerate(zip(old[first:last], new[first:last], strict=False), first):
            if before is not after and before != after:
                return index
    return None if len(old) == len(new) else min(len(old), len(new))


def _bump(standing: SessionState, stream: Stream) -> SessionState:
    return standing._replace(last_seq={**standing.last_seq, stream: standing.last_seq[stream] + 1})

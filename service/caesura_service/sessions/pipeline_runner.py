"""The pipeline of a session with its state, and the messages that it publishes.

An error in the pipeline ends the session with the reason in its status and its program; nothing
is raised. Samples arrive in order and once; the batch receiver orders them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    App,
    Description,
    Edit,
    EditEffect,
    EditProgram,
    Open,
    Preview,
    Redo,
    Since,
    TakeBack,
    Undo,
)
from caesura_service.journal import AppliedEdit, AppliedProgramEdit
from caesura_service.publishing import state_updates
from caesura_service.publishing.edit_effect import effect_of, is_alike
from caesura_service.publishing.events import BatchRejected, Output, Owner, Publish, SessionFailed
from caesura_service.publishing.lifecycle_transitions import Lifecycle, LifecycleEvent, next_state
from caesura_service.publishing.session_state import (
    SessionCounters,
    SessionState,
    check_program_edit,
    observed_until_s,
    program_of,
)
from caesura_service.segmentation.corrections import EditHistory, ResolvedEdit, with_states
from caesura_service.segmentation.pipeline_interface import Pipeline
from caesura_service.sessions.limits import Limits

logger = logging.getLogger(__name__)
Push = Callable[[NDArray[np.float64]], bool]  # a pipeline's `push`, or `push_without_program`


class PreparedEdit(NamedTuple):
    """A validated edit with its filtered pipeline, ready to be applied."""

    outcome: state_updates.EditOutcome
    pipeline: Pipeline
    effect: EditEffect


class PipelineHost:
    """A pipeline and its published state, which is replaced at every change.

    Most batches change only their number: they are counted until the state is read.
    """

    def __init__(
        self,
        station: str,
        opening: Open,
        pipeline: Pipeline,
        *,
        owner: Owner,
        limits: Limits,
        opened: float | None = None,
    ) -> None:
        """opened: time of day of the first opening [s], if known."""
        self.corrections = EditHistory()
        self._pipeline = pipeline
        self._applied_corrections: tuple[ResolvedEdit, ...] = ()  # corrections that the pipeline applies
        self._is_outdated = False  # another version made the state, and this one infers other results
        self._limits = limits
        self._status_t = 0.0  # [s] session time of the last status
        self._program_t = 0.0  # [s] session time of the last published program
        self._program_pending = False  # has it changed since?
        self.status_throttled = False  # a status was just published: the next one waits
        self._throttled_until_s: float | None = None  # [s] real time, once it is known
        self._status_pending = False  # a status is to be published once the throttle allows it
        preset = opening.preset or ""
        first = state_updates.initial_state(station, opening.session, owner, preset, pipeline.view)
        first = first._replace(description=opening.description or Description(), opened=opened)
        self._latest: tuple[SessionState, int, int] = (first, 0, 0)  # and the batches and samples since

    @property
    def state(self) -> SessionState:
        """The current state; any thread may read it."""
        published, batches, samples = self._latest
        return published.with_counts(batches, samples) if batches else published

    @state.setter
    def state(self, state: SessionState) -> None:
        self._latest = (state, 0, 0)

    @property
    def last_published_state(self) -> SessionState:
        """The newest state that differs from the one before in more than its number of batches."""
        return self._latest[0]

    @property
    def lifecycle(self) -> Lifecycle:
        """The state in the table of transitions."""
        return self.last_published_state.lifecycle

    def initial_messages(self) -> list[Publish]:
        """Publish the first message of each stream."""
        self.state, outputs = state_updates.initial_messages(self.state)
        return outputs

    @property
    def due_s(self) -> float:
        """The session time [s] of the first sample that changes more than counts, as of `Pipeline.due_s`."""
        return self._pipeline.due_s

    def push(self, samples: NDArray[np.float64]) -> list[Output]:
        """Push the samples (n, columns) of a batch; invalid ones are rejected and leave a gap."""
        try:
            return self._push(samples, 1, self._pipeline.push)
        except ProtocolError as error:
            return [*self.reject_batch(error), *self.declare_gap(1)]

    def push_together(
        self, samples: NDArray[np.float64], batches: int, *, without_program: bool = False
    ) -> list[Output]:
        """Push the samples of several batches of one size, with the results of separate pushes.

        The caller has made sure that `due_s` allows it. If a batch is invalid, the joint push changes nothing
        and the batches are pushed one by one.
        without_program: postpone a due program to `make_due_program`, which must be called next.
        """
        push = self._pipeline.push_without_program if without_program else self._pipeline.push
        try:
            return self._push(samples, batches, push)
        except ProtocolError:  # nothing has changed: which batch has to be rejected is found one by one
            parts = np.split(samples, batches)
            return [output for part in parts if self.lifecycle == "open" for output in self.push(part)]

    @property
    def has_due_program(self) -> bool:
        """Whether the last push has postponed a program to `make_due_program`."""
        return self._pipeline.has_due_program

    def make_due_program(self) -> list[Output]:
        """Make the program that the last push has postponed, if any, and publish it."""
        if not self._pipeline.has_due_program:
            return []
        try:
            self._pipeline.make_due_program()  # may give way, as a push
        except Exception as error:
            return self._fail(error)
        return self._run_guarded(self._update_view)

    def _push(self, samples: NDArray[np.float64], count: int, push: Push) -> list[Output]:
        """Push the samples of `count` batches.

        Raises ProtocolError for invalid ones, which change no result.
        """
        try:
            changed = _push(push, samples)  # may give way: what is published meanwhile is not retracted
        except ProtocolError:
            raise
        except Exception as error:
            return self._fail(error)
        published, batches, before = self._latest
        if not changed:
            self._latest = (published, batches + count, before + len(samples))
            return []
        counters = published.counters._replace(batches=published.counters.batches + batches + count)
        return self._run_guarded(lambda: self._update_view(counters))

    def declare_gap(self, batches: int) -> list[Output]:
        """Declare this number of batches lost: a gap between the last sample and the next."""

        def step() -> list[Output]:
            self._pipeline.declare_gap()
            counters = self.state.counters
            return [
                *self._update_view(counters._replace(lost=counters.lost + batches)),
                *self._publish_status_throttled(),
            ]

        return self._run_guarded(step)

    def finish(self) -> list[Output]:
        """Finish the pipeline and close; on an error the lifecycle is `failed`."""

        def step() -> list[Output]:
            self._pipeline.finish()
            self._transition("close")
            return [*self._update_view(), self.publish_status()]

        return self._run_guarded(step)

    def prepare_edit(self, edit: Edit, at: float) -> PreparedEdit:
        """Filter a pipeline with one more edit; the session does not change.

        at: time of day [s]. Raises ProtocolError for an edit that does not apply. A refused edit is not
        recorded, so the pipeline must not be brought up to date for it: a replay would make later results at
        other times.
        """
        return self._prepare(edit, at, copy(self._pipeline))

    def preview(self, asked: Preview, at: float) -> EditEffect:
        """Return what an edit would change, or what the corrections after one have changed.

        Raises as `prepare_edit`. A copy of the pipeline is brought up to date, because that decides when the
        next results are made.
        """
        present, action = copy(self._pipeline), asked.action
        if isinstance(action, Since):
            then = self.corrections.up_to(action.number)
            _, before, after = self._corrected(then, present)
            return self._effect(after, before)
        edit = Edit(session=asked.session, revision=asked.revision, author="preview", action=action)
        return self._prepare(edit, at, present).effect

    def _prepare(self, edit: Edit, at: float, present: Pipeline) -> PreparedEdit:
        if isinstance(edit.action, TakeBack):
            taken_back = self.corrections.taken_back(edit.action)
            self.corrections.check_unreferred(taken_back, present.observation_at)
        corrections = self.corrections.after(edit, at, present.resolve)
        corrected, before, after = self._corrected(corrections, present)
        outcome = state_updates.EditOutcome(corrections, edit.author, at)
        return PreparedEdit(outcome, corrected, self._effect(before, after))

    def _effect(self, before: SessionState, after: SessionState) -> EditEffect:
        """Return the effect of corrections alone; it states whether further results change."""
        return effect_of(before, after).model_copy(update={"inferred_again": self._is_outdated})

    def _corrected(
        self, corrections: EditHistory, present: Pipeline
    ) -> tuple[Pipeline, SessionState, SessionState]:
        """Return a pipeline with other corrections, and the state now and with them."""
        corrected = present.corrected(corrections.active)
        present.refresh()  # both at the same observation
        before, after = (
            self.state._replace(view=one.view, apps=one.view.apps) for one in (present, corrected)
        )
        listed = with_states(corrections.listed, corrected.view.unapplied)  # edits of the program heed these
        header = self.state.program_header.model_copy(update={"corrections": listed})
        return corrected, before, after._replace(program_header=header)

    def apply_edit(self, edited: state_updates.EditOutcome, pipeline: Pipeline) -> list[Output]:
        """Replace history and pipeline by the edited ones, and publish the differences."""
        if self._is_outdated:
            logger.warning(
                "%s/%s: another version of the service had inferred its results. For an edit by %s it is "
                "inferred again, and results change elsewhere, too",
                self.state.station,
                self.state.session,
                edited.author,
            )
            self._is_outdated = False
        self.corrections, self._pipeline = edited.corrections, pipeline
        self._applied_corrections = edited.corrections.active
        self.state, outputs = state_updates.apply_edit(self.state, pipeline.view, edited)
        self._status_t = max(self._status_t, self.state.view.t)
        self._program_t, self._program_pending = observed_until_s(self.state.view), False
        return [*outputs]

    def describe(self, description: Description, author: str | None = None) -> Publish:
        """Replace the description, and publish it. author: of the `Describe`; None at a close."""
        self.state = self.state.with_description(description, author)
        return self.publish_status()

    def check_program_edit(self, command: EditProgram, at: float) -> None:
        """Check that an edit applies to the current program. Raises ProtocolError. at: time of day [s]."""
        log = self.state.program_edits.after(command, at, replacing_apps(command))
        if not isinstance(command.action, Undo | Redo):
            check_program_edit(self.state, log)

    def edit_program(self, command: EditProgram, at: float) -> Publish:
        """Add an edit of the program to its log, and publish the program. at: time of day [s].

        A replayed edit may no longer apply; the program then lists it with the reason.
        """
        log = self.state.program_edits.after(command, at, replacing_apps(command))
        self.state, published = state_updates.apply_program_edit(self.state, log, command.author, at)
        self._program_t, self._program_pending = observed_until_s(self.state.view), False
        return published

    # Edits of the journal: each is counted at its place among the batches, their corrections are filtered
    # once. They mean the same from the first sample on as after the last one. So the pipeline may apply all
    # of them from the beginning (`prefilter_edits`), and has to at the end (`refilter`).

    def prefilter_edits(self, edits: Iterable[AppliedEdit]) -> None:
        """Filter with all of these edits from now on; `replay_edit` then counts each at its place."""
        corrections = self.corrections
        for edit in edits:
            if edit.revision < corrections.revision:
                continue
            if not edit.is_resolved:
                return  # what it comes to depends on what will be shown
            try:
                corrections = corrections.again(edit, self._pipeline.kinds, at=0.0)
            except ProtocolError:
                corrections = corrections.passed_over()
        self._set_corrections(corrections.active)

    def replay_edit(self, edit: AppliedEdit, at: float) -> list[Output]:
        """Replay a recorded edit; count one that no longer applies as rejected. at: time of day [s]."""
        try:
            if edit.version is None:
                self.refilter()
                corrections = self.corrections.after(edit, at, self._pipeline.resolve)
                if not isinstance(edit.action, Undo | Redo):
                    corrections = corrections.as_anew()
                pipeline = self._pipeline.corrected(corrections.active)
                logger.warning(
                    "%s/%s: the journal has no result of the edit of revision %d by %s, written by an older "
                    "version: the edit is resolved again, and its result may differ",
                    self.state.station,
                    self.state.session,
                    edit.revision,
                    edit.author,
                )
                return self.apply_edit(state_updates.EditOutcome(corrections, edit.author, at), pipeline)
            corrections = self.corrections.again(edit, self._pipeline.kinds, at)
        except ProtocolError as error:
            self.corrections = self.corrections.passed_over()
            self.state = self.state._replace(revision=self.corrections.revision)
            return self.reject(error)
        self.corrections = corrections
        self._pipeline.refresh()
        edited = state_updates.EditOutcome(corrections, edit.author, at)
        self.state = state_updates.replay_edit(self.state, self._pipeline.view, edited, edit.version)
        return []

    def refilter(self) -> None:
        """Filter again if the pipeline's corrections differ from the counted ones."""
        if self._set_corrections(self.corrections.active):
            self.state = state_updates.apply_corrected_view(self.state, self._pipeline.view)

    def _set_corrections(self, corrections: tuple[ResolvedEdit, ...]) -> bool:
        """Filter with these corrections; return whether that changed the pipeline."""
        if corrections == self._applied_corrections or self.lifecycle == "failed":
            return False
        self._pipeline, self._applied_corrections = self._pipeline.corrected(corrections), corrections
        return True

    def adopt_rebuilt(self, rebuilt: PipelineHost) -> None:
        """Use pipeline and history of the same session, rebuilt from its records; keep the state."""
        self._pipeline, self.corrections = rebuilt._pipeline, rebuilt.corrections
        self._applied_corrections = rebuilt._applied_corrections
        self._is_outdated = not is_alike(self.state, rebuilt.state)

    def reject(self, error: ProtocolError) -> list[Output]:
        """Count a refusal, and publish it in a status."""
        self.state = self.state._replace(counters=self.state.counters.with_refusal(error))
        return self._publish_status_throttled()

    def reject_batch(self, error: ProtocolError) -> list[Output]:
        """Count a batch with invalid content, for the session, and by the output for the service."""
        return [BatchRejected(error), *self.reject(error)]

    def count_dropped(self, messages: int) -> list[Output]:
        """Count messages that the queue dropped, and publish that in a status."""
        counters = self.state.counters
        self.state = self.state._replace(counters=counters._replace(dropped=counters.dropped + messages))
        return self._publish_status_throttled()

    def flush_status(self, now: float) -> list[Output]:
        """Publish a postponed status; `status_throttled` states whether to call again. now: [s]."""
        if self._throttled_until_s is None or now < self._throttled_until_s:
            self._throttled_until_s = self._throttled_until_s or now + self._limits.refusal_status_interval_s
            return []
        self.status_throttled, self._throttled_until_s = self._status_pending, None
        return [self.publish_status()] if self._status_pending else []

    def count_duplicate(self) -> None:
        """Count a duplicate batch."""
        counters = self.state.counters
        self.state = self.state._replace(counters=counters._replace(duplicates=counters.duplicates + 1))

    def set_owner(self, owner: Owner) -> None:
        """Publish under this owner from now on."""
        header = self.state.program_header.model_copy(
            update={"instance": owner.instance, "epoch": owner.epoch}
        )
        self.state = self.state._replace(owner=owner, program_header=header)

    def set_missing_batch(self, seq: int | None) -> None:
        """Set the missing batch that the status names; None for none."""
        if seq != self.last_published_state.waiting_for:
            self.state = self.state._replace(waiting_for=seq)

    def publish_status(self) -> Publish:
        """Publish the current status."""
        self._status_t = max(self._status_t, self.state.view.t)
        self._status_pending = False
        self.state, outputs = state_updates.publish_status(self.state)
        return outputs

    def _publish_status_throttled(self) -> list[Output]:
        """Publish a status now, or coalesce: at most one per `refusal_status_interval_s`."""
        if self.status_throttled:
            self._status_pending = True
            return []
        self.status_throttled = True
        return [self.publish_status()]

    def _update_view(self, counters: SessionCounters | None = None) -> list[Output]:
        """Publish the changes of the pipeline's view, and a status if one is due."""
        before = self.last_published_state  # what has been counted since, the view and the tally have
        counters = counters or self.state.counters
        self.state, changes = state_updates.apply_view(before, self._pipeline.view, counters)
        self.state = state_updates.update_program(self.state)
        self._program_pending |= self.state.program_header.version > before.program_header.version
        view = self.state.view
        due = view.gaps != before.view.gaps or view.t >= self._status_t + self._limits.status_interval_s
        program = [] if self._pipeline.has_due_program else self._program_if_due()
        return [*changes, *([self.publish_status()] if due else []), *program]

    def _program_if_due(self) -> list[Output]:
        """Publish a changed program, the less often the longer it is; at once when closed."""
        t = observed_until_s(self.state.view)
        waits_s = len(self.state.view.apps) / self._limits.apps_per_s
        if not self._program_pending or (self.state.is_open and t < self._program_t + waits_s):
            return []
        self._program_t, self._program_pending = t, False
        return [Publish(program_of(self.state))]

    def _run_guarded(self, step: Callable[[], list[Output]]) -> list[Output]:
        """Run a step. On an error drop its outputs, restore the previous state and fail the session."""
        before = self._latest
        try:
            return step()
        except ProtocolError:
            raise
        except Exception as error:
            self._latest = before
            return self._fail(error)

    def _fail(self, error: Exception) -> list[Output]:
        self._transition("fail")
        reason = f"closed by an error in processing: {type(error).__name__}: {error}"
        self.state = state_updates.update_program(self.state, note=reason)
        failed = SessionFailed(self.state.station, self.state.session, error)
        return [failed, Publish(program_of(self.state)), *self.reject(ProtocolError("conflict", reason))]

    def _transition(self, event: LifecycleEvent) -> None:
        self.state = self.state._replace(lifecycle=next_state(self.lifecycle, event))


def replacing_apps(command: EditProgram) -> tuple[App, ...]:
    """Return the apps with which a recorded edit replaces a part."""
    return command.apps if isinstance(command, AppliedProgramEdit) else ()


def _push(push: Push, samples: NDArray[np.float64]) -> bool:
    """Push samples; return whether the view changed. Raises ProtocolError `malformed`.

    For invalid samples the pipeline raises ValueError and is unchanged; every other error is internal.
    """
    try:
        return push(samples)
    except ValueError as error:
        if type(error) is not ValueError:
            raise
        raise ProtocolError("malformed", str(error)) from error

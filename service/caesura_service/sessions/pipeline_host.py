"""The pipeline of a session with its state, and the messages that it publishes.

An error in the pipeline ends the demonstration with the reason in its status and its program; nothing
is raised. Samples arrive here in order and once; ordering is the session's business.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Action, Open, Redo, Undo
from caesura_service.journal import Edit
from caesura_service.publishing import messages
from caesura_service.publishing.events import BatchRejected, Output, Owner, Publish, SessionFailed
from caesura_service.publishing.lifecycle import Lifecycle, LifecycleEvent, next_state
from caesura_service.publishing.session_state import (
    SessionCounters,
    SessionState,
    observed_until_s,
    program_of,
)
from caesura_service.segmentation.corrections import EditHistory, ResolvedEdit
from caesura_service.segmentation.view import Pipeline
from caesura_service.sessions.limits import Limits

logger = logging.getLogger(__name__)


class PipelineHost:
    """A pipeline and its standing, which is replaced at every change.

    Most batches change only their number: they are counted until the state is read.
    """

    def __init__(
        self, station: str, opening: Open, pipeline: Pipeline, *, owner: Owner, limits: Limits
    ) -> None:
        self.corrections = EditHistory()
        self._pipeline = pipeline
        self._filtered: tuple[ResolvedEdit, ...] = ()  # corrections that the pipeline heeds
        self._limits = limits
        self._status_t = 0.0  # [s] session time of the last status
        self._program_t = 0.0  # [s] session time of the last program that was put
        self._program_unsaid = False  # has it changed since?
        self.is_hushed = False  # was a status just published, so that the next one has to wait?
        self._hushed_until: float | None = None  # [s] real time, once it is known
        self._unsaid = False  # has something been left unsaid meanwhile?
        preset = opening.preset or ""
        first = messages.initial_state(station, opening.session, owner, preset, pipeline.view)
        self._latest: tuple[SessionState, int, int] = (first, 0, 0)  # and the batches and samples since

    @property
    def standing(self) -> SessionState:
        """Where it stands; any thread may ask."""
        looked, batches, samples = self._latest
        return looked.with_counts(batches, samples) if batches else looked

    @standing.setter
    def standing(self, state: SessionState) -> None:
        self._latest = (state, 0, 0)

    @property
    def looked(self) -> SessionState:
        """The same without the batches since there was last something else to say."""
        return self._latest[0]

    @property
    def state(self) -> Lifecycle:
        """Where it is in the table of moves."""
        return self.looked.lifecycle

    def begin(self) -> list[Publish]:
        """The first words."""
        self.standing, outputs = messages.initial_messages(self.standing)
        return outputs

    def push(self, samples: NDArray[np.float64]) -> list[Output]:
        """Take a batch, (n, columns). One that cannot be right is refused and leaves a gap."""
        try:
            news = _push(self._pipeline, samples)  # may give way: what is said meanwhile is not taken back
        except ProtocolError as error:
            return [BatchRejected(error), *self.refuse(error), *self.gap(1)]
        except Exception as error:
            return self._fail(error)
        looked, batches, before = self._latest
        if not news:
            self._latest = (looked, batches + 1, before + len(samples))
            return []
        counters = looked.counters._replace(batches=looked.counters.batches + batches + 1)
        return self._guarded(lambda: self._look(counters))

    def gap(self, batches: int) -> list[Output]:
        """So many batches will never come; what is between the last sample and the next is not known."""

        def step() -> list[Output]:
            self._pipeline.declare_gap()
            counters = self.standing.counters
            return [*self._look(counters._replace(lost=counters.lost + batches)), *self._occasion()]

        return self._guarded(step)

    def finish(self) -> list[Output]:
        """Decide what is still open; the state shows whether that succeeded."""

        def step() -> list[Output]:
            self._pipeline.finish()
            self._move("close")
            return [*self._look(), self.status()]

        return self._guarded(step)

    def corrected(self, action: Action) -> tuple[EditHistory, Pipeline]:
        """The corrections with one edit more, and what comes of them; nothing changes.

        Raises ProtocolError where the edit makes no sense.
        """
        corrections = self.corrections.after(action, self._pipeline.resolve)
        return corrections, self._pipeline.corrected(corrections.active)

    def correct(self, edited: messages.EditOutcome, pipeline: Pipeline) -> list[Output]:
        """Go on as corrected, and say so at once."""
        self.corrections, self._pipeline = edited.corrections, pipeline
        self._filtered = edited.corrections.active
        self.standing, outputs = messages.apply_edit(self.standing, pipeline.view, edited)
        self._status_t = max(self._status_t, self.standing.view.t)
        self._program_t, self._program_unsaid = observed_until_s(self.standing.view), False
        return [*outputs]

    # Edits of the journal: each is counted at its place among the batches, their corrections are filtered
    # once. They mean the same from the first sample on as after the last one. So the pipeline may heed all of
    # them from the beginning (`foresee`), and has to at the end (`settle`).

    def foresee(self, edits: Iterable[Edit]) -> None:
        """Filter from here on as all of these will have it; those that are no news yet come by `repeat`."""
        corrections = self.corrections
        for edit in edits:
            if edit.revision < corrections.revision:
                continue
            if not edit.is_resolved:
                return  # what it comes to depends on what will be shown
            try:
                corrections = corrections.again(edit, self._pipeline.kinds)
            except ProtocolError:
                corrections = corrections.passed_over()
        self._filter(corrections.active)

    def repeat(self, edit: Edit, at: float) -> list[Output]:
        """An edit that was carried out before, at [s]; one that makes no sense now is counted and refused."""
        try:
            if edit.version is None:
                self.settle()
                corrections = self.corrections.after(edit.action, self._pipeline.resolve)
                if not isinstance(edit.action, Undo | Redo):
                    corrections = corrections.as_anew()
                pipeline = self._pipeline.corrected(corrections.active)
                logger.warning(
                    "%s/%s: the journal has no result of the edit of revision %d by %s, as older versions "
                    "wrote it: it is resolved anew, perhaps otherwise",
                    self.standing.station,
                    self.standing.session,
                    edit.revision,
                    edit.author,
                )
                return self.correct(messages.EditOutcome(corrections, edit.author, at), pipeline)
            corrections = self.corrections.again(edit, self._pipeline.kinds)
        except ProtocolError as error:
            self.corrections = self.corrections.passed_over()
            self.standing = self.standing._replace(revision=self.corrections.revision)
            return self.refuse(error)
        self.corrections = corrections
        self._pipeline.refresh()
        edited = messages.EditOutcome(corrections, edit.author, at)
        self.standing = messages.replay_edit(self.standing, self._pipeline.view, edited, edit.version)
        return []

    def settle(self) -> None:
        """Filter anew, where the pipeline does not heed exactly the corrections that have been counted."""
        if self._filter(self.corrections.active):
            self.standing = messages.apply_corrected_view(self.standing, self._pipeline.view)

    def _filter(self, corrections: tuple[ResolvedEdit, ...]) -> bool:
        """Does that change anything?"""
        if corrections == self._filtered or self.state == "failed":
            return False
        self._pipeline, self._filtered = self._pipeline.corrected(corrections), corrections
        return True

    def revive(self, rebuilt: PipelineHost) -> None:
        """Have the mathematics of the same demonstration, folded again; what has been said of it stands."""
        self._pipeline, self.corrections = rebuilt._pipeline, rebuilt.corrections
        self._filtered = rebuilt._filtered

    def refuse(self, error: ProtocolError) -> list[Output]:
        """Count a refusal, and show it."""
        self.standing = self.standing._replace(counters=self.standing.counters.with_refusal(error))
        return self._occasion()

    def drop(self, messages: int) -> list[Output]:
        """Count what came and found no room, and show it."""
        counters = self.standing.counters
        self.standing = self.standing._replace(
            counters=counters._replace(dropped=counters.dropped + messages)
        )
        return self._occasion()

    def tick(self, now: float) -> list[Output]:
        """Publish a status that was postponed; `is_hushed` states whether to call it again."""
        if self._hushed_until is None or now < self._hushed_until:
            self._hushed_until = self._hushed_until or now + self._limits.hush_s
            return []
        self.is_hushed, self._hushed_until = self._unsaid, None
        return [self.status()] if self._unsaid else []

    def duplicate(self) -> None:
        """Count a batch that came again."""
        counters = self.standing.counters
        self.standing = self.standing._replace(counters=counters._replace(duplicates=counters.duplicates + 1))

    def hand_to(self, owner: Owner) -> None:
        """Speak as this owner from here on."""
        header = self.standing.program_header.model_copy(
            update={"instance": owner.instance, "epoch": owner.epoch}
        )
        self.standing = self.standing._replace(owner=owner, program_header=header)

    def wait_for(self, seq: int | None) -> None:
        """Remember which batch is missing."""
        if seq != self.looked.waiting_for:
            self.standing = self.standing._replace(waiting_for=seq)

    def status(self) -> Publish:
        """How it is doing."""
        self._status_t = max(self._status_t, self.standing.view.t)
        self._unsaid = False
        self.standing, outputs = messages.publish_status(self.standing)
        return outputs

    def _occasion(self) -> list[Output]:
        """Publish a status now, or coalesce: at most one per `hush_s`."""
        if self.is_hushed:
            self._unsaid = True
            return []
        self.is_hushed = True
        return [self.status()]

    def _look(self, counters: SessionCounters | None = None) -> list[Output]:
        """What the pipeline makes of it now, and a status where one is due."""
        before = self.looked  # what has been counted since, the view and the tally have
        counters = counters or self.standing.counters
        self.standing, changes = messages.apply_view(before, self._pipeline.view, counters)
        self.standing = messages.update_program(self.standing)
        self._program_unsaid |= self.standing.program_header.version > before.program_header.version
        view = self.standing.view
        due = view.gaps != before.view.gaps or view.t >= self._status_t + self._limits.status_interval_s
        return [*changes, *self._program_in_turn(), *([self.status()] if due else [])]

    def _program_in_turn(self) -> list[Output]:
        """The program as it is, not oftener than its length allows; once closed at once."""
        t = observed_until_s(self.standing.view)
        waits_s = len(self.standing.view.apps) / self._limits.apps_per_s
        if not self._program_unsaid or (self.standing.is_open and t < self._program_t + waits_s):
            return []
        self._program_t, self._program_unsaid = t, False
        return [Publish(program_of(self.standing))]

    def _guarded(self, step: Callable[[], list[Output]]) -> list[Output]:
        """What a step says; if it breaks, it has said nothing, and the demonstration ends where it stood."""
        before = self._latest
        try:
            return step()
        except ProtocolError:
            raise
        except Exception as error:
            self._latest = before
            return self._fail(error)

    def _fail(self, error: Exception) -> list[Output]:
        self._move("fail")
        reason = f"closed by an error in processing: {type(error).__name__}: {error}"
        self.standing = messages.update_program(self.standing, note=reason)
        failed = SessionFailed(self.standing.station, self.standing.session, error)
        return [failed, Publish(program_of(self.standing)), *self.refuse(ProtocolError("conflict", reason))]

    def _move(self, event: LifecycleEvent) -> None:
        self.standing = self.standing._replace(lifecycle=next_state(self.state, event))


def _push(pipeline: Pipeline, samples: NDArray[np.float64]) -> bool:
    """As the pipeline does. Raises ProtocolError `malformed` where it finds that the samples cannot be right.

    It raises a plain ValueError and has not changed then; every other error is internal.
    """
    try:
        return pipeline.push(samples)
    except ValueError as error:
        if type(error) is not ValueError:
            raise
        raise ProtocolError("malformed", str(error)) from error

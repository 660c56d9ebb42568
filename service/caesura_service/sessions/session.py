"""A session is a fold over its journal: opening, samples, declared losses, edits, close.

Rules
- A message that changes the session is recorded before it is processed; replaying the records gives the same
  session bit for bit. A message that cannot be recorded is not processed: the sender gets a refusal, and
  nothing is lost.
- A crash never retracts a published result. The results of a batch may be published before its record is
  on disk, because the bridge still has it. Every other message is on disk before it is processed, and every
  record before it is acknowledged.
- A batch is processed in sequence, exactly once (`batch_receiver`).
- A restarted bridge opens the session again with a higher epoch and continues numbering at the `next_seq` of
  the acknowledgement: batches that its predecessor had not delivered are lost. Until the new bridge has
  opened the session, its batches are refused; those of an older epoch always are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    Ack,
    Close,
    Correction,
    Describe,
    Edit,
    EditEffect,
    EditProgram,
    Error,
    Heartbeat,
    Open,
    Preview,
    ProgramEdit,
    Redo,
    SampleBatch,
    TakeBack,
    Undo,
)
from caesura_protocol.number_words import counted
from caesura_service.journal import AppliedEdit, AppliedProgramEdit, Journal, Outcome, Record
from caesura_service.publishing.events import Incoming, Output, Owner, ReplayEnded, Reply
from caesura_service.publishing.lifecycle_transitions import STATE_WORDS, next_state
from caesura_service.publishing.session_state import SessionState, inferred_program_of, snapshot_of
from caesura_service.segmentation.corrections import EditHistory
from caesura_service.segmentation.pipeline_interface import Pipeline
from caesura_service.sessions.batch_receiver import BatchReceiver
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.pipeline_runner import PipelineHost, replacing_apps
from caesura_service.sessions.same_layout_batches import BatchBlock
from caesura_service.sessions.session_journal import SessionJournal


class Awaited(NamedTuple):
    """The batch that a session expects, and the session time that completes its next observation [s].

    due_s: −inf if every batch must be processed separately.
    """

    next_seq: int
    due_s: float


class Session:
    """One demonstration at a station. Any thread may read `state`; one thread calls the rest."""

    def __init__(
        self,
        station: str,
        opening: Open,
        pipeline: Pipeline,
        *,
        owner: Owner,
        journal: Journal,
        limits: Limits,
        opened: float | None = None,
        check_current: Callable[[], None] = lambda: None,
    ) -> None:
        """opening: with its preset filled in, so that a replay does not depend on the service's choice.

        opened: time of day of the first opening [s], if known; check_current: raises JournalError if another
        instance owns the station now.
        """
        self._opening = opening
        self._host = PipelineHost(station, opening, pipeline, owner=owner, limits=limits, opened=opened)
        self._journal = SessionJournal(station, opening.session, journal, check_current)
        self._receiver = BatchReceiver(station, opening, self._host, self._journal, limits)
        self._collects_edits = False  # edits are collected, their corrections filtered at the end
        self._has_pipeline = True  # False for a session restored from its outcome

    @property
    def name(self) -> str:
        """The name of the session, unique at its station."""
        return self._opening.session

    @property
    def state(self) -> SessionState:
        """The current state; immutable."""
        return self._host.state

    @property
    def last_published_state(self) -> SessionState:
        """The state without the batches since it last changed in anything except their number."""
        return self._host.last_published_state

    @property
    def is_open(self) -> bool:
        """Whether the session accepts samples."""
        return self.last_published_state.is_open

    @property
    def has_pipeline(self) -> bool:
        """Whether the session has a pipeline, so that it can be corrected."""
        return self._has_pipeline

    @property
    def has_records(self) -> bool:
        """Whether this instance's journal has all of the session's records, so that more can follow."""
        return self.is_open or self._journal.exist(self.revision, self.state.neutral_changes)

    @property
    def revision(self) -> int:
        """The number of edits so far."""
        return self.state.revision

    @property
    def next_seq(self) -> int:
        """The number of the next expected batch."""
        return self._receiver.next_seq

    def begin(self, now: float) -> list[Output]:
        """Record the opening; publish the first messages and acknowledge. now: [s]."""
        self._journal.append(self._opening, now)
        return [*self._host.initial_messages(), self._ack()]

    def replay_records(self, records: Iterable[Record], edits: Iterable[AppliedEdit] = ()) -> Iterator[None]:
        """Replay the records after the opening without outputs or recording; yields after each.

        edits: the edits among the records, if given in advance: then nothing is filtered twice.
        """
        with self._journal.suspended(), self._collecting_edits():
            self._host.initial_messages()
            self._host.prefilter_edits(edits)
            for record in records:
                match record.message:
                    case Error(limit=int() as target) if target > self.next_seq:
                        self._receiver.declare_lost(target)
                    case AppliedEdit() as edit:
                        self._host.replay_edit(edit, record.at)
                    case EditProgram() as command:
                        self._host.edit_program(command, record.at)
                    case SampleBatch() if self._host.lifecycle == "failed":
                        pass  # it was recorded together with the one that failed
                    case Open() | SampleBatch() | Close() | Describe() as message:
                        self.receive(message, record.at)
                yield
        self._receiver.reset_backoff()
        self._store_outcome()

    def apply_peer_records(
        self, records: Iterable[Record], edits: Iterable[AppliedEdit] = ()
    ) -> Iterator[None]:
        """Apply and record another instance's records of this session; yield after each record.

        edits: as in `replay_records`. Publishes nothing. Raises as `receive`.
        """
        before = self.is_open, self.revision, self.state.neutral_changes
        known = self.state.neutral_changes  # descriptions and program edits that were applied earlier
        try:
            with self._journal.copying(), self._collecting_edits():
                self._host.prefilter_edits(edits)
                for record in records:
                    if isinstance(record.message, Describe | EditProgram) and known > 0:
                        known -= 1
                    elif self.is_open or isinstance(record.message, AppliedEdit | Describe | EditProgram):
                        self._apply_peer_record(record)
                    yield
        finally:
            self._receiver.reset_backoff()
            if (self.is_open, self.revision, self.state.neutral_changes) != before:
                self._store_outcome()

    @contextmanager
    def _collecting_edits(self) -> Iterator[None]:
        """Collect edits while the context lasts; filter their corrections once at its end.

        Of a session that the end of the service interrupts in that, no outcome is stored.
        """
        self._collects_edits = True
        try:
            yield
        finally:
            self._host.refilter()
            self._collects_edits = False

    def set_owner(self, owner: Owner) -> None:
        """Publish under this owner from now on."""
        self._host.set_owner(owner)

    def load_outcome(self, outcome: Outcome, state: SessionState) -> None:
        """Restore the closed session from an outcome, without a replay."""
        self._host.state = state
        self._receiver.skip_to(outcome.last_seq + 1)
        self._has_pipeline = False

    def adopt_rebuilt(self, rebuilt: Session) -> None:
        """Use the pipeline of the session rebuilt from the records, so that it can be corrected."""
        self._host.adopt_rebuilt(rebuilt._host)
        self._has_pipeline = True

    def receive(self, message: Incoming, now: float) -> list[Output]:
        """Process a message.

        Raises ProtocolError, and changes nothing, if it is refused completely; JournalError if it cannot be
        recorded.
        """
        match message:
            case SampleBatch():
                return self._receive_batch(message, now)
            case Heartbeat():
                return self._receive_heartbeat(message, now)
            case ReplayEnded():
                next_state(self.state.lifecycle, "replayed")
                return self._receiver.end_replay(message, now)
            case Open():
                return self._receive_opening(message, now)
            case Close():
                return self._receive_close(message, now)
            case Edit() | Preview() | Describe() | EditProgram():
                return self._receive_change(message, now)

    @property
    def awaited(self) -> Awaited:
        """The next batch and session time that the session expects from its bridge.

        Any thread may read them.
        """
        return Awaited(self.next_seq, self._host.due_s)

    def receive_together(self, block: BatchBlock, now: float) -> tuple[int, list[Output]]:
        """Process the first batches of a block together, as `receive` does in turn.

        Return their number, and the outputs. 0: the first one must be received separately. A due program is
        postponed to `make_due_program`, which must be called next. Raises JournalError.
        """
        message, opening = block.layout.message, self._opening
        is_own = message.bridge in {opening.bridge, None} or opening.bridge is None
        if not is_own or message.epoch != opening.epoch or self._host.lifecycle != "open":
            return 0, []
        return self._receiver.receive_together(block, now)

    @property
    def has_due_program(self) -> bool:
        """Whether the last block has postponed a program to `make_due_program`."""
        return self._host.has_due_program

    def make_due_program(self) -> list[Output]:
        """Make and publish the program that `receive_together` has postponed."""
        return self._host.make_due_program()

    def repeated(self, edit: Edit | EditProgram) -> Edit | EditProgram | None:
        """Return the record of an edit that was applied before; None of a new one.

        Its author repeats it after a lost acknowledgement. Raises JournalError.
        """
        kind = Edit if isinstance(edit, Edit) else EditProgram
        revision = self.revision if kind is Edit else self.state.program_edits.revision
        made = self._journal.edit_at(kind, edit.revision) if edit.revision < revision else None
        if made is None:
            return None
        same = (made.revision, made.author, made.action) == (edit.revision, edit.author, edit.action)
        return made if same else None

    def check_revision(self, edit: Edit | Preview) -> None:
        """Check that the edit is based on the current revision. Raises ProtocolError `conflict`."""
        if edit.revision != self.revision:
            why = "another operator has corrected the session meanwhile: look at it again"
            raise ProtocolError("conflict", why, value=edit.revision, limit=self.revision)

    def reject(self, error: ProtocolError) -> list[Output]:
        """Count a refusal for this session, and publish it in a status."""
        return self._host.reject(error)

    def request_missing(self, now: float) -> list[Output]:
        """Request missing batches if a request is due, with a status. now: [s]."""
        asked = self._receiver.request_missing(now)
        return [*asked, self._host.publish_status()] if asked else []

    def count_dropped(self, messages: int) -> list[Output]:
        """Count messages that the queue dropped, and publish that in a status."""
        return self._host.count_dropped(messages)

    @property
    def status_throttled(self) -> bool:
        """Whether a status about refusals is postponed; `flush_status` publishes it."""
        return self._host.status_throttled

    def flush_status(self, now: float) -> list[Output]:
        """Publish a postponed status if it is due. now: [s]."""
        return self._host.flush_status(now)

    # --- messages ---------------------------------------------------------------------------------------

    def _receive_batch(self, batch: SampleBatch, now: float) -> list[Output]:
        self._check_bridge(batch)
        state = self._host.lifecycle
        if state == "closed" and batch.seq < self.next_seq:
            self._host.count_duplicate()  # sent again, it trails behind the close
            return []
        next_state(state, "samples")
        self._check_epoch(batch.epoch)
        return self._receiver.receive_batch(batch, now)

    def _receive_heartbeat(self, heartbeat: Heartbeat, now: float) -> list[Output]:
        next_state(self.state.lifecycle, "heartbeat")
        if not self.is_open:
            return []
        self._check_bridge(heartbeat)
        self._check_epoch(heartbeat.epoch)
        return self._receiver.announce_seq(heartbeat.seq, now)

    def _receive_opening(self, reopening: Open, now: float) -> list[Output]:
        own: dict[str, object] = {
            "preset": reopening.preset or self._opening.preset,
            "description": self._opening.description,
        }
        if self._has_lost_up(reopening):
            own["up"] = None
        if not self._opening.assumed or not reopening.assumed:
            own["assumed"] = self._opening.assumed  # an older bridge or service leaves it out: it is a note
        reopening = reopening.model_copy(update=own)
        try:
            next_state(self.state.lifecycle, "open")
        except ProtocolError as refusal:
            if reopening != self._opening:
                why = f"{STATE_WORDS[self.state.lifecycle]}: give the new one another name"
                raise ProtocolError("conflict", why, value=reopening.session) from refusal
            return [Reply(refusal)]  # a repeated opening behind the close: no error
        if reopening.epoch == self._opening.epoch:
            self._check_bridge(reopening)
        mine = {"epoch": self._opening.epoch, "bridge": self._opening.bridge}
        if (stated := reopening.model_copy(update=mine)) != self._opening:
            there = vars(self._opening)
            differing = {name: value for name, value in vars(stated).items() if value != there[name]}
            raise ProtocolError(
                "conflict",
                f"the session is open with another setting: {', '.join(differing)}",
                value=", ".join(f"{name} {value!r}" for name, value in differing.items()),
                expected=", ".join(f"{name} {there[name]!r}" for name in differing),
            )
        if reopening.epoch > self._opening.epoch:
            return [*self._resume(reopening, now), self._ack()]
        self._check_epoch(reopening.epoch)
        return [self._ack()]

    def _has_lost_up(self, reopening: Open) -> bool:
        """Return whether an older service has recorded this opening without its direction of up.

        A bridge never changes its opening. The session continues as it began; the acknowledgement states
        that.
        """
        mine, is_stated = self._opening, reopening.up is not None
        is_same = reopening.bridge is not None and reopening.bridge == mine.bridge
        return is_stated and mine.up is None and is_same and reopening.epoch == mine.epoch

    def _receive_close(self, close: Close, now: float) -> list[Output]:
        self._check_bridge(close)
        next_state(self.state.lifecycle, "close")
        reached = self.next_seq - 1
        if close.last_seq < reached or (not self.is_open and close.last_seq > reached):
            closed = "" if self.is_open else "is closed and "
            why = f"the session {closed}has other batches than that"
            raise ProtocolError("conflict", why, value=close.last_seq, expected=reached)
        if not self.is_open:
            return [self._ack()]
        if close.last_seq > reached:
            return self._request_rest(close, now)
        self._journal.append(close, now)
        if close.success is not None:
            stated = self.state.description.model_copy(update={"success": close.success})
            return [self._host.describe(stated), *self._finish()]
        return self._finish()

    def _receive_change(self, change: Edit | Preview | Describe | EditProgram, now: float) -> list[Output]:
        """Process a command of an operator, or a preview of one, for an open or closed session."""
        match change:
            case Describe():
                return self._receive_description(change, now)
            case EditProgram():
                return self._receive_program_edit(change, now)
            case Edit():
                return self._receive_edit(change, now)
            case Preview():
                return self._receive_preview(change, now)

    def _receive_edit(self, edit: Edit, now: float) -> list[Output]:
        if made := self.repeated(edit):
            effect, moved = (made.effect, made.moved) if isinstance(made, AppliedEdit) else (None, None)
            return [self._ack(effect, edit.revision + 1, correction=moved)]
        self._check_editable(edit)
        prepared = self._host.prepare_edit(edit, now)
        moved = self._host.corrections.moved(edit.action)
        self._check_records_exist()  # once more: that may have taken long
        effect = prepared.effect if edit.with_effect else None
        record = self._edit_record(edit, prepared.outcome.corrections, effect, moved)
        self._journal.append(record, now)
        outputs = self._host.apply_edit(prepared.outcome, prepared.pipeline)
        self._store_outcome()
        return [*outputs, self._ack(effect, correction=moved)]

    def _receive_preview(self, preview: Preview, now: float) -> list[Output]:
        """Reply what an edit would change. Nothing is recorded, stored or published."""
        self._check_editable(preview)
        return [Reply(self._acknowledgement(self._host.preview(preview, now)))]

    def _check_editable(self, edit: Edit | Preview) -> None:
        """Check that an edit is based on the session that its author has seen. Raises ProtocolError."""
        next_state(self.state.lifecycle, "edit")
        self.check_revision(edit)
        self._check_records_exist()

    def _receive_description(self, command: Describe, now: float) -> list[Output]:
        next_state(self.state.lifecycle, "describe")
        present = self.state.description
        if present == command.description:
            return [self._ack()]  # a repeated command, whose answer was lost
        if present != command.before:
            why = "another operator has described the session meanwhile: look at it, and do it again"
            raise ProtocolError("conflict", why)
        self._check_records_exist()
        self._journal.append(command, now)
        status = self._host.describe(command.description, command.author)
        self._store_outcome()
        return [status, self._ack()]

    def _receive_program_edit(self, command: EditProgram, now: float) -> list[Output]:
        next_state(self.state.lifecycle, "edit_program")
        if made := self.repeated(command):
            return [self._ack(program_edit=made.moved if isinstance(made, AppliedProgramEdit) else None)]
        current = self.state.program_edits.revision
        if command.revision != current:
            why = "another operator has edited the program meanwhile: look at it again"
            raise ProtocolError("conflict", why, value=command.revision, limit=current)
        self._check_records_exist()
        self._host.check_program_edit(command, now)
        moved = self.state.program_edits.moved(command.action)
        record = AppliedProgramEdit(**vars(command), moved=moved) if moved else command
        self._journal.append(record, now)
        program = self._host.edit_program(command, now)
        self._store_outcome()
        return [program, self._ack(program_edit=moved)]

    def _check_records_exist(self) -> None:
        """Check that a closed session still has records. Raises ProtocolError `conflict`."""
        if not self.has_records:
            why = "the journal no longer has the session's samples: it cannot be corrected"
            raise ProtocolError("conflict", why, value=self.name)

    def _edit_record(
        self, edit: Edit, corrections: EditHistory, effect: EditEffect | None, moved: Correction | None
    ) -> AppliedEdit:
        """Return the record of an edit with its resolved form, which a replay uses.

        effect, moved: as its acknowledgement states them.
        """
        is_news = not isinstance(edit.action, Undo | Redo | TakeBack)
        return AppliedEdit(
            **vars(edit) | {"with_effect": False},
            resolution=corrections.active[-1].recorded() if is_news else None,
            version=self.last_published_state.program_header.version + 1,
            effect=effect,
            moved=moved,
        )

    def _apply_peer_record(self, record: Record) -> None:
        match record.message:
            case SampleBatch() as batch if not self._receiver.is_duplicate(batch.seq):
                self.receive(batch, record.at)
            case Error(limit=int() as target) if target > self.next_seq:
                self._journal.append(record.message, record.at)
                self._receiver.declare_lost(target)
            case Open() as reopening if reopening.epoch >= self._opening.epoch and reopening != self._opening:
                self.receive(reopening, record.at)
            case Close() as close:
                self.receive(close, record.at)
            case Describe() as description:
                self.receive(description, record.at)
            case EditProgram() as command if self.state.program_edits.takes(command, replacing_apps(command)):
                self._journal.append(command, record.at)
                self._host.edit_program(command, record.at)
            case AppliedEdit() as edit if edit.revision == self.revision:
                self._journal.append(edit, record.at)
                self._host.replay_edit(edit, record.at)

    # --- steps ------------------------------------------------------------------------------------------

    def _check_bridge(self, message: SampleBatch | Heartbeat | Open | Close) -> None:
        """Check that the message is from the session's bridge; one without a bridge name is accepted."""
        mine = self._opening.bridge
        if message.bridge == mine or mine is None or message.bridge is None:
            return
        if isinstance(message, SampleBatch | Heartbeat) and message.epoch != self._opening.epoch:
            return  # a predecessor's, or a successor's: its epoch says so
        raise ProtocolError(
            "conflict",
            f"bridge {mine} publishes this session, {counted(self.next_seq, 'batch')} so far: "
            "a second one needs a session of its own, or a higher epoch to take this one over",
            value=message.bridge,
            expected=mine,
        )

    def _check_epoch(self, epoch: int) -> None:
        current = self._opening.epoch
        if epoch < current:
            raise ProtocolError(
                "conflict", "a newer epoch of the bridge owns this session", value=epoch, limit=current
            )
        if epoch > current:
            why = "a restarted bridge opens the session before it sends"
            raise ProtocolError("conflict", why, value=epoch, limit=current)

    def _resume(self, reopening: Open, now: float) -> list[Output]:
        """Declare missing batches lost: a restarted bridge does not have its predecessor's batches."""
        outputs = self._receiver.declare_all_missing_lost(
            now
        )  # recorded first: the opening says nothing of them
        self._journal.append(reopening, now)
        self._opening = reopening
        return [*outputs, *self._host.declare_gap(0), self._host.publish_status()]

    def _request_rest(self, close: Close, now: float) -> list[Output]:
        """Request the missing batches before the close; the bridge repeats the close.

        No refusal is counted.
        """
        asked = self._receiver.announce_seq(close.last_seq, now)
        missing = "batches are missing before the close"
        refusal = ProtocolError("conflict", missing, value=self.next_seq, limit=close.last_seq)
        return [*asked, Reply(refusal)]

    def _finish(self) -> list[Output]:
        outputs = self._host.finish()
        self._store_outcome()
        if self.state.lifecycle == "closed":
            return [*outputs, self._ack()]
        refusal = self.state.counters.last_refusal
        why = refusal.message if refusal else "closed by an error in processing"
        return [*outputs, Reply(ProtocolError("conflict", why))]

    def _store_outcome(self) -> None:
        """Store the outcome of a closed session in the journal."""
        if self.state.lifecycle == "closed" and not self._collects_edits:
            snapshot = snapshot_of(self.state, inferred_program_of(self.state))
            self._journal.store_outcome(Outcome(self._opening, self.next_seq - 1, snapshot))

    def _ack(
        self,
        effect: EditEffect | None = None,
        revision: int | None = None,
        correction: Correction | None = None,
        program_edit: ProgramEdit | None = None,
    ) -> Reply:
        """Write all records to disk, then acknowledge. Raises JournalError.

        revision: that of an edit which was made before others; by default the current one. correction,
        program_edit: what an undo or a redo has undone or restored.
        """
        self._journal.commit()
        return Reply(self._acknowledgement(effect, revision, correction, program_edit))

    def _acknowledgement(
        self,
        effect: EditEffect | None,
        revision: int | None = None,
        correction: Correction | None = None,
        program_edit: ProgramEdit | None = None,
    ) -> Ack:
        state = self.state.lifecycle
        return Ack(
            session=self._opening.session,
            next_seq=self.next_seq,
            state="open" if state == "open" else "closed",
            revision=self.revision if revision is None else revision,
            effect=effect,
            lost=self.state.counters.lost,
            up=self._opening.up,
            correction=correction,
            program_edit=program_edit,
        )

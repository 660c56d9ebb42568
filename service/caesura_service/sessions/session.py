"""A session is a fold over its journal: open, samples, holes that were given up, close.

Rules
- What changes the session is recorded before it is processed; replaying the records gives the same
  session bit for bit. What cannot be recorded is not processed: the sender gets a refusal, and
  nothing is lost.
- A crash never retracts a published result. The results of a batch may be published before its record is
  safe, because the bridge still has it; everything else is safe before it is processed, and everything
  before an acknowledgement.
- A batch is processed in sequence, exactly once (`intake`).
- A restarted bridge opens the session again with a higher epoch and continues numbering at the
  `next_seq` of the acknowledgement: what its predecessor had not delivered is gone. Until it has opened,
  its batches are refused; those of an older epoch always are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Close, Edit, Error, Heartbeat, Open, Redo, SampleBatch, Undo
from caesura_service.journal import Edit as AppliedEdit
from caesura_service.journal import Journal, Outcome, Record
from caesura_service.publishing.events import Incoming, Output, Owner, ReplayEnded, Reply
from caesura_service.publishing.lifecycle import next_state
from caesura_service.publishing.messages import EditOutcome
from caesura_service.publishing.session_state import SessionState, snapshot_of
from caesura_service.segmentation.corrections import EditHistory
from caesura_service.segmentation.view import Pipeline
from caesura_service.sessions.batch_receiver import BatchReceiver
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.pipeline_host import PipelineHost
from caesura_service.sessions.session_journal import SessionJournal


class Session:
    """One demonstration at a station. `standing` may be read from any thread; the rest belongs to one."""

    def __init__(
        self,
        station: str,
        opening: Open,
        pipeline: Pipeline,
        *,
        owner: Owner,
        journal: Journal,
        limits: Limits,
    ) -> None:
        """opening: with its preset filled in, so that a replay does not depend on the service's choice."""
        self._opening = opening
        self._demonstration = PipelineHost(station, opening, pipeline, owner=owner, limits=limits)
        self._records = SessionJournal(station, opening.session, journal)
        self._intake = BatchReceiver(station, opening, self._demonstration, self._records, limits)
        self._collects = False  # edits, whose corrections are not filtered yet?
        self._folded = True  # is there more of it than its outcome?

    @property
    def name(self) -> str:
        """Of the session, unique at its station."""
        return self._opening.session

    @property
    def standing(self) -> SessionState:
        """Where it stands; immutable."""
        return self._demonstration.standing

    @property
    def looked(self) -> SessionState:
        """The same without the batches since there was last something else to say."""
        return self._demonstration.looked

    @property
    def is_open(self) -> bool:
        """Does it take samples?"""
        return self.looked.is_open

    @property
    def is_folded(self) -> bool:
        """Is there more of it than its outcome, so that it can be corrected?"""
        return self._folded

    @property
    def revision(self) -> int:
        """Edits so far."""
        return self.standing.revision

    @property
    def next_seq(self) -> int:
        """The batch that is waited for."""
        return self._intake.next_seq

    def begin(self, now: float) -> list[Output]:
        """Record the opening and say the first words."""
        self._records.append(self._opening, now)
        return [*self._demonstration.begin(), self._ack()]

    def restoring(self, records: Iterable[Record], edits: Iterable[AppliedEdit] = ()) -> Iterator[None]:
        """Fold the records behind the opening, saying and recording nothing; gives way after each.

        edits: those among them, so far as they are known beforehand: then nothing is filtered twice.
        """
        with self._records.withheld(), self._collecting():
            self._demonstration.begin()
            self._demonstration.foresee(edits)
            for record in records:
                match record.message:
                    case Error(limit=int() as target) if target > self.next_seq:
                        self._intake.give_up(target)
                    case AppliedEdit() as edit:
                        self._demonstration.repeat(edit, record.at)
                    case Open() | SampleBatch() | Close() as message:
                        self.receive(message, record.at)
                yield
        self._intake.forgive()
        self._conclude()

    def following(self, records: Iterable[Record], edits: Iterable[AppliedEdit] = ()) -> Iterator[None]:
        """Take what another instance has recorded of this session, as if it came now; gives way after each.

        edits: as in `restoring`. Says nothing. Raises as `receive`.
        """
        before = self.is_open, self.revision
        try:
            with self._collecting():
                self._demonstration.foresee(edits)
                for record in records:
                    if self.is_open or isinstance(record.message, AppliedEdit):
                        self._follow(record)
                    yield
        finally:
            self._intake.forgive()
            if (self.is_open, self.revision) != before:
                self._conclude()

    @contextmanager
    def _collecting(self) -> Iterator[None]:
        """While the context lasts edits are collected; at its end the corrections are filtered, once."""
        self._collects = True
        try:
            yield
        finally:
            self._collects = False
            self._demonstration.settle()

    def hand_to(self, owner: Owner) -> None:
        """Speak as this owner from here on."""
        self._demonstration.hand_to(owner)

    def take_up(self, outcome: Outcome, state: SessionState) -> None:
        """Be the closed session of an outcome: as `restore`, without folding anything."""
        self._demonstration.standing = state
        self._intake.skip_to(outcome.last_seq + 1)
        self._folded = False

    def revive(self, rebuilt: Session) -> None:
        """Be what has been folded again from the records: it can be corrected then."""
        self._demonstration.revive(rebuilt._demonstration)
        self._folded = True

    def receive(self, message: Incoming, now: float) -> list[Output]:
        """Take a message.

        Raises ProtocolError, and changes nothing, where it is refused as a whole; JournalError where it
        cannot be recorded.
        """
        match message:
            case SampleBatch():
                return self._receive_batch(message, now)
            case Heartbeat():
                return self._receive_heartbeat(message, now)
            case ReplayEnded():
                next_state(self.standing.lifecycle, "replayed")
                return self._intake.end_replay(message, now)
            case Open():
                return self._receive_opening(message, now)
            case Close():
                return self._receive_close(message, now)
            case Edit():
                return self._receive_edit(message, now)

    def check_revision(self, edit: Edit) -> None:
        """Raises ProtocolError `conflict` where the editor has not seen what there is."""
        if edit.revision != self.revision:
            why = "another operator has corrected the session meanwhile: look at it again"
            raise ProtocolError("conflict", why, value=edit.revision, limit=self.revision)

    def refuse(self, error: ProtocolError) -> list[Output]:
        """Count a refusal that is charged to this session, and show it."""
        return self._demonstration.refuse(error)

    def tick(self, now: float) -> list[Output]:
        """Time has passed: ask again for what is still missing, and say so."""
        asked = self._intake.ask(now)
        return [*asked, self._demonstration.status()] if asked else []

    def drop(self, messages: int) -> list[Output]:
        """Count what of it the service had no room for, and show it."""
        return self._demonstration.drop(messages)

    @property
    def is_hushed(self) -> bool:
        """Does it wait with what it has to say of refusals? Then `unhush` says it in time."""
        return self._demonstration.is_hushed

    def unhush(self, now: float) -> list[Output]:
        """Say what has waited, where it has waited long enough."""
        return self._demonstration.tick(now)

    # --- messages ---------------------------------------------------------------------------------------

    def _receive_batch(self, batch: SampleBatch, now: float) -> list[Output]:
        self._check_bridge(batch)
        state = self._demonstration.state
        if state == "closed" and batch.seq < self.next_seq:
            self._demonstration.duplicate()  # sent again, it trails behind the close
            return []
        next_state(state, "samples")
        self._check_epoch(batch.epoch)
        return self._intake.take(batch, now)

    def _receive_heartbeat(self, heartbeat: Heartbeat, now: float) -> list[Output]:
        next_state(self.standing.lifecycle, "heartbeat")
        if not self.is_open:
            return []
        self._check_bridge(heartbeat)
        self._check_epoch(heartbeat.epoch)
        return self._intake.hear_of(heartbeat.seq, now)

    def _receive_opening(self, again: Open, now: float) -> list[Output]:
        if again.preset is None:
            again = again.model_copy(update={"preset": self._opening.preset})
        try:
            next_state(self.standing.lifecycle, "open")
        except ProtocolError as refusal:
            if again != self._opening:
                why = f"the session is {self.standing.lifecycle}: give the new one another name"
                raise ProtocolError("conflict", why, value=again.session) from refusal
            return [Reply(refusal)]  # a repeated opening behind the close: no error
        if again.epoch == self._opening.epoch:
            self._check_bridge(again)
        mine = {"epoch": self._opening.epoch, "bridge": self._opening.bridge}
        if again.model_copy(update=mine) != self._opening:
            raise ProtocolError(
                "conflict",
                "the session is open as something else",
                value=str(again),
                expected=str(self._opening),
            )
        if again.epoch > self._opening.epoch:
            return [*self._resume(again, now), self._ack()]
        self._check_epoch(again.epoch)
        return [self._ack()]

    def _receive_close(self, close: Close, now: float) -> list[Output]:
        self._check_bridge(close)
        next_state(self.standing.lifecycle, "close")
        reached = self.next_seq - 1
        if close.last_seq < reached or (not self.is_open and close.last_seq > reached):
            closed = "" if self.is_open else "is closed and "
            why = f"the session {closed}has other batches than that"
            raise ProtocolError("conflict", why, value=close.last_seq, expected=reached)
        if not self.is_open:
            return [self._ack()]
        if close.last_seq > reached:
            return self._not_yet(close, now)
        self._records.append(close, now)
        return self._finish()

    def _receive_edit(self, edit: Edit, now: float) -> list[Output]:
        next_state(self.standing.lifecycle, "edit")
        self.check_revision(edit)
        self._check_kept()
        corrections, pipeline = self._demonstration.corrected(edit.action)
        self._check_kept()  # once more: that may have taken long
        self._records.append(self._applied(edit, corrections), now)
        outputs = self._demonstration.correct(EditOutcome(corrections, edit.author, now), pipeline)
        self._conclude()
        return [*outputs, self._ack()]

    def _check_kept(self) -> None:
        """Of a closed session an edit alone would be no record."""
        if not (self.is_open or self._records.are_kept):
            why = "the journal no longer has the session's samples: it cannot be corrected"
            raise ProtocolError("conflict", why, value=self.name)

    def _applied(self, edit: Edit, corrections: EditHistory) -> AppliedEdit:
        """What is recorded of an edit: what it comes to, so that a replay need not find that out."""
        is_news = not isinstance(edit.action, Undo | Redo)
        return AppliedEdit(
            **vars(edit),
            resolution=corrections.active[-1].recorded() if is_news else None,
            version=self.looked.program_header.version + 1,
        )

    def _follow(self, record: Record) -> None:
        match record.message:
            case SampleBatch() as batch if not self._intake.is_duplicate(batch.seq):
                self.receive(batch, record.at)
            case Error(limit=int() as target) if target > self.next_seq:
                self._records.append(record.message, record.at)
                self._intake.give_up(target)
            case Open() as again if again.epoch >= self._opening.epoch and again != self._opening:
                self.receive(again, record.at)
            case Close() as close:
                self.receive(close, record.at)
            case AppliedEdit() as edit if edit.revision == self.revision:
                self._records.append(edit, record.at)
                self._demonstration.repeat(edit, record.at)

    # --- steps ------------------------------------------------------------------------------------------

    def _check_bridge(self, message: SampleBatch | Heartbeat | Open | Close) -> None:
        """A session belongs to one bridge; one that does not name itself is taken for that."""
        mine = self._opening.bridge
        if message.bridge == mine or mine is None or message.bridge is None:
            return
        if isinstance(message, SampleBatch | Heartbeat) and message.epoch != self._opening.epoch:
            return  # a predecessor's, or a successor's: its epoch says so
        raise ProtocolError(
            "conflict",
            f"bridge {mine} publishes this session, {self.next_seq} batches so far: "
            "a second one needs a session of its own, or a higher epoch to take this one over",
            value=message.bridge,
            expected=mine,
        )

    def _check_epoch(self, epoch: int) -> None:
        current = self._opening.epoch
        if epoch < current:
            raise ProtocolError("conflict", "a newer epoch of the bridge is here", value=epoch, limit=current)
        if epoch > current:
            why = "a restarted bridge opens the session before it sends"
            raise ProtocolError("conflict", why, value=epoch, limit=current)

    def _resume(self, again: Open, now: float) -> list[Output]:
        """Declare holes lost: a restarted bridge cannot send what its predecessor kept."""
        outputs = self._intake.give_up_holes(now)  # recorded first: the opening says nothing of them
        self._records.append(again, now)
        self._opening = again
        return [*outputs, *self._demonstration.gap(0), self._demonstration.status()]

    def _not_yet(self, close: Close, now: float) -> list[Output]:
        """Ask for what is missing before the close; the bridge closes again. No refusal is counted."""
        asked = self._intake.hear_of(close.last_seq, now)
        missing = "batches are missing before the close"
        refusal = ProtocolError("conflict", missing, value=self.next_seq, limit=close.last_seq)
        return [*asked, Reply(refusal)]

    def _finish(self) -> list[Output]:
        outputs = self._demonstration.finish()
        self._conclude()
        if self.standing.lifecycle == "closed":
            return [*outputs, self._ack()]
        refusal = self.standing.counters.last_refusal
        why = refusal.message if refusal else "closed by an error in processing"
        return [*outputs, Reply(ProtocolError("conflict", why))]

    def _conclude(self) -> None:
        """Let the journal keep how it ended; without that it is replayed."""
        if self.standing.lifecycle == "closed" and not self._collects:
            self._records.conclude(Outcome(self._opening, self.next_seq - 1, snapshot_of(self.standing)))

    def _ack(self) -> Reply:
        """What is acknowledged is safe. Raises JournalError."""
        self._records.commit()
        state = self.standing.lifecycle
        return Reply(
            Ack(
                session=self._opening.session,
                next_seq=self.next_seq,
                state="open" if state == "open" else "closed",
                revision=self.revision,
            )
        )

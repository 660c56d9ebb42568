"""A session is a fold over its journal: open, samples, holes that were given up, close.

Rules
- What changes the session is recorded before it is processed; replaying the records gives the same
  session bit for bit. What cannot be recorded is not processed: the sender is told, and nothing is lost.
- Nothing that was told is taken back by a crash. A batch may be told of before its record is safe, for the
  bridge still has it; everything else is safe before it is processed, and everything before an
  acknowledgement.
- A batch is processed in sequence, exactly once. Ahead of its turn it is held, and what is missing is
  asked for; what the bridge no longer has becomes a gap, and the session goes on behind it.
- A batch of the right session whose content is refused is lost like one that never came: counted, and a
  gap in its place. Sending it again would not make it better.
- A restarted bridge opens the session again with a higher epoch and continues numbering at the
  `next_seq` of the acknowledgement: what its predecessor had not delivered is gone. Until it has opened,
  its batches are refused; those of an older epoch always are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Ack, Close, Edit, Error, Heartbeat, Open, SampleBatch
from caesura_service.journal import Journal, JournalError, Outcome, Record, Recordable
from caesura_service.session.content import samples_of
from caesura_service.session.demonstration import Demonstration
from caesura_service.session.limits import Limits
from caesura_service.session.ordering import Asking, Ordering
from caesura_service.session.ports import Answer, AskReplay, Incoming, Output, Owner, Refused, ReplayEnded
from caesura_service.session.results import Edited
from caesura_service.session.standing import Standing, snapshot_of
from caesura_service.session.state import after
from caesura_service.session.view import Pipeline

_LOST = None  # stands in the order for a batch whose content was refused


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
        self._station = station
        self._opening = opening
        self._demonstration = Demonstration(station, opening, pipeline, owner=owner, limits=limits)
        self._journal: Journal | None = journal
        self._limits = limits
        self._ordering: Ordering[NDArray[np.float64] | None] = Ordering(
            limits.held_batches, limits.held_bytes
        )
        self._asking = Asking(limits)
        self._folded = True  # is there more of it than its outcome?
        self._unrecorded = False  # did a batch come since the last answer that could not be recorded?

    @property
    def name(self) -> str:
        """Of the session, unique at its station."""
        return self._opening.session

    @property
    def standing(self) -> Standing:
        """Where it stands; immutable."""
        return self._demonstration.standing

    @property
    def looked(self) -> Standing:
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
        return self._ordering.next_seq

    def begin(self, now: float) -> list[Output]:
        """Record the opening and say the first words."""
        self._record(self._opening, now)
        return [*self._demonstration.begin(), self._ack()]

    def restoring(self, records: Iterable[Record]) -> Iterator[None]:
        """Fold the records behind the opening, saying and recording nothing; gives way after each."""
        journal, self._journal = self._journal, None
        self._demonstration.begin()
        for record in records:
            match record.message:
                case Error(limit=int() as target):
                    self._give_up(target)
                case Edit() as edit:
                    self._edit_again(edit, record.at)
                case Open() | SampleBatch() | Close() as message:
                    self.receive(message, record.at)
            yield
        self._asking.forgive()
        self._journal = journal
        self._conclude()

    def following(self, records: Iterable[Record]) -> Iterator[None]:
        """Take what another instance has recorded of this session, as if it came now; gives way after each.

        Says nothing. Raises as `receive`.
        """
        try:
            for record in records:
                if self.is_open or isinstance(record.message, Edit):
                    self._follow(record)
                yield
        finally:
            self._asking.forgive()

    def hand_to(self, owner: Owner) -> None:
        """Speak as this owner from here on."""
        self._demonstration.hand_to(owner)

    def take_up(self, outcome: Outcome, standing: Standing) -> None:
        """Be the closed session of an outcome: as `restore`, without folding anything."""
        self._demonstration.standing = standing
        self._ordering.skip_to(outcome.last_seq + 1)
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
                return self._receive_answer(message, now)
            case Open():
                return self._receive_opening(message, now)
            case Close():
                return self._receive_close(message, now)
            case Edit():
                return self._receive_edit(message, now)

    def check_revision(self, edit: Edit) -> None:
        """Raises ProtocolError `conflict` where the editor has not seen what there is."""
        if edit.revision != self.revision:
            why = "somebody else has corrected the session meanwhile: look at it again"
            raise ProtocolError("conflict", why, value=edit.revision, limit=self.revision)

    def refuse(self, error: ProtocolError) -> list[Output]:
        """Count a refusal that is charged to this session, and show it."""
        return self._demonstration.refuse(error)

    def tick(self, now: float) -> list[Output]:
        """Time has passed: ask again for what is still missing, and say so."""
        asked = self._ask(now)
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
        state = self._demonstration.state
        if state == "closed" and batch.seq < self.next_seq:
            self._demonstration.duplicate()  # sent again, it trails behind the close
            return []
        after(state, "samples")
        self._check_epoch(batch.epoch)
        if self._ordering.is_in_turn(batch.seq):
            return self._take_in_turn(batch, now)
        self._check_seq(batch.seq)
        if self._ordering.is_duplicate(batch.seq):
            self._demonstration.duplicate()
            return []
        if not self._ordering.has_room(batch.seq, _size(batch)):
            self._expect(batch.seq)
            return self._ask(now)
        self._record(batch, now)
        return [*self._hold(batch), *self._drain(), *self._ask(now)]

    def _receive_heartbeat(self, heartbeat: Heartbeat, now: float) -> list[Output]:
        after(self.standing.state, "heartbeat")
        if not self.is_open:
            return []
        self._check_epoch(heartbeat.epoch)
        self._check_seq(heartbeat.seq)
        self._expect(heartbeat.seq)
        return self._ask(now)

    def _receive_answer(self, ended: ReplayEnded, now: float) -> list[Output]:
        after(self.standing.state, "replayed")
        progress = self.next_seq > ended.first
        answered = ended.answered and not self._unrecorded
        self._unrecorded = False
        lost = self._asking.ended(progress=progress, answered=answered, now=now)
        if not self.is_open or progress or not (lost or ended.evicted):
            return self._ask(now)
        target = self._ordering.nearest(self.next_seq + 1 if lost else ended.oldest)
        if not self.next_seq < target <= self.next_seq + self._limits.batches_ahead:
            return []
        gone = f"batches {self.next_seq} to {target - 1} are lost"
        self._record(Error(code="evicted", message=gone, value=self.next_seq, limit=target), now)
        return [*self._give_up(target), *self._ask(now)]

    def _receive_opening(self, again: Open, now: float) -> list[Output]:
        if again.preset is None:
            again = again.model_copy(update={"preset": self._opening.preset})
        try:
            after(self.standing.state, "open")
        except ProtocolError as refusal:
            if again != self._opening:
                raise
            return [Answer(refusal)]  # told again, it trails behind the close: nobody did wrong
        if again.model_copy(update={"epoch": self._opening.epoch}) != self._opening:
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
        after(self.standing.state, "close")
        reached = self.next_seq - 1
        if close.last_seq < reached or (not self.is_open and close.last_seq > reached):
            raise ProtocolError(
                "conflict", "the session has other batches than that", value=close.last_seq, expected=reached
            )
        if not self.is_open:
            return [self._ack()]
        if close.last_seq > reached:
            return self._not_yet(close, now)
        self._record(close, now)
        return self._finish()

    def _receive_edit(self, edit: Edit, now: float) -> list[Output]:
        after(self.standing.state, "edit")
        self.check_revision(edit)
        self._check_kept()
        corrections, pipeline = self._demonstration.corrected(edit.action)
        self._record(edit, now)
        said = self._demonstration.correct(Edited(corrections, edit.author, now), pipeline)
        self._conclude()
        return [*said, self._ack()]

    def _check_kept(self) -> None:
        """Of a closed session an edit alone would be no record."""
        if self._journal is None or self.is_open:
            return
        if (self._station, self.name) not in self._journal.closed():
            why = "the journal no longer has the session's samples: it cannot be corrected"
            raise ProtocolError("conflict", why, value=self.name)

    def _edit_again(self, edit: Edit, at: float) -> None:
        """As it was made once. Where it makes no sense any more the samples are still worth having."""
        try:
            corrections, pipeline = self._demonstration.corrected(edit.action)
        except ProtocolError as error:
            self._demonstration.pass_over_edit()
            self.refuse(error)
        else:
            self._demonstration.correct(Edited(corrections, edit.author, at), pipeline)

    def _follow(self, record: Record) -> None:
        match record.message:
            case SampleBatch() as batch if not self._ordering.is_duplicate(batch.seq):
                self.receive(batch, record.at)
            case Error(limit=int() as target) if target > self.next_seq:
                self._record(record.message, record.at)
                self._give_up(target)
            case Open() as again if again.epoch >= self._opening.epoch and again != self._opening:
                self.receive(again, record.at)
            case Close() as close:
                self.receive(close, record.at)
            case Edit() as edit if edit.revision == self.revision:
                self._record(edit, record.at)
                self._edit_again(edit, record.at)
                self._conclude()

    # --- steps ------------------------------------------------------------------------------------------

    def _check_epoch(self, epoch: int) -> None:
        current = self._opening.epoch
        if epoch < current:
            raise ProtocolError("conflict", "a newer epoch of the bridge is here", value=epoch, limit=current)
        if epoch > current:
            why = "a restarted bridge opens the session before it sends"
            raise ProtocolError("conflict", why, value=epoch, limit=current)

    def _check_seq(self, seq: int) -> None:
        limit = self.next_seq + self._limits.batches_ahead
        if seq > limit:
            raise ProtocolError("malformed", "sequence number leaps ahead", value=seq, limit=limit)

    def _content(self, batch: SampleBatch) -> tuple[NDArray[np.float64] | None, list[Output]]:
        """Its samples; where they are refused only its place."""
        try:
            return samples_of(batch, self._opening.columns, self._limits), []
        except ProtocolError as error:
            return _LOST, [Refused(error), *self.refuse(error)]

    def _process(self, samples: NDArray[np.float64] | None) -> list[Output]:
        """They have their turn."""
        return self._demonstration.gap(1) if samples is _LOST else self._demonstration.push(samples)

    def _take_in_turn(self, batch: SampleBatch, now: float) -> list[Output]:
        """As nearly always: it need not be held, and there is nothing to ask for."""
        self._record(batch, now)
        samples, said = self._content(batch)
        self._ordering.pass_by()
        return said + self._process(samples)

    def _hold(self, batch: SampleBatch) -> list[Output]:
        """Keep the samples until their turn."""
        samples, said = self._content(batch)
        self._ordering.hold(batch.seq, samples, 0 if samples is _LOST else _size(batch))
        return said

    def _drain(self) -> list[Output]:
        """Process what has its turn."""
        said: list[Output] = []
        self._note_hole()
        while self._ordering.ready() and self.is_open:
            samples = self._ordering.take()
            self._note_hole()
            said += self._process(samples)
        return said

    def _give_up(self, target: int) -> list[Output]:
        """Go on at the batch `target`: everything before it is lost."""
        given_up = target - self.next_seq
        self._ordering.skip_to(target)
        self._asking.forgive()
        self._note_hole()
        return [*self._demonstration.gap(given_up), *self._drain()]

    def _resume(self, again: Open, now: float) -> list[Output]:
        """A restarted bridge cannot send what its predecessor kept: give up holes, and what nobody knows."""
        self._record(again, now)
        self._opening = again
        said: list[Output] = []
        while self._ordering.hole() is not None:
            said += self._give_up(self._ordering.nearest(None))
        return [*said, *self._demonstration.gap(0), self._demonstration.status()]

    def _not_yet(self, close: Close, now: float) -> list[Output]:
        """Ask for what is missing before the close; the bridge closes again. No refusal is counted."""
        self._check_seq(close.last_seq)
        self._expect(close.last_seq)
        missing = "batches are missing before the close"
        refusal = ProtocolError("conflict", missing, value=self.next_seq, limit=close.last_seq)
        return [*self._ask(now), Answer(refusal)]

    def _finish(self) -> list[Output]:
        said = self._demonstration.finish()
        self._conclude()
        if self.standing.state == "closed":
            return [*said, self._ack()]
        refusal = self.standing.tally.last_refusal
        why = refusal.message if refusal else "closed by an error in processing"
        return [*said, Answer(ProtocolError("conflict", why))]

    def _conclude(self) -> None:
        """Let the journal keep how it ended; without that it is replayed."""
        if self._journal is None or self.standing.state != "closed":
            return
        outcome = Outcome(self._opening, self.next_seq - 1, snapshot_of(self.standing))
        with suppress(JournalError):
            self._journal.conclude(self._station, outcome)

    def _expect(self, seq: int) -> None:
        self._ordering.expect(seq)
        self._note_hole()

    def _note_hole(self) -> None:
        hole = self._ordering.hole()
        self._demonstration.wait_for(hole[0] if hole else None)

    def _ask(self, now: float) -> list[Output]:
        hole = self._ordering.hole() if self.is_open else None
        wanted = self._asking.question(hole, now)
        return [AskReplay(self._station, self._opening.session, *wanted)] if wanted else []

    def _ack(self) -> Answer:
        """What is acknowledged is safe. Raises JournalError."""
        if self._journal is not None:
            self._journal.commit()
        state = self.standing.state
        return Answer(
            Ack(
                session=self._opening.session,
                next_seq=self.next_seq,
                state="open" if state == "open" else "closed",
                revision=self.revision,
            )
        )

    def _record(self, message: Recordable, now: float) -> None:
        """Raises JournalError; nothing has changed then."""
        if self._journal is None:
            return
        is_batch = isinstance(message, SampleBatch)
        record = Record(self._station, self._opening.session, now, message)
        try:
            self._journal.append(record, now=not is_batch)
        except JournalError:
            self._unrecorded |= is_batch
            raise


def _size(batch: SampleBatch) -> int:
    """Of its samples in memory [bytes]."""
    return 8 * batch.n * len(batch.columns)

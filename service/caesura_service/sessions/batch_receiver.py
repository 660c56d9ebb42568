"""The batches of a session: each is processed in its turn and once, and recorded before that.

Ahead of its turn a batch is held, and what is missing is asked for; what the bridge no longer has becomes a
gap, and the session goes on behind it. A batch whose content is refused is lost like one that never came:
counted, and a gap in its place. Sending it again would not make it better.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Error, Open, SampleBatch
from caesura_service.publishing.events import BatchRejected, Output, ReplayEnded, RequestReplay
from caesura_service.sessions.batch_validation import samples_of
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.pipeline_host import PipelineHost
from caesura_service.sessions.reorder_buffer import ReorderBuffer, ReplayBackoff
from caesura_service.sessions.session_journal import SessionJournal

Samples = NDArray[np.float64]

_LOST = None  # stands in the order for a batch whose content was refused


class BatchReceiver:
    """Between a bridge and the demonstration."""

    def __init__(
        self,
        station: str,
        opening: Open,
        demonstration: PipelineHost,
        records: SessionJournal,
        limits: Limits,
    ) -> None:
        self._station, self._session, self._columns = station, opening.session, opening.columns
        self._demonstration = demonstration
        self._records = records
        self._limits = limits
        self._ordering: ReorderBuffer[Samples | None] = ReorderBuffer(limits.held_batches, limits.held_bytes)
        self._asking = ReplayBackoff(limits)

    @property
    def next_seq(self) -> int:
        """The batch that is waited for."""
        return self._ordering.next_seq

    def is_duplicate(self, seq: int) -> bool:
        """Has the batch come before?"""
        return self._ordering.is_duplicate(seq)

    def take(self, batch: SampleBatch, now: float) -> list[Output]:
        """A batch has come. Raises ProtocolError where it leaps ahead; JournalError."""
        if self._ordering.is_in_turn(batch.seq):
            return self._take_in_turn(batch, now)
        self._check_seq(batch.seq)
        if self._ordering.is_duplicate(batch.seq):
            self._demonstration.duplicate()
            return []
        if not self._ordering.has_room(batch.seq, _size(batch)):
            self._expect(batch.seq)
            return self.ask(now)
        self._records.append(batch, now)
        return [*self._hold(batch), *self._drain(), *self.ask(now)]

    def hear_of(self, seq: int, now: float) -> list[Output]:
        """There are batches up to this one. Raises ProtocolError where it leaps ahead."""
        self._check_seq(seq)
        self._expect(seq)
        return self.ask(now)

    def end_replay(self, ended: ReplayEnded, now: float) -> list[Output]:
        """What was asked for has come, or never will. Raises JournalError."""
        progress = self.next_seq > ended.first
        missed = self._records.has_missed_batches()
        lost = self._asking.ended(progress=progress, answered=ended.answered and not missed, now=now)
        if not self._is_open or progress or not (lost or ended.evicted):
            return self.ask(now)
        target = self._ordering.nearest(self.next_seq + 1 if lost else ended.oldest)
        if not self.next_seq < target <= self.next_seq + self._limits.batches_ahead:
            return []
        return [*self._lose(target, now), *self.ask(now)]

    def ask(self, now: float) -> list[Output]:
        """Request the missing batches, if there are any and no request is under way."""
        hole = self._ordering.hole() if self._is_open else None
        wanted = self._asking.question(hole, now)
        return [RequestReplay(self._station, self._session, *wanted)] if wanted else []

    def give_up(self, target: int) -> list[Output]:
        """Go on at the batch `target`: everything before it is lost."""
        given_up = target - self.next_seq
        self._ordering.skip_to(target)
        self._asking.forgive()
        self._note_hole()
        return [*self._demonstration.gap(given_up), *self._drain()]

    def give_up_holes(self, now: float) -> list[Output]:
        """Go on with what is here. Raises JournalError."""
        outputs: list[Output] = []
        while self._ordering.hole() is not None:
            outputs += self._lose(self._ordering.nearest(None), now)
        return outputs

    def _lose(self, target: int, now: float) -> list[Output]:
        """Give up everything before a batch, and record that. Raises JournalError."""
        gone = f"batches {self.next_seq} to {target - 1} are lost"
        self._records.append(Error(code="evicted", message=gone, value=self.next_seq, limit=target), now)
        return self.give_up(target)

    def skip_to(self, seq: int) -> None:
        """Begin there: everything before it was taken elsewhere."""
        self._ordering.skip_to(seq)

    def forgive(self) -> None:
        """What is missing may be asked for at once."""
        self._asking.forgive()

    @property
    def _is_open(self) -> bool:
        return self._demonstration.looked.is_open

    def _check_seq(self, seq: int) -> None:
        limit = self.next_seq + self._limits.batches_ahead
        if seq > limit:
            raise ProtocolError("malformed", "sequence number leaps ahead", value=seq, limit=limit)

    def _take_in_turn(self, batch: SampleBatch, now: float) -> list[Output]:
        """As nearly always: it need not be held, and there is nothing to ask for."""
        self._records.append(batch, now)
        samples, outputs = self._content(batch)
        self._ordering.pass_by()
        return outputs + self._process(samples)

    def _content(self, batch: SampleBatch) -> tuple[Samples | None, list[Output]]:
        """Its samples; where they are refused only its place."""
        try:
            return samples_of(batch, self._columns, self._limits), []
        except ProtocolError as error:
            return _LOST, [BatchRejected(error), *self._demonstration.refuse(error)]

    def _process(self, samples: Samples | None) -> list[Output]:
        """They have their turn."""
        return self._demonstration.gap(1) if samples is _LOST else self._demonstration.push(samples)

    def _hold(self, batch: SampleBatch) -> list[Output]:
        """Keep the samples until their turn."""
        samples, outputs = self._content(batch)
        self._ordering.hold(batch.seq, samples, 0 if samples is _LOST else _size(batch))
        return outputs

    def _drain(self) -> list[Output]:
        """Process what has its turn."""
        outputs: list[Output] = []
        self._note_hole()
        while self._ordering.ready() and self._is_open:
            samples = self._ordering.take()
            self._note_hole()
            outputs += self._process(samples)
        return outputs

    def _expect(self, seq: int) -> None:
        self._ordering.expect(seq)
        self._note_hole()

    def _note_hole(self) -> None:
        hole = self._ordering.hole()
        self._demonstration.wait_for(hole[0] if hole else None)


def _size(batch: SampleBatch) -> int:
    """Of its samples in memory [bytes]."""
    return 8 * batch.n * len(batch.columns)

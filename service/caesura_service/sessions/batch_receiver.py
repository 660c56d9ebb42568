"""Receives the batches of a session: each is recorded, then processed once and in sequence.

A batch that arrives early is held, and the missing ones are requested. Batches that the bridge no longer has
become a gap, after which the session continues. A batch with invalid content is counted and becomes a gap
too, because sending it again would not change it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Error, Open, SampleBatch
from caesura_service.publishing.events import Output, ReplayEnded, RequestReplay
from caesura_service.segmentation.pipeline_interface import MOST_TOGETHER
from caesura_service.sessions.batch_validation import is_usual, validated_samples
from caesura_service.sessions.limits import Limits
from caesura_service.sessions.pipeline_runner import PipelineHost
from caesura_service.sessions.reorder_buffer import ReorderBuffer, ReplayBackoff
from caesura_service.sessions.same_layout_batches import BatchBlock
from caesura_service.sessions.session_journal import SessionJournal

Samples = NDArray[np.float64]

_REJECTED = None  # takes the place of a batch whose content was rejected


class BatchReceiver:
    """Orders the batches of a bridge for the pipeline host."""

    def __init__(
        self,
        station: str,
        opening: Open,
        demonstration: PipelineHost,
        records: SessionJournal,
        limits: Limits,
    ) -> None:
        self._station, self._session, self._columns = station, opening.session, opening.columns
        self._host = demonstration
        self._journal = records
        self._limits = limits
        self._buffer: ReorderBuffer[Samples | None] = ReorderBuffer(limits.held_batches, limits.held_bytes)
        self._backoff = ReplayBackoff(limits)

    @property
    def next_seq(self) -> int:
        """The number of the next expected batch."""
        return self._buffer.next_seq

    def is_duplicate(self, seq: int) -> bool:
        """Whether the batch was received before."""
        return self._buffer.is_duplicate(seq)

    def receive_batch(self, batch: SampleBatch, now: float) -> list[Output]:
        """Process or hold a batch. Raises ProtocolError if its number is too far ahead; JournalError."""
        if self._buffer.is_in_turn(batch.seq):
            return self._receive_in_turn(batch, now)
        self._check_seq(batch.seq)
        if self._buffer.is_duplicate(batch.seq):
            self._host.count_duplicate()
            return []
        if not self._buffer.has_room(batch.seq, _size(batch)):
            self._announce(batch.seq)
            return self.request_missing(now)
        self._journal.append(batch, now)
        return [*self._hold(batch), *self._process_ready(), *self.request_missing(now)]

    def receive_together(self, block: BatchBlock, now: float) -> tuple[int, list[Output]]:
        """Process the first batches of a block together, up to one that completes an observation.

        Batches of an early block are held, or only announced if there is no room for the first. Return the
        number of batches received in this way, and the outputs of `receive_batch` for each in turn. 0: the
        first one must be received separately. A due program may be postponed to the host's
        `make_due_program`. Raises JournalError if the first one cannot be recorded.
        """
        if block.layout.message.columns != self._columns or self._buffer.is_duplicate(block.first):
            return 0, []
        samples = block.samples()
        if not is_usual(samples, self._limits):
            return 0, []
        if block.first == self.next_seq:
            return self._receive_next(block, samples, now)
        return self._receive_early(block, samples, now)

    def announce_seq(self, seq: int, now: float) -> list[Output]:
        """Request the missing batches up to this one. Raises ProtocolError if it is too far ahead."""
        self._check_seq(seq)
        self._announce(seq)
        return self.request_missing(now)

    def end_replay(self, ended: ReplayEnded, now: float) -> list[Output]:
        """Process the end of a replay: request the rest, or declare it lost. Raises JournalError."""
        progress = self.next_seq > ended.first
        missed = self._journal.has_missed_batches()
        lost = self._backoff.record_result(progress=progress, answered=ended.answered and not missed, now=now)
        if not self._is_open or progress or not (lost or ended.evicted):
            return self.request_missing(now)
        target = self._buffer.next_available(self.next_seq + 1 if lost else ended.oldest)
        if not self.next_seq < target <= self.next_seq + self._limits.batches_ahead:
            return []
        return [*self._record_lost(target, now), *self.request_missing(now)]

    def request_missing(self, now: float) -> list[Output]:
        """Request the missing batches, if there are any and no request is in progress."""
        missing = self._buffer.missing_range() if self._is_open else None
        wanted = self._backoff.next_request(missing, now)
        return [RequestReplay(self._station, self._session, *wanted)] if wanted else []

    def declare_lost(self, target: int) -> list[Output]:
        """Declare every batch before `target` lost and continue there."""
        given_up = target - self.next_seq
        self._buffer.skip_to(target)
        self._backoff.reset()
        self._update_missing_batch()
        return [*self._host.declare_gap(given_up), *self._process_ready()]

    def declare_all_missing_lost(self, now: float) -> list[Output]:
        """Declare all missing batches lost and process the held ones. Raises JournalError."""
        outputs: list[Output] = []
        while self._buffer.missing_range() is not None:
            outputs += self._record_lost(self._buffer.next_available(None), now)
        return outputs

    def _record_lost(self, target: int, now: float) -> list[Output]:
        """Record that every batch before `target` is lost, and declare it. Raises JournalError."""
        reason = f"batches {self.next_seq} to {target - 1} are lost"
        self._journal.append(Error(code="evicted", message=reason, value=self.next_seq, limit=target), now)
        return self.declare_lost(target)

    def skip_to(self, seq: int) -> None:
        """Start at this batch: the stored outcome contains those before it."""
        self._buffer.skip_to(seq)

    def reset_backoff(self) -> None:
        """Allow the next request for missing batches at once."""
        self._backoff.reset()

    @property
    def _is_open(self) -> bool:
        return self._host.last_published_state.is_open

    def _check_seq(self, seq: int) -> None:
        limit = self.next_seq + self._limits.batches_ahead
        if seq > limit:
            raise ProtocolError("malformed", "sequence number is too far ahead", value=seq, limit=limit)

    def _receive_in_turn(self, batch: SampleBatch, now: float) -> list[Output]:
        """Process the expected batch, the common case: nothing is held and nothing missing."""
        self._journal.append(batch, now)
        samples, outputs = self._validated(batch)
        self._buffer.advance()
        return outputs + self._process(samples)

    def _receive_next(self, block: BatchBlock, samples: Samples, now: float) -> tuple[int, list[Output]]:
        """Process the first batches of a block that begins with the expected one; as `receive_together`."""
        n, due_s = block.layout.message.n, self._host.due_s
        if not math.isfinite(due_s):
            return 0, []
        is_due = samples[:, 0] >= due_s
        until = int(is_due.argmax()) if is_due.any() else len(samples) - 1
        free = self._buffer.free_run(block.first)
        count = min(until // n + 1, MOST_TOGETHER // n, *(() if free is None else (free,)))
        if not count:
            return 0, []
        count = self._journal.append_batches(block, count, now)
        is_in_turn = self._buffer.is_in_turn(block.first)
        self._buffer.advance(count)
        if is_in_turn:
            return count, self._host.push_together(samples[: count * n], count, without_program=True)
        self._update_missing_batch()
        outputs = self._host.push_together(samples[: count * n], count)
        return count, [*outputs, *self._process_ready(), *self.request_missing(now)]

    def _receive_early(self, block: BatchBlock, samples: Samples, now: float) -> tuple[int, list[Output]]:
        """Hold the first batches of a block after a missing one, as many as fit."""
        message, free = block.layout.message, self._buffer.free_run(block.first)
        most = len(block.payloads) if free is None else min(free, len(block.payloads))
        if block.first + most - 1 > self.next_seq + self._limits.batches_ahead:
            return 0, []
        count = min(most, self._buffer.room_for(_size(message)))
        if not count:
            self._announce(block.first + most - 1)
            return most, self.request_missing(now)
        count = self._journal.append_batches(block, count, now)
        for place, own in enumerate(np.split(samples[: count * message.n], count)):
            self._buffer.hold(block.first + place, own, _size(message))
        self._update_missing_batch()
        return count, self.request_missing(now)

    def _validated(self, batch: SampleBatch) -> tuple[Samples | None, list[Output]]:
        """Return the samples of a batch, or _REJECTED and the outputs of the refusal."""
        try:
            return validated_samples(batch, self._columns, self._limits), []
        except ProtocolError as error:
            return _REJECTED, self._host.reject_batch(error)

    def _process(self, samples: Samples | None) -> list[Output]:
        """Push samples into the pipeline, or declare the gap of a rejected batch."""
        return self._host.declare_gap(1) if samples is _REJECTED else self._host.push(samples)

    def _hold(self, batch: SampleBatch) -> list[Output]:
        """Hold the samples until the batches before them are received."""
        samples, outputs = self._validated(batch)
        self._buffer.hold(batch.seq, samples, 0 if samples is _REJECTED else _size(batch))
        return outputs

    def _process_ready(self) -> list[Output]:
        """Process the held batches that are next in sequence."""
        outputs: list[Output] = []
        self._update_missing_batch()
        while self._buffer.has_next() and self._is_open:
            ready = self._pop_together()
            self._update_missing_batch()
            outputs += (
                self._host.push_together(np.concatenate(ready), len(ready))
                if ready
                else self._host.declare_gap(1)
            )
        return outputs

    def _pop_together(self) -> list[Samples]:
        """Remove held batches, up to one that completes an observation; none for a rejected one."""
        samples, due_s = self._buffer.pop_next(), self._host.due_s
        if samples is _REJECTED:
            return []
        ready = [samples]
        while (len(ready) + 1) * len(samples) <= MOST_TOGETHER and ready[-1][:, 0].max() < due_s:
            following = self._buffer.peek_next()
            if following is None or len(following) != len(samples):
                break
            ready.append(following)
            self._buffer.pop_next()
        return ready

    def _announce(self, seq: int) -> None:
        self._buffer.announce(seq)
        self._update_missing_batch()

    def _update_missing_batch(self) -> None:
        missing = self._buffer.missing_range()
        self._host.set_missing_batch(missing[0] if missing else None)


def _size(batch: SampleBatch) -> int:
    """Return the size of a batch's samples in memory [bytes]."""
    return 8 * batch.n * len(batch.columns)

"""The messages of a live station, in the topics and schemas of an MCAP file: a fold without network or clock.

Samples are published as they are received; those that the network dropped are published before the next
batch, from the service's journal. A result is published when it is new or has changed, with the time of the
newest sample; a later message about the same segment replaces the earlier one. `/path` is the whole path of
the session, at most PATH_POINTS points, once a second. `/tf` and `/path` wait until the session's unit is
known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from caesura_clients.session_state_reader import Update
from caesura_clients.viewer.missing_samples import MissingSpan
from caesura_protocol.codec import signals_of, unpack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.mcap_schemas import TaskProgram
from caesura_protocol.formats.mcap_write import (
    NO_POSES,
    PATH_S,
    McapContent,
    McapMessage,
    Poses,
    nanoseconds,
    path_of,
    poses_of,
    result_of,
    sample_entries,
)
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.gap_free_sample_runs import in_metres
from caesura_protocol.messages import Message, SampleBatch
from caesura_protocol.recording import Recording, RecordingError

PATH_POINTS = 1000  # of a message on /path: about 150 kB
PATH_EVERY_S = 1.0
STEP_S = 1e-3  # [s] between two samples, before a batch has two
LONG_AGO = -np.inf  # [s] before any sample
FIRST_BATCHES = 50  # a second of a robot at 1 kHz: a viewer that comes so late gets the beginning as well
FARTHEST_S = 1e9  # a session time beyond it is none


class LiveMessage(NamedTuple):
    """A message, its topic, and its time of day [ns]."""

    log_time: int
    topic: str
    fields: Mapping[str, object]


class LiveStation:
    """Messages of a station's current session: the one whose samples arrive, or that was opened last."""

    def __init__(self) -> None:
        self.live: LiveSession | None = None
        self._updates: dict[str, Update] = {}  # the newest one of each session

    def show(self, session: str) -> None:
        """Show a session before any message of it was received."""
        self.live = self.live or LiveSession(session)

    def sampled(self, batch: SampleBatch, now_s: float) -> list[LiveMessage]:
        """Return the messages of a batch; none for a repeated or invalid one. now_s: time of day."""
        try:
            matrix = unpack_samples(batch)
        except ProtocolError:
            return []
        if not (np.abs(matrix[:, 0]) < FARTHEST_S).all():
            return []
        live, started = self._shown(batch.session, now_s)
        return [*started, *live.sampled(batch, matrix, self._updates.get(batch.session), now_s)]

    def hole_before(self, batch: SampleBatch) -> MissingSpan | None:
        """Return the span that was not received before a batch; None without a gap, or if it is no batch."""
        live = self.live
        if live is None or live.name != batch.session:
            live = LiveSession(batch.session)
        with suppress(ProtocolError):
            return live.hole_before(batch.seq, batch.columns, float(unpack_samples(batch)[0, 0]))
        return None

    def unreceived_end(self) -> MissingSpan | None:
        """Return the span that may be missing at the end of a closed session; once for each end."""
        update = None if self.live is None else self._updates.get(self.live.name)
        return None if self.live is None or update is None else self.live.unreceived_end(update)

    def recovered(self, span: MissingSpan, rows: Array, now_s: float) -> list[LiveMessage]:
        """Return the messages of samples (n, columns) recovered from a gap, positions in metres.

        Empty for the end of a session after which another one has begun: the viewer shows the new one. now_s:
        time of day at which the batch after the gap was received.
        """
        if span.before_s is None and (self.live is None or self.live.name != span.session):
            return []
        live, started = self._shown(span.session, now_s)
        return [*started, *live.recovered(span, rows, self._updates.get(span.session), now_s)]

    def updated(self, update: Update, now_s: float) -> list[LiveMessage]:
        """Return the messages of new or changed results. now_s: time of day."""
        self._updates[update.session] = update
        if self.live is None or self._is_next(update):
            self.live = LiveSession(update.session)
        return self.live.updated(update, now_s) if update.session == self.live.name else []

    def removed(self, session: str) -> None:
        """Drop a session that the service no longer holds: its name may be used again."""
        self._updates.pop(session, None)
        if self.live is not None and self.live.name == session:
            self.live = None

    def _shown(self, session: str, now_s: float) -> tuple[LiveSession, list[LiveMessage]]:
        """Make a session the shown one; return it, and its results so far if it was not shown before."""
        if self.live is not None and self.live.name == session:
            return self.live, []
        self.live, update = LiveSession(session), self._updates.get(session)
        return self.live, [] if update is None else self.live.updated(update, now_s)

    def _is_next(self, update: Update) -> bool:
        """Return whether this session is open and the shown one is closed."""
        shown = None if self.live is None else self._updates.get(self.live.name)
        return shown is not None and shown.closed and not update.closed


@dataclass
class LiveSession:
    """Messages of one session."""

    name: str
    missing: int = 0  # batches that were not received
    _last_seq: int = -1
    _began_s: float | None = None  # [s] time of day at its time 0: by its results, better by its first batch
    _newest_s: float = LONG_AGO  # [s] session clock, of samples and results
    _newest_sample_s: float = LONG_AGO
    _step_s: float = STEP_S  # the least between two samples of the newest batch
    _columns: tuple[str, ...] = ()  # of the samples, time first
    _is_end_read: bool = False
    _published: dict[str, tuple[Message, ...]] = field(default_factory=dict)  # by topic
    _path: list[Poses] = field(default_factory=list)  # a pose each
    _path_step_s: float = PATH_S  # between two of them
    _path_due_s: float = LONG_AGO

    def sampled(
        self, batch: SampleBatch, matrix: Array, update: Update | None, now_s: float
    ) -> list[LiveMessage]:
        """Return the messages of a batch with samples (n, columns); none for a repeated batch."""
        if batch.seq <= self._last_seq:
            return []
        if self._last_seq < 0:
            self._begin(matrix, now_s, float(matrix[-1, 0]))
        else:
            self.missing += batch.seq - self._last_seq - 1
        self._last_seq = batch.seq
        return self._samples(batch.columns, matrix, update)

    def hole_before(self, seq: int, columns: Sequence[str], t: float) -> MissingSpan | None:
        """Return the span that was not received between the newest batch and one that begins at t [s].

        Before the first batch: the beginning of the session, where that is at most FIRST_BATCHES ago.
        """
        batches = seq - self._last_seq - 1
        if batches <= 0 or not self._newest_sample_s < t < FARTHEST_S:
            return None
        if self._last_seq >= 0:
            return self._missing_span(t, batches)
        if batches <= FIRST_BATCHES:
            return MissingSpan(self.name, None, t, self._step_s, tuple(columns), batches)
        return None

    def unreceived_end(self, update: Update) -> MissingSpan | None:
        """Return the span after the newest sample of a closed session, the first time; else None."""
        if not update.closed or self._last_seq < 0 or self._is_end_read:
            return None
        self._is_end_read = True
        return self._missing_span(None, 0)

    def recovered(
        self, span: MissingSpan, rows: Array, update: Update | None, now_s: float
    ) -> list[LiveMessage]:
        """Return the messages of samples (n, columns) recovered from a gap, positions in metres."""
        if not len(rows):
            return []
        if self._last_seq < 0:
            self._begin(rows, now_s, span.before_s or float(rows[-1, 0]))
        self._last_seq += span.batches
        unit = "m" if update is None else update.status.length_unit
        return self._samples(span.columns, rows / in_metres(span.columns, unit), update)

    def _begin(self, matrix: Array, now_s: float, received_s: float) -> None:
        """Estimate the time of day of session time 0.

        A batch cannot arrive before its last sample was taken.
        """
        self._began_s = max(now_s - received_s, -float(matrix[:, 0].min()))

    def _missing_span(self, before_s: float | None, batches: int) -> MissingSpan:
        return MissingSpan(self.name, self._newest_sample_s, before_s, self._step_s, self._columns, batches)

    def _samples(self, columns: Sequence[str], matrix: Array, update: Update | None) -> list[LiveMessage]:
        """Messages of samples (n, columns)."""
        self._columns = tuple(columns)
        self._newest_sample_s = max(self._newest_sample_s, float(matrix[:, 0].max()))
        self._newest_s = max(self._newest_s, self._newest_sample_s)
        steps = np.diff(matrix[:, 0])
        if (steps > 0).any():
            self._step_s = float(steps[steps > 0].min())
        with suppress(RecordingError):  # the service refuses such samples as well
            content = self._content(columns, matrix, update)
            self._extend(content.poses)
            return [*map(self._placed, sample_entries(content)), *self._due_path()]
        return []

    def updated(self, update: Update, now_s: float) -> list[LiveMessage]:
        """Return the messages of new or changed results."""
        self._newest_s = max(self._newest_s, update.t)
        if self._began_s is None:
            self._began_s = max(now_s - update.t, 0.0)
        before, self._published = self._published, _results_of(update)
        changed = [
            self._result(topic, one)
            for topic, many in self._published.items()
            for index, one in enumerate(many)
            if before.get(topic, ())[index : index + 1] != (one,)
        ]
        return [*changed, *(self._whole_path() if changed and update.closed else [])]

    def current(self, topics: Sequence[str]) -> list[LiveMessage]:
        """Return all results so far of some topics, for a viewer that has just subscribed to them."""
        found = [self._result(topic, one) for topic in topics for one in self._published.get(topic, ())]
        return [*found, *(self._whole_path() if "/path" in topics else [])]

    def _content(self, columns: Sequence[str], matrix: Array, update: Update | None) -> McapContent:
        unit = "m" if update is None else update.status.length_unit
        recording = Recording(
            matrix[:, 0], signals_of(tuple(columns), matrix), length_unit=unit, name=self.name
        )
        return McapContent(
            station="",
            session=self.name,
            preset="",
            recording=recording,
            began_s=self._began_s or 0.0,
            columns=tuple(columns),
            poses=NO_POSES if update is None else poses_of(recording),
        )

    def _extend(self, poses: Poses) -> None:
        """Append poses to the path; beyond PATH_POINTS every second point is left out."""
        for index, t in enumerate(poses.t.tolist()):
            if not self._path or t >= self._path[-1].t[0] + self._path_step_s - 1e-9:
                self._path.append(Poses(*(of[index : index + 1] for of in poses)))
        if len(self._path) > PATH_POINTS:
            self._path, self._path_step_s = self._path[::2], 2.0 * self._path_step_s

    def _due_path(self) -> list[LiveMessage]:
        if self._newest_s < self._path_due_s:
            return []
        self._path_due_s = self._newest_s + PATH_EVERY_S
        return self._whole_path()

    def _whole_path(self) -> list[LiveMessage]:
        if not self._path:
            return []
        whole = Poses(*(np.concatenate(of) for of in zip(*self._path, strict=True)))
        return [LiveMessage(self._now(), "/path", path_of(whole, self._began_s or 0.0).fields)]

    def _result(self, topic: str, message: Message) -> LiveMessage:
        return LiveMessage(self._now(), topic, result_of(0.0, topic, message).fields)

    def _placed(self, one: McapMessage) -> LiveMessage:
        return LiveMessage(_time_of_day(one.t, self._began_s), one.topic, one.fields)

    def _now(self) -> int:
        """Time of day of the newest sample [ns]."""
        return _time_of_day(max(self._newest_s, 0.0), self._began_s)


def _time_of_day(t: float, began_s: float | None) -> int:
    """Time of day [ns] of a session time, not before 1970: the protocol has no earlier one."""
    return max(0, nanoseconds(t, began_s or 0.0))


def _results_of(update: Update) -> dict[str, tuple[Message, ...]]:
    """Results by topic."""
    return {
        "/segments": update.segments,
        "/phases": update.phases,
        "/changepoints": update.changepoints,
        "/gaps": update.status.gaps,
        "/program": (TaskProgram.of(update.program),),
    }

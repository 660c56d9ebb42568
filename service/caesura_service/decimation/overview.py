"""Everything of a session in bins of about a hundred samples, built once and continued while it grows.

A view whose bins are wider is made from it. For a narrower one the samples themselves are read: the overview
has the places in the journal at which each time stands.
"""

from __future__ import annotations

from bisect import bisect_left
from struct import unpack_from
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.extremes import Extremes, bins_of, extremes_of, joined, nothing
from caesura_protocol.messages import Gap, Open
from caesura_protocol.runs import Speed, drawn_columns
from caesura_service.decimation.assembly import Assembly
from caesura_service.journal import Key, Lost, SessionExtent, StoredBatch
from caesura_service.session.limits import Limits

SAMPLES_PER_BIN = 100
WIDTHS_S = tuple(m * 10.0**e for e in range(-3, 3) for m in (1.0, 2.0, 5.0))
PARTS = 64  # pages that are joined at once
HELD = Limits().held_batches  # that may come before their turn


class PageTimes(NamedTuple):
    """Records that were read together: which times, at which places."""

    t0: float  # [s]
    tn: float  # [s]
    first: int
    last: int


class SessionOverview:
    """A fold over the pages of a session's batches. One thread calls it."""

    def __init__(self, key: Key, extent: SessionExtent) -> None:
        self.key = key
        self.extent = extent  # the copy that it is of
        self.read_up_to = -1  # place of the last record
        self.columns = drawn_columns(extent.opening.columns)
        self.bin_s = 0.0  # [s]; 0 before the first samples
        self.first: float | None = None  # [s] the first sample
        self.holes: list[Gap] = []
        self.pages: list[PageTimes] = []
        self._assembly, self._speed = Assembly(extent.opening), Speed(extent.opening.columns)
        self._parts: list[Extremes] = []
        self._held: dict[int, StoredBatch] = {}
        self._next_seq: int | None = None

    @property
    def opening(self) -> Open:
        """What the session was opened with."""
        return self.extent.opening

    @property
    def last(self) -> float | None:
        """[s] the last sample."""
        return None if self.first is None else self._assembly.latest

    @property
    def nbytes(self) -> int:
        """What it takes in memory, about [bytes]."""
        return sum(part.nbytes for part in self._parts) + 200 * len(self.pages) + 500 * len(self.holes)

    def extremes(self) -> Extremes:
        """All bins."""
        if not self._parts:
            return nothing(len(self.columns))
        self._parts = [joined(self._parts)]
        return self._parts[0]

    def push(self, page: list[StoredBatch | Lost], up_to: int) -> None:
        """The next page, which ends with the place `up_to`."""
        batches = []
        for one in page:
            if isinstance(one, Lost):
                batches += self._skip(one.seq)
            elif self._next_seq is None or one.seq >= self._next_seq:
                self._held[one.seq] = one
                batches += self._ready()
        if len(self._held) > HELD:
            batches += self._skip(min(self._held))
        self._take(batches)
        self._index(page)
        self.read_up_to = up_to

    def finish(self) -> None:
        """No batch comes any more: what waits for an earlier one waits for nothing."""
        while self._held:
            self._take(self._skip(min(self._held)))

    def _ready(self) -> list[StoredBatch]:
        if self._next_seq is None:
            self._next_seq = min(self._held)
        found = []
        while (one := self._held.pop(self._next_seq, None)) is not None:
            found.append(one)
            self._next_seq += 1
        return found

    def _skip(self, seq: int) -> list[StoredBatch]:
        found = [self._held.pop(known) for known in sorted(self._held) if known < seq]
        self._next_seq = max(seq, self._next_seq or 0)
        return [*found, *self._ready()]

    def _take(self, batches: list[StoredBatch]) -> None:
        for run in self._assembly.push(batches):
            if self.first is None:
                self.first = float(run.t[0])
            if not self.bin_s:
                self.bin_s = _width(run.t)
            if run.after is not None:
                self.holes.append(run.after)
            values = self._speed.beside(run)
            self._parts.append(extremes_of(bins_of(run.t, self.bin_s), run.t, values))
        if len(self._parts) > PARTS:
            self._parts = [joined(self._parts)]

    def _index(self, page: list[StoredBatch | Lost]) -> None:
        """Where the times of a page are; those of a batch lie within its span."""
        batches = [one for one in page if isinstance(one, StoredBatch)]
        if not batches:
            return
        times = [_time(one, row) for one in batches for row in (0, one.n - 1)]
        self.pages.append(PageTimes(min(times), max(times), batches[0].place, batches[-1].place))

    def places(self, t0: float, tn: float) -> list[PageTimes]:
        """The pages that may have samples from t0 to tn [s]."""
        return [page for page in self.pages if page.t0 <= tn and page.tn >= t0]


def _time(batch: StoredBatch, row: int) -> float:
    """The time of one row of a batch [s]; `t0` where it has no such row."""
    width = len(batch.columns)
    kind, size = ("<f", 4) if len(batch.samples) == 4 * batch.n * width else ("<d", 8)
    place = row * width * size
    if place + size > len(batch.samples):
        return batch.t0
    (offset,) = unpack_from(kind, batch.samples, place)
    return batch.t0 + float(offset)


def _width(t: NDArray[np.float64]) -> float:
    """A round width for about SAMPLES_PER_BIN of these samples."""
    interval = float(np.median(np.diff(t))) if t.size > 1 else 0.001
    wanted = SAMPLES_PER_BIN * interval
    return WIDTHS_S[min(bisect_left(WIDTHS_S, wanted * 0.99), len(WIDTHS_S) - 1)]

"""The samples of a session in bins of twenty to fifty samples, built once and extended as it grows.

A view with wider bins is made from the overview. For narrower bins the samples are read from the journal; the
overview stores the places of the records of each time.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from io import BytesIO
from struct import unpack_from
from typing import NamedTuple

import numpy as np
from numpy.lib.format import read_array, write_array
from numpy.typing import NDArray

from caesura_protocol.derived_columns import DerivedColumns, drawn_columns
from caesura_protocol.messages import Gap, Open, Quaternion
from caesura_protocol.minmax_decimation import Extremes, bins_of, extremes_of, joined, nothing
from caesura_service.decimation.batch_decoder import BatchDecoder
from caesura_service.journal import BatchRow, Key, Lost, SessionExtent
from caesura_service.sessions.limits import Limits

SAMPLES_PER_BIN = 50  # at most: a view of narrower bins reads so many for each of its own
WIDTHS_S = tuple(m * 10.0**e for e in range(-3, 3) for m in (1.0, 2.0, 5.0))
PARTS = 64  # pages that are joined at once
VERSION = 2  # of what is kept of an overview; another one is made anew
KEPT = ("bin_s", "first", "last", "read_up_to")
HELD = Limits().held_batches  # that may come before their turn


class PageTimes(NamedTuple):
    """The times and places of the records of one page."""

    t0: float  # [s]
    tn: float  # [s]
    first: int
    last: int


class SessionOverview:
    """A fold over the pages of a session's batches. Only one thread may call it."""

    def __init__(self, key: Key, extent: SessionExtent) -> None:
        self.key = key
        self.extent = extent  # the copy that it is of
        self.read_up_to = -1  # place of the last record
        self.columns = drawn_columns(extent.opening.columns)
        self.bin_s = 0.0  # [s]; 0 before the first samples
        self.first: float | None = None  # [s] the first sample
        self.last: float | None = None  # [s] the last one
        self.is_kept = False  # does the journal have it as it is?
        self.holes: list[Gap] = []
        self.pages: list[PageTimes] = []
        self._assembly, self._derived = BatchDecoder(extent.opening), DerivedColumns(extent.opening.columns)
        self._parts: list[Extremes] = []
        self._held: dict[int, BatchRow] = {}
        self._next_seq: int | None = None

    @property
    def opening(self) -> Open:
        """The opening of the session."""
        return self.extent.opening

    @property
    def first_orientation(self) -> Quaternion | None:
        """The first orientation of the session, to which its rotations are relative."""
        return self._derived.first_orientation

    @property
    def nbytes(self) -> int:
        """The approximate size [bytes] in memory."""
        return sum(part.nbytes for part in self._parts) + 200 * len(self.pages) + 500 * len(self.holes)

    def extremes(self) -> Extremes:
        """Return the extremes of all bins."""
        if not self._parts:
            return nothing(len(self.columns))
        self._parts = [joined(self._parts)]
        return self._parts[0]

    def push(self, page: list[BatchRow | Lost], up_to: int) -> None:
        """Add the next page, whose last record is at the place `up_to`."""
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
        """Add the batches that wait for an earlier one, at the end of the session."""
        while self._held:
            self._take(self._skip(min(self._held)))

    def _ready(self) -> list[BatchRow]:
        if self._next_seq is None:
            self._next_seq = min(self._held)
        found = []
        while (one := self._held.pop(self._next_seq, None)) is not None:
            found.append(one)
            self._next_seq += 1
        return found

    def _skip(self, seq: int) -> list[BatchRow]:
        found = [self._held.pop(known) for known in sorted(self._held) if known < seq]
        self._next_seq = max(seq, self._next_seq or 0)
        return [*found, *self._ready()]

    def _take(self, batches: list[BatchRow]) -> None:
        for run in self._assembly.push(batches):
            if self.first is None:
                self.first = float(run.t[0])
            if not self.bin_s:
                self.bin_s = _width(run.t)
            if run.after is not None:
                self.holes.append(run.after)
            self.last = float(run.t[-1])
            values = self._derived.beside(run)
            self._parts.append(extremes_of(bins_of(run.t, self.bin_s), run.t, values))
        if len(self._parts) > PARTS:
            self._parts = [joined(self._parts)]

    def _index(self, page: list[BatchRow | Lost]) -> None:
        """Add the times and places of a page to `pages`.

        All times of a batch are assumed to lie between those of its first and last row.
        """
        batches = [one for one in page if isinstance(one, BatchRow)]
        if not batches:
            return
        times = [t for one in batches for t in batch_times(one)]
        self.pages.append(PageTimes(min(times), max(times), batches[0].place, batches[-1].place))

    def as_bytes(self) -> bytes:
        """Return the overview as bytes, to be stored with a closed session."""
        fields = {name: getattr(self, name) for name in KEPT}
        fields |= {"holes": [hole.model_dump() for hole in self.holes], "identity": self._identity()}
        fields |= {"first_orientation": self.first_orientation}
        content = BytesIO()  # without the checksums of an npz: the journal has its own
        content.writelines([_title(), json.dumps(fields).encode(), b"\n"])
        for array in (np.array(self.pages), *self.extremes()):
            write_array(content, array, allow_pickle=False)
        return content.getvalue()

    @classmethod
    def restored(cls, key: Key, extent: SessionExtent, content: bytes) -> SessionOverview | None:
        """Return the overview that `as_bytes` made of the same copy; None for another copy or version."""
        overview, kept = cls(key, extent), BytesIO(content)
        try:
            if kept.readline() != _title():
                return None
            fields = json.loads(kept.readline())
            if fields.pop("identity") != overview._identity():
                return None
            if (turned_from := fields.pop("first_orientation")) is not None:
                overview._derived = DerivedColumns(extent.opening.columns, tuple(turned_from))
            overview.holes = [Gap.model_validate(hole) for hole in fields.pop("holes")]
            pages = read_array(kept, allow_pickle=False).tolist()
            overview.pages = [PageTimes(t0, tn, int(first), int(last)) for t0, tn, first, last in pages]
            overview._parts = [Extremes(*(read_array(kept, allow_pickle=False) for _ in Extremes._fields))]
        except (ValueError, KeyError, OSError):
            return None
        for name in KEPT:
            setattr(overview, name, fields[name])
        overview.is_kept = True
        return overview

    def _identity(self) -> str:
        """Return the identity of this copy of the session and its columns; moving the file keeps it."""
        return repr((self.extent.identity[1:], self.columns))

    def places(self, t0: float, tn: float) -> list[PageTimes]:
        """Return the pages that may have samples from t0 to tn [s]."""
        return [page for page in self.pages if page.t0 <= tn and page.tn >= t0]


def _title() -> bytes:
    """Return the first line of a stored overview; no version takes that of another for its own."""
    return f"caesura overview {VERSION}\n".encode()


def batch_times(batch: BatchRow) -> tuple[float, float]:
    """Return the times [s] of the first and the last row of a batch."""
    return _time(batch, 0), _time(batch, batch.n - 1)


def _time(batch: BatchRow, row: int) -> float:
    """Return the time [s] of one row of a batch; `t0` if it has no such row."""
    width = len(batch.columns)
    kind, size = ("<f", 4) if len(batch.samples) == 4 * batch.n * width else ("<d", 8)
    place = row * width * size
    if place + size > len(batch.samples):
        return batch.t0
    (offset,) = unpack_from(kind, batch.samples, place)
    return batch.t0 + float(offset)


def _width(t: NDArray[np.float64]) -> float:
    """Return the greatest round bin width [s] with at most SAMPLES_PER_BIN of these samples per bin."""
    interval = float(np.median(np.diff(t))) if t.size > 1 else 0.001
    return WIDTHS_S[max(bisect_right(WIDTHS_S, SAMPLES_PER_BIN * interval * 1.01) - 1, 0)]

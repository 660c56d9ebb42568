"""Samples of sessions for plots, from cached overviews or from the journal.

A session is read once for its overview. Then the cost of an answer depends on its size: bins of the overview,
or at most MOST_SAMPLES of the journal. The calling thread does all of this work.
"""

from __future__ import annotations

import logging
import time
from typing import NamedTuple

import numpy as np

from caesura_protocol.derived_columns import SPEED_WINDOW_S, DerivedColumns, chosen_columns
from caesura_protocol.errors import ProtocolError
from caesura_protocol.keys import MAX_BINS, SampleRange
from caesura_protocol.messages import MAX_HOLES, Gap, RecordedSamples
from caesura_protocol.minmax_decimation import (
    Extremes,
    between,
    bins_of,
    coarser,
    extremes_of,
    joined,
    nothing,
    of_columns,
    packed,
    points_of,
)
from caesura_service.decimation.batch_decoder import BatchDecoder
from caesura_service.decimation.overview import SAMPLES_PER_BIN, SessionOverview, batch_times
from caesura_service.journal import BatchRow, BatchSource, JournalError, Key, SessionExtent

logger = logging.getLogger(__name__)

LEAD_S = 4 * SPEED_WINDOW_S  # read before a range, for the speed at its beginning
MOST_SAMPLES = MAX_BINS * SAMPLES_PER_BIN  # read for one answer; a wider range has the overview's bins
SLICE_S = 0.1  # of reading, before another station has its turn
HELD_BYTES = 1 << 27  # of overviews; past it the one that was asked for longest ago goes


class Owned(NamedTuple):
    """A session and the instance that answers for it."""

    station: str
    session: str
    instance: str
    epoch: int
    is_open: bool


class SampleReader:
    """Answers queries for samples of one service's sessions. Only one thread may call it."""

    def __init__(self, source: BatchSource, held_bytes: int = HELD_BYTES) -> None:
        self._source = source
        self._held_bytes = held_bytes
        self._overviews: dict[Key, SessionOverview] = {}  # the one that was asked for last stands last

    def read(
        self, owned: Owned, wanted: SampleRange, slice_s: float = float("inf")
    ) -> RecordedSamples | None:
        """Return the samples of a session in a range, decimated; None if slice_s was too short.

        The next call continues. Columns that the session lacks are left out. Raises ProtocolError
        `unknown_session` if the journal has no copy of it; JournalError.
        """
        overview, is_complete = self._overview(owned, slice_s)
        if not is_complete:
            return None
        columns = chosen_columns(wanted.columns, overview.columns)
        places = [overview.columns.index(name) for name in columns]
        bin_s, extremes = self._extremes(overview, wanted, places)
        points = [points_of(extremes, place) for place in range(len(places))]
        holes, more = _listed(overview.holes, wanted)
        return RecordedSamples(
            station=owned.station,
            session=owned.session,
            instance=owned.instance,
            epoch=owned.epoch,
            t0=wanted.t0,
            tn=wanted.tn,
            bin_s=bin_s,
            available=overview.columns,
            columns=columns,
            **packed(points),
            first=overview.first,
            last=overview.last,
            holes=holes,
            holes_more=more,
            force_frame=overview.opening.force_frame,
            first_orientation=overview.first_orientation,
        )

    def has(self, station: str, session: str) -> bool:
        """Whether the journal has samples of a session. Raises JournalError."""
        return self._source.find((station, session)) is not None

    def advance(self, owned: Owned, slice_s: float = SLICE_S) -> bool:
        """Read a session's overview for about slice_s; return whether it is complete. Raises as `read`."""
        return self._overview(owned, slice_s)[1]

    def _overview(self, owned: Owned, slice_s: float) -> tuple[SessionOverview, bool]:
        """Return the overview of a session up to now, and whether it is complete.

        slice_s: [s] after which it stops reading. Raises as `read`.
        """
        until = time.monotonic() + slice_s
        key = (owned.station, owned.session)
        extent = self._source.find(key)
        if extent is None:
            self._overviews.pop(key, None)
            raise ProtocolError(
                "unknown_session", "the journal has no sample of this session", value="/".join(key)
            )
        overview = self._overviews.pop(key, None)
        if overview is None or overview.extent.identity != extent.identity:
            kept = None if owned.is_open else self._source.overview(extent)
            overview = (kept and SessionOverview.restored(key, extent, kept)) or SessionOverview(key, extent)
        self._overviews[key] = overview
        is_complete = self._read(key, overview, extent, until)
        if is_complete and not owned.is_open:
            overview.finish()
            self._keep(key, overview)
        self._let_go()
        return overview, is_complete

    def _keep(self, key: Key, overview: SessionOverview) -> None:
        if overview.is_kept or not overview.bin_s:
            return
        overview.is_kept = True
        try:
            self._source.keep_overview(key, overview.extent, overview.as_bytes())
        except JournalError as error:  # full, for example: it is made again when it is asked for
            logger.warning("the overview of %s is not stored: %s", "/".join(key), error)

    def _read(self, key: Key, overview: SessionOverview, extent: SessionExtent, until: float) -> bool:
        if extent.last <= overview.read_up_to:
            return True
        for page in self._source.pages(key, extent, overview.read_up_to, extent.last):
            places = [one.place for one in page if isinstance(one, BatchRow)]
            overview.push(page, max(places, default=overview.read_up_to))
            if time.monotonic() > until:
                return False
        overview.read_up_to = extent.last
        return True

    def _let_go(self) -> None:
        while len(self._overviews) > 1 and self._bytes() > self._held_bytes:
            self._overviews.pop(next(iter(self._overviews)))

    def _bytes(self) -> int:
        return sum(one.nbytes for one in self._overviews.values())

    def _extremes(
        self, overview: SessionOverview, wanted: SampleRange, places: list[int]
    ) -> tuple[float, Extremes]:
        """Return the width [s] and the extremes of the bins that a range touches, of some columns."""
        bin_s = (wanted.tn - wanted.t0) / wanted.bins
        if bin_s < overview.bin_s and (fresh := self._fresh(overview, wanted, bin_s, places)) is not None:
            return bin_s, fresh
        if not overview.bin_s:
            return bin_s, nothing(len(places))
        every = int(np.ceil(bin_s / overview.bin_s * (1 - 1e-9)))
        first, last = bins_of(np.array([wanted.t0, wanted.tn]), overview.bin_s).tolist()
        begin, end = first // every * every, (last // every + 1) * every - 1
        some = of_columns(between(overview.extremes(), begin, end), places)
        return every * overview.bin_s, coarser(some, every)

    def _fresh(
        self, overview: SessionOverview, wanted: SampleRange, bin_s: float, places: list[int]
    ) -> Extremes | None:
        """Return the extremes of the bins that a range touches, computed from the samples themselves.

        Returns None for more than MOST_SAMPLES: a session may begin with few samples a second, for which its
        overview has wide bins, and go on with many.
        """
        first, last = bins_of(np.array([wanted.t0, wanted.tn]), bin_s).tolist()
        t0, tn, count = first * bin_s - LEAD_S, (last + 1) * bin_s, 0
        pages = overview.places(t0, tn)
        batches: dict[int, BatchRow] = {}
        if pages:
            beyond, up_to = min(page.first for page in pages) - 1, max(page.last for page in pages)
            for page in self._source.pages(overview.key, overview.extent, beyond, up_to):
                batches |= {one.seq: one for one in page if isinstance(one, BatchRow)}
                times = ((one.n, *batch_times(one)) for one in page if isinstance(one, BatchRow))
                count += sum(n for n, begin, end in times if begin <= tn and end >= t0)
                if count > MOST_SAMPLES:
                    return None
        assembly = BatchDecoder(overview.opening)
        derived = DerivedColumns(overview.opening.columns, overview.first_orientation)
        parts = []
        for run in assembly.push([batches[seq] for seq in sorted(batches)]):
            values, index = derived.beside(run), bins_of(run.t, bin_s)
            inside = slice(*np.searchsorted(index, (first, last + 1)))
            if inside.start < inside.stop:
                parts.append(extremes_of(index[inside], run.t[inside], values[inside, places]))
        return joined(parts) if parts else nothing(len(places))


def _listed(holes: list[Gap], wanted: SampleRange) -> tuple[tuple[Gap, ...], int]:
    """Return the holes that reach into a range, in order, and the number of shorter ones not listed."""
    inside = [hole for hole in holes if hole.tn > wanted.t0 and hole.t0 < wanted.tn]
    more = max(0, len(inside) - MAX_HOLES)
    if more:
        shortest = sorted(inside, key=lambda hole: hole.tn - hole.t0)[more:]
        inside = sorted(shortest, key=lambda hole: hole.t0)
    return tuple(inside), more

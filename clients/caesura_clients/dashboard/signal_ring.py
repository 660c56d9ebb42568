"""The newest samples of a station as points to draw, and their binary encoding for a browser.

A ring holds the newest SPAN_S of one session in bins of BIN_S, with the least and greatest sample of each
column per bin. So a live view needs no query to the service. Older samples are read from the journal.
"""

from __future__ import annotations

import json
import struct
import threading
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.derived_columns import (
    ROTATION,
    SPEED,
    DerivedColumns,
    chosen_columns,
    drawn_columns,
)
from caesura_protocol.gap_free_sample_runs import RunSplitter, in_metres
from caesura_protocol.keys import SampleRange
from caesura_protocol.messages import ForceFrame, Gap, LengthUnit, Quaternion, RecordedSamples
from caesura_protocol.minmax_decimation import (
    Extremes,
    between,
    bins_of,
    extremes_of,
    joined,
    packed,
    points_of,
)

BIN_S = 0.04
SPAN_S = 60.0
FOLD_ROWS = 200  # samples that are folded at once
SPAN_BINS = round(SPAN_S / BIN_S)
PARTS = 64  # joined at once
FARTHEST_S = 1e10  # a session time beyond it is none; a service refuses it as well
PADDING = 8  # [bytes] points begin at a multiple of it

Array = NDArray[np.float64]


class SignalRing:
    """The newest samples of one station; written by one thread, read by others."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin("", ())

    def _begin(self, session: str, columns: tuple[str, ...]) -> None:
        self._session, self._columns = session, columns
        self._splitter, self._derived = RunSplitter(), DerivedColumns(columns)
        self._rotations_from = float("-inf")  # [s]
        self._waiting: list[tuple[int, Array]] = []
        self._rows = 0  # that wait
        self._parts: list[Extremes] = []
        self._holes: deque[Gap] = deque(maxlen=256)
        self._first = self._last = float("nan")  # [s]
        self._has_beginning = False  # is the session's first sample the first here?

    @property
    def session(self) -> str:
        """The name of the session whose samples are held; empty before the first one."""
        return self._session

    def receive(self, session: str, columns: tuple[str, ...], seq: int, matrix: Array) -> None:
        """Append a batch of samples (n, columns), session time [s] first.

        Another session, or other columns, clear the ring first.
        """
        with self._lock:
            if (session, columns) != (self._session, self._columns):
                self._begin(session, columns)
            matrix = matrix[np.abs(matrix[:, 0]) < FARTHEST_S]
            if not len(matrix):
                return
            self._waiting.append((seq, matrix))
            self._rows += len(matrix)
            if self._rows > FOLD_ROWS:
                self._fold()

    def covers(self, session: str, t0: float, columns: tuple[str, ...] = ()) -> bool:
        """Return whether the ring has all samples of a session that the station has sent from t0 [s] on.

        columns: that are read, all if empty. False if a batch was not received, or if rotations are read from
        an orientation that is not known here: the caller queries the journal, which may have it.
        """
        with self._lock:
            self._fold()
            if self._parts:
                self._drop_old()  # as a read does
            is_whole = all(hole.reason == "source" or hole.tn <= t0 for hole in self._holes)
            rotates = set(chosen_columns(columns, drawn_columns(self._columns))) & set(ROTATION)
            if rotates and t0 < self._rotations_from:
                return False
            return is_whole and session == self._session and (self._has_beginning or self._first <= t0)

    def set_first_orientation(self, session: str, orientation: Quaternion | None) -> None:
        """Set the orientation from which a session turns, unless its beginning was received."""
        with self._lock:
            self._fold()
            if session == self._session and orientation and self._derived.first_orientation is None:
                self._derived.first_orientation = orientation
                self._rotations_from = self._last + BIN_S  # the bin of the last sample lacks some

    def read(
        self, station: str, wanted: SampleRange, unit: LengthUnit, frame: ForceFrame
    ) -> RecordedSamples | None:
        """Return the points of a range in the form of a service's reply.

        `first` is None if the beginning was not received. unit: of the session's positions; frame: of its
        force.
        """
        with self._lock:
            self._fold()
            if not self._parts:
                return None
            self._drop_old()
            first, last = bins_of(np.array([wanted.t0, wanted.tn]), BIN_S).tolist()
            some, held = between(self._parts[0], first, last), tuple(self._holes)
            session, columns, newest = self._session, self._columns, self._last
            first_s = self._first if self._has_beginning else None
        known = drawn_columns(columns)
        scale = dict(zip(columns, in_metres(columns, unit), strict=True))
        scale.setdefault(SPEED, scale.get("px", 1.0))
        chosen = chosen_columns(wanted.columns, known)
        points = [points_of(some, known.index(name)) * (1.0, scale.get(name, 1.0)) for name in chosen]
        return RecordedSamples(
            station=station,
            session=session,
            instance="dashboard",
            epoch=0,
            t0=wanted.t0,
            tn=wanted.tn,
            bin_s=BIN_S,
            available=known,
            columns=chosen,
            **packed(points),
            first=first_s,
            last=newest,
            holes=tuple(hole for hole in held if hole.tn > wanted.t0 and hole.t0 < wanted.tn),
            force_frame=frame,
        )

    def _fold(self) -> None:
        """Move the pending samples into the bins, and from time to time drop bins older than SPAN_S."""
        if not self._rows:
            return
        matrix = np.concatenate([rows for _, rows in self._waiting])
        seqs = np.concatenate([np.full(len(rows), seq) for seq, rows in self._waiting])
        self._waiting, self._rows = [], 0
        for run in self._splitter.push(matrix, seqs):
            if run.after is not None:
                self._holes.append(run.after)
            if not self._parts:
                self._first, self._has_beginning = float(run.t[0]), int(seqs[0]) == 0
                if not self._has_beginning:
                    self._derived = DerivedColumns(self._columns, has_beginning=False)
                    self._rotations_from = float("inf")
            self._parts.append(extremes_of(bins_of(run.t, BIN_S), run.t, self._derived.beside(run)))
            self._last = float(run.t[-1])
        if len(self._parts) > PARTS or sum(len(part.number) for part in self._parts[1:]) > SPAN_BINS:
            self._drop_old()

    def _drop_old(self) -> None:
        """Join all parts to one, and drop bins older than SPAN_S."""
        whole = joined(self._parts)
        newest = int(whole.number[-1])
        oldest = newest - SPAN_BINS
        self._parts = [between(whole, oldest, newest)]
        if whole.number[0] < oldest:
            self._first, self._has_beginning = float(self._parts[0].number[0]) * BIN_S, False


def as_bytes(recorded: RecordedSamples) -> bytes:
    """Encode points for `signals.js`: length of the header, header as JSON, points as float64.

    Points are pairs (t, value), column by column, and begin at a multiple of PADDING bytes.
    """
    fields: dict[str, Any] = recorded.model_dump(exclude={"points", "holes"})
    fields["holes"] = [[hole.t0, hole.tn, hole.reason] for hole in recorded.holes]
    header = json.dumps(fields, allow_nan=False).encode()
    header += b" " * (-(4 + len(header)) % PADDING)
    return struct.pack("<I", len(header)) + header + recorded.points

"""Reads samples that the network dropped on the way to a viewer from the service's journal.

The service requests lost batches from the bridge, and records them in order. So once the journal has a sample
after a gap, samples of the gap that the journal lacks are permanently lost.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import numpy as np

from caesura_clients import query
from caesura_clients.full_samples import read_range, width_of
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.keys import SampleRange
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S, Transport

PATIENCE_S = 2.0  # for the service to receive and record what was lost
ASK_EVERY_S = 0.1
REST_S = 10.0  # after a hole that was not read: a service that is gone must not delay all later samples
MOST_QUERIES = 64  # for a hole: 2 min at 1 kHz; a longer one stays


@dataclass(frozen=True)
class MissingSpan:
    """A gap in the samples of a session. columns: of its samples, time first."""

    session: str
    after_s: float | None  # [s] the sample before it; None at the beginning of the session
    before_s: float | None  # [s] the sample after it; None at the end of the session
    step_s: float  # [s] the least time between two samples
    columns: tuple[str, ...]
    batches: int  # that are known to be missing


@dataclass
class MissingSamples:
    """Reads the gaps of one station. Only one thread may call it."""

    transport: Transport
    station: str
    over: threading.Event
    _resting_until: float = field(default=-np.inf)

    def read(self, span: MissingSpan) -> Array | None:
        """Return the samples (n, columns) inside a gap, lengths in metres; None if they are not known.

        Takes at most PATIENCE_S and the time of the answers.
        """
        if time.monotonic() < self._resting_until:
            return None
        try:
            found = self._read(span)
        except (CaesuraError, ProtocolError):
            found = None
        if found is None:
            self._resting_until = time.monotonic() + REST_S
        return found

    def _read(self, span: MissingSpan) -> Array | None:
        until = time.monotonic() + PATIENCE_S
        ends = self._ends(span)
        while ends is None:
            if time.monotonic() > until or self.over.wait(ASK_EVERY_S):
                return None
            ends = self._ends(span)
        begin, end = ends
        if (end - begin) / width_of(span.step_s) > MOST_QUERIES:
            return None
        found = read_range(
            self.transport, (self.station, span.session), span.columns, (begin, end), span.step_s
        )
        is_whole = all(hole.reason == "source" for hole in found.holes)
        return found.rows if is_whole else None

    def _ends(self, span: MissingSpan) -> tuple[float, float] | None:
        """Return the times [s] between which the gap lies; None until the journal has reached its end."""
        near = span.after_s or span.before_s or 0.0
        known = query.samples(
            self.transport,
            self.station,
            span.session,
            SampleRange(near, near + span.step_s, 1),
            timeout_s=QUERY_TIMEOUT_S,
        )
        if known.first is None or known.last is None or known.last < (span.before_s or known.last):
            return None
        begin = np.nextafter(known.first, -np.inf) if span.after_s is None else span.after_s
        end = np.nextafter(known.last, np.inf) if span.before_s is None else span.before_s
        return float(begin), float(end)

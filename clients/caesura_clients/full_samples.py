"""Queries all samples of a session in a range from the service's journal.

Bins are so narrow that every sample is returned.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from caesura_clients import query
from caesura_clients.session_state_reader import Update
from caesura_clients.session_to_recording import stated_recording
from caesura_protocol.derived_columns import DERIVED
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.keys import MAX_BINS, MIN_BIN_S, SampleRange
from caesura_protocol.messages import Gap, RecordedSamples
from caesura_protocol.minmax_decimation import unpack_points
from caesura_protocol.recording import Recording
from caesura_protocol.transport.transport_interface import QUERY_TIMEOUT_S, Transport

MOST_VALUES = 20_000_000  # of a recording: half an hour at 1 kHz with ten columns
SHORTEST_STEP = 1 / 8  # of the mean one, for samples that do not come evenly


class FullRange(NamedTuple):
    """All samples of a time range."""

    rows: Array  # (n, columns) time first, lengths in metres
    holes: tuple[Gap, ...]


def width_of(step_s: float) -> float:
    """Return the duration [s] of one query if samples are at least step_s [s] apart."""
    return MAX_BINS * max(step_s / 2, MIN_BIN_S)


def read_range(
    transport: Transport,
    key: tuple[str, str],
    columns: Sequence[str],
    ends: tuple[float, float],
    step_s: float,
) -> FullRange:
    """Return the samples strictly between two times [s], by one query per width_of(step_s).

    key: station and session; columns: time first; step_s: the least time between two samples [s]. Raises
    ProtocolError if samples are closer than step_s; NotFound or Unreachable.
    """
    begin, end = ends
    width, parts, holes = width_of(step_s), [np.zeros((0, len(columns)))], list[Gap]()
    for t0 in np.arange(begin, end, width).tolist():
        wanted = SampleRange(t0, t0 + width, MAX_BINS, tuple(columns[1:]))
        recorded = query.samples(transport, *key, wanted, timeout_s=QUERY_TIMEOUT_S)
        parts.append(_rows(recorded, columns))
        holes += recorded.holes
    rows = np.concatenate(parts)
    _, first = np.unique(rows[:, 0], return_index=True)  # bins at both ends of a query are whole
    rows = rows[first]
    return FullRange(rows[(rows[:, 0] > begin) & (rows[:, 0] < end)], tuple(holes))


def read_recording(transport: Transport, update: Update) -> Recording:
    """Return all samples of a session as a recording in metres.

    Raises CaesuraError for too many samples or none, and as `read_range`.
    """
    name = f"{update.station}/{update.session}"
    key = (update.station, update.session)
    whole = query.samples(transport, *key, SampleRange(0.0, 1.0, 1))  # the first query reads the session
    columns = ("t", *(column for column in whole.available if column not in DERIVED))
    if whole.first is None or whole.last is None:
        raise CaesuraError(f"{name} has no samples")
    if (values := update.status.samples * len(columns)) > MOST_VALUES:
        raise CaesuraError(
            f"{name} has {values} values, at most {MOST_VALUES}: `caesura sessions export` on the service's "
            "machine has no such limit"
        )
    ends = float(np.nextafter(whole.first, -np.inf)), float(np.nextafter(whole.last, np.inf))
    step_s = (whole.last - whole.first) / max(update.status.samples - 1, 1)
    try:
        rows = read_range(transport, key, columns, ends, step_s).rows
    except ProtocolError:
        rows = read_range(transport, key, columns, ends, step_s * SHORTEST_STEP).rows
    return stated_recording(columns, rows, update.status, update.program, unit="m")


def _rows(recorded: RecordedSamples, columns: Sequence[str]) -> Array:
    """Return the samples (n, columns) of a reply. Raises ProtocolError if a column lacks some of them."""
    points = unpack_points(recorded)
    found = [points[name] for name in columns[1:] if name in points]
    alike = all(np.array_equal(one[:, 0], found[0][:, 0]) for one in found)
    if len(found) < len(columns) - 1 or not alike:
        raise ProtocolError("malformed", "samples: the columns have different times")
    return np.column_stack([found[0][:, 0], *(one[:, 1] for one in found)])

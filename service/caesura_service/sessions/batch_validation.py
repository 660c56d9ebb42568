"""Validation of a batch: declared columns, finite numbers, plausible times and values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.codec import cells_of, check_finite, matrix_of
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import Open, SampleBatch
from caesura_protocol.plausibility import likely_time_unit
from caesura_service.sessions.limits import Limits


def validate_columns(opening: Open) -> None:
    """Check that the columns begin with time and differ. Raises ProtocolError `malformed`."""
    if opening.columns[0] != "t":
        raise ProtocolError("malformed", "first column is not t", value=opening.columns[0], expected="t")
    for index, column in enumerate(opening.columns):
        if column in opening.columns[:index]:
            raise ProtocolError("malformed", "a column comes twice", value=column)


def validated_samples(batch: SampleBatch, columns: tuple[str, ...], limits: Limits) -> NDArray[np.float64]:
    """Return the matrix (n, columns) of a batch, session time [s] first. Raises ProtocolError `malformed`."""
    if batch.columns != columns:
        raise ProtocolError(
            "malformed", "columns differ from those of the opening", value=batch.columns, expected=columns
        )
    cells = cells_of(batch)
    is_small = np.vdot(cells, cells) <= limits.value**2 / 2  # as nearly always: no value is above it
    if not is_small:
        check_finite(batch, cells)
        _check_values(batch, cells, limits)
    matrix = matrix_of(batch)
    _check_times(batch.seq, matrix[:, 0], limits)
    return matrix


def is_usual(samples: NDArray[np.float64], limits: Limits) -> bool:
    """Return True only if `validated_samples` would accept each batch of these samples (n, columns).

    After False it may accept some or all: each batch must be validated separately.
    """
    if not np.vdot(samples, samples) <= limits.value**2:
        return False
    known = samples[:, 0].tolist()
    low, high = min(known), max(known)
    return bool(max(-low, high) <= limits.time_s and high - low <= limits.batch_span_s)


def _check_times(seq: int, times: NDArray[np.float64], limits: Limits) -> None:
    known = times.tolist()
    low, high = min(known), max(known)
    reach = max(-low, high)
    if reach > limits.time_s:
        raise ProtocolError(
            "malformed", f"time in batch {seq} is out of range", value=reach, limit=limits.time_s
        )
    if high - low > limits.batch_span_s:
        why = f"batch {seq} lasts too long{_likely_cause(times, limits)}"
        raise ProtocolError("malformed", why, value=high - low, limit=limits.batch_span_s)


def _likely_cause(times: NDArray[np.float64], limits: Limits) -> str:
    """Return the probable cause and remedy for a batch whose times [s] span too much; empty if unknown."""
    if (likely := likely_time_unit(times)) is not None:
        return f": its times are probably in {likely}"
    if float(np.abs(np.diff(times)).max()) > limits.batch_span_s:
        return ": the robot's clock was set within it; end this session and begin another"
    return ""


def _check_values(batch: SampleBatch, cells: NDArray[np.floating[Any]], limits: Limits) -> None:
    """Raise ProtocolError for absurd values: in later sums their squares would exceed precision or range.

    cells: (n, columns); no array of this size is made.
    """
    sizes = np.maximum(cells.max(axis=0), -cells.min(axis=0))
    sizes[0] = 0.0  # time has its own limit
    column = int(sizes.argmax())
    if sizes[column] > limits.value:
        row = int(np.abs(cells[:, column]).argmax())
        where = f"sample {row} of batch {batch.seq}: {batch.columns[column]}"
        value = float(cells[row, column])
        raise ProtocolError("malformed", f"{where} is out of range", value=value, limit=limits.value)

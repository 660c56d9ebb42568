"""Encodes and decodes messages. A payload is a msgpack map; its encoding states the type and major version.

>>> encode(Close(session="s1", last_seq=7)).encoding
'application/msgpack;caesura.Close.v1'

The decoder checks size, version, type and the number of items before it unpacks (`payload_unpack_limits.py`).
Every refusal is a ProtocolError with the value and the limit. No payload can cause code to be executed.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple, TypeVar

import msgpack  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from caesura_protocol import messages
from caesura_protocol.columns import signal_columns
from caesura_protocol.errors import MAX_SHOWN, ProtocolError, printable
from caesura_protocol.messages import (
    MAX_MESSAGE_BYTES,
    Close,
    Error,
    Message,
    SampleBatch,
)
from caesura_protocol.msgpack_packer import Packing
from caesura_protocol.payload_unpack_limits import Bounds, bounds_of, unpacked

MAJOR_VERSION = 1
FLOAT_OF_SIZE: Mapping[int, np.dtype[Any]] = {4: np.dtype("<f4"), 8: np.dtype("<f8")}  # [bytes]
_ENCODING = re.compile(r"application/msgpack;caesura\.([A-Za-z]+)\.v([0-9]{1,4})")

#: Every type that may stand in an encoding.
MESSAGE_TYPES: Mapping[str, type[Message]] = {
    name: model
    for name, model in vars(messages).items()
    if isinstance(model, type) and issubclass(model, Message) and model not in {Message, messages.Result}
}

M = TypeVar("M", bound=Message)


class Encoded(NamedTuple):
    """A payload with the encoding that describes it."""

    payload: bytes
    encoding: str


def encode(message: Message, *, limit: int = MAX_MESSAGE_BYTES) -> Encoded:
    """Encode a message for the wire. Raises ProtocolError `too_large` over the limit [bytes]."""
    try:
        payload = _PACKING.pack(message.__dict__)
    except _HoldsPackedError:
        payload = _join_packed(message)
    check_size(payload, limit)
    return Encoded(payload, encoding_of(type(message)))


class PreEncoded(ABC):
    """A sequence of messages, some of which are stored as payloads of this codec.

    It replaces a tuple of them.
    """

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of messages."""

    @abstractmethod
    def parts(self) -> Iterable[bytes | Message]:
        """Return all messages in order; consecutive payloads are joined."""


class _HoldsPackedError(Exception):
    """A message contains pre-encoded messages, so that its payload must be joined."""


def _fields(message: object) -> dict[str, Any]:
    """Return the fields of a message within a message, without a copy of its tree.

    Raises _HoldsPackedError for pre-encoded messages, TypeError for a value of another type.
    """
    if isinstance(message, Message):
        return message.__dict__
    if isinstance(message, PreEncoded):
        raise _HoldsPackedError
    raise TypeError(f"{type(message).__name__} does not go over the wire")


_PACKING = Packing(_fields)


def _join_packed(message: Message) -> bytes:
    """Encode a message around packed parts: the bytes of one call, without unpacking the parts."""
    packer, done = msgpack.Packer(default=_fields, autoreset=False), list[bytes]()

    def add(value: object) -> None:
        if isinstance(value, PreEncoded):
            packer.pack_array_header(len(value))
            for part in value.parts():
                keep(part) if isinstance(part, bytes) else packer.pack(part)
        elif isinstance(value, Message) and _is_packed(value):
            packer.pack_map_header(len(value.__dict__))
            for name, field in value.__dict__.items():
                packer.pack(name)
                add(field)
        else:
            packer.pack(value)

    def keep(payloads: bytes) -> None:
        done.extend((packer.bytes(), payloads))
        packer.reset()

    add(message)
    keep(b"")
    return b"".join(done)


def _is_packed(value: object) -> bool:
    """Return whether a value is pre-encoded, or is a message with such a field at any depth."""
    if isinstance(value, Message):
        return any(map(_is_packed, value.__dict__.values()))
    return isinstance(value, PreEncoded)


@cache
def encoding_of(model: type[Message]) -> str:
    """Return the encoding of a type: `application/msgpack;caesura.{Type}.v1`."""
    return f"application/msgpack;caesura.{model.type_name()}.v{MAJOR_VERSION}"


def decode(payload: bytes, encoding: str, *expected: type[M], limit: int = MAX_MESSAGE_BYTES) -> M:
    """Decode the message in a payload, which must be one of the expected types.

    Raises ProtocolError: `too_large` over the limit [bytes], `unsupported_version` (names both versions) or
    `malformed` (names the field and its value).
    """
    check_size(payload, limit)
    model, bounds = _model_of(encoding, expected)
    fields = unpacked(payload, bounds)
    if not isinstance(fields, dict):
        raise ProtocolError("malformed", "not a map", value=type(fields).__name__, expected="map")
    try:
        message: M = model.__pydantic_validator__.validate_python(fields, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(printable(str(part)) for part in first["loc"]) or model.__name__
        why = f"{model.__name__}.{where}: {first['msg'].removeprefix('Value error, ')}"
        raise ProtocolError("malformed", why, value=first["input"]) from None
    return message


def is_other_version(error: ProtocolError) -> bool:
    """Return whether a message was refused for its major version, not for any other encoding."""
    return error.code == "unsupported_version" and isinstance(error.value, int)


def encode_error(error: ProtocolError) -> Encoded:
    """Encode a refusal for the wire."""
    return encode(
        Error(
            code=error.code,
            message=error.message[:MAX_SHOWN],
            value=error.value,
            limit=error.limit,
            expected=error.expected,
        )
    )


def decode_error(payload: bytes, encoding: str) -> ProtocolError:
    """Decode the refusal in a `reply_err` payload, to be raised or shown."""
    error = decode(payload, encoding, Error)
    return ProtocolError(
        error.code, error.message, value=error.value, limit=error.limit, expected=error.expected
    )


def pack_samples(
    matrix: NDArray[np.floating[Any]],
    columns: tuple[str, ...],
    *,
    session: str,
    epoch: int,
    seq: int,
    bridge: str | None = None,
) -> SampleBatch:
    """Pack a matrix (n, columns) into a batch, session time [s] in its first column.

    bridge: name of the sending bridge. Single precision is kept, and double precision exactly:
    `unpack_samples` returns the same times wherever a batch begins.
    """
    shifted = np.array(matrix, dtype=np.float32 if matrix.dtype == np.float32 else np.float64)
    times = matrix[:, 0].astype(np.float64)
    t0 = float(times[0])
    since = times - t0
    if shifted.dtype == np.float64 and (since + t0 != times).any():
        t0, since = 0.0, times
    shifted[:, 0] = since
    little = shifted.astype(shifted.dtype.newbyteorder("<"), copy=False)
    return SampleBatch(
        session=session,
        epoch=epoch,
        seq=seq,
        n=matrix.shape[0],
        columns=columns,
        t0=t0,
        samples=little.tobytes(),
        bridge=bridge,
    )


def unpack_samples(batch: SampleBatch) -> NDArray[np.float64]:
    """Unpack the matrix (n, columns) of a batch, session time [s] in its first column.

    Raises ProtocolError `malformed` for a wrong size, a first column other than `t`, or a value that is not
    finite, with its row and column.
    """
    cells = cells_of(batch)
    if not math.isfinite(np.vdot(cells, cells)):
        check_finite(batch, cells)
    times = _times_of(batch, cells)
    if not math.isfinite(np.vdot(times, times)):
        check_finite(batch, times[:, None])
    return _matrix_of(cells, times)


def check_finite(batch: SampleBatch, cells: NDArray[np.floating[Any]]) -> None:
    """Raise ProtocolError `malformed` for the first value of (n, columns) that is not finite."""
    finite = np.isfinite(cells)
    row, column = divmod(int(finite.argmin()), cells.shape[1])
    if not finite[row, column]:
        raise ProtocolError(
            "malformed",
            f"sample {row} of batch {batch.seq}: {batch.columns[column]} is not finite",
            value=str(cells[row, column]),
            expected="finite numbers",
        )


def matrix_of(batch: SampleBatch) -> NDArray[np.float64]:
    """Unpack as `unpack_samples` does, without a check of the values.

    Raises ProtocolError `malformed` for a wrong size, or a first column other than `t`.
    """
    cells = cells_of(batch)
    return _matrix_of(cells, _times_of(batch, cells))


def cells_of(batch: SampleBatch) -> NDArray[np.floating[Any]]:
    """Return the numbers of a batch as sent, (n, columns), without a copy.

    Raises ProtocolError `malformed`.
    """
    if batch.columns[0] != "t":
        raise ProtocolError("malformed", "first column is not t", value=batch.columns[0], expected="t")
    cells = batch.n * len(batch.columns)
    size, rest = divmod(len(batch.samples), cells)
    dtype = None if rest else FLOAT_OF_SIZE.get(size)
    if dtype is None:
        raise ProtocolError(
            "malformed",
            f"samples do not fit {batch.n} rows of {len(batch.columns)} columns",
            value=len(batch.samples),
            expected=[4 * cells, 8 * cells],
        )
    return np.frombuffer(batch.samples, dtype).reshape(batch.n, len(batch.columns))


def _times_of(batch: SampleBatch, cells: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return the session time [s] of every sample."""
    with np.errstate(over="ignore"):
        times: NDArray[np.float64] = cells[:, 0].astype(np.float64) + batch.t0
    return times


def _matrix_of(cells: NDArray[np.floating[Any]], times: NDArray[np.float64]) -> NDArray[np.float64]:
    matrix = cells.astype(np.float64)
    matrix[:, 0] = times
    return matrix


def signals_of(columns: Sequence[str], matrix: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the signals (n, c) in a matrix (n, columns) of samples; incomplete signals are left out."""
    place = {name: index for index, name in enumerate(columns)}
    return {
        signal: matrix[:, [place[name] for name in names]]
        for signal, names in signal_columns(columns).items()
    }


def check_size(payload: bytes, limit: int = MAX_MESSAGE_BYTES) -> None:
    """Raise ProtocolError `too_large` over the limit [bytes]."""
    if len(payload) > limit:
        raise ProtocolError("too_large", "message over the size limit", value=len(payload), limit=limit)


@lru_cache(maxsize=256)
def _model_of(encoding: str, expected: tuple[type[M], ...]) -> tuple[type[M], Bounds]:
    names = [model.type_name() for model in expected]
    match = _ENCODING.fullmatch(encoding)
    if match is None:
        raise ProtocolError(
            "unsupported_version", "unknown encoding", value=encoding[:100], expected=encoding_of(expected[0])
        )
    if int(match[2]) != MAJOR_VERSION:
        raise ProtocolError(
            "unsupported_version",
            f"{match[1]} has version {match[2]}, this peer speaks version {MAJOR_VERSION}",
            value=int(match[2]),
            expected=MAJOR_VERSION,
        )
    for model in expected:
        if model.type_name() == match[1]:
            return model, bounds_of(model)
    raise ProtocolError(
        "malformed", "a message type that is not accepted here", value=match[1], expected=names
    )


__all__ = [
    "MAJOR_VERSION",
    "MESSAGE_TYPES",
    "Close",
    "Encoded",
    "PreEncoded",
    "cells_of",
    "check_finite",
    "decode",
    "decode_error",
    "encode",
    "encode_error",
    "encoding_of",
    "is_other_version",
    "matrix_of",
    "pack_samples",
    "signals_of",
    "unpack_samples",
]

"""Limits on the size and structure of a payload by message type, checked before it is unpacked.

Each byte can be an item of msgpack, and each item an object and a validation error. Without a check, a
megabyte of them blocks the interpreter for seconds and uses a gigabyte. So messages of a station may have few
items, which are counted first, without unpacking them. Bytes that are not binary are limited as well, because
one wide character makes a text four times as long. Refusing any message of `tests/bench/refusal_cost.py`
takes less than a millisecond, and less than a megabyte besides the payload.

Results may be as long as a demonstration. They are unpacked only if all of their bytes are present, because
an array is allocated by the length in its header. They may have at most as many containers as a valid one of
their length, and validation ends at the first error. So refusing one costs no more than reading one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import count
from typing import Any, NamedTuple

import msgpack  # type: ignore[import-untyped]

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_BATCH_SAMPLES,
    MAX_COLUMNS,
    MAX_GAPS,
    MAX_WHOLE_BYTES,
    PIECE_BYTES,
    Ack,
    BridgeAck,
    BridgeControl,
    BridgeStatus,
    Close,
    Control,
    Describe,
    Edit,
    EditProgram,
    Error,
    Heartbeat,
    Message,
    Open,
    Piece,
    Preview,
    SampleBatch,
    ServiceStatus,
    SessionStatus,
)

HEADER_BYTES = 1 << 14  # of a message without its samples
COMMAND_BYTES = 1 << 15  # of a command: a description before and after takes 18 kB at most
SHORT = 512  # [bytes] too short for its headers to claim a megabyte
PER_CONTAINER = 16  # [bytes] of a result, at least: a gap takes 30
TEXT_BYTES = 1 << 13  # of a string, where items are counted
_ARRAYS = frozenset({*range(0x90, 0xA0), 0xDC, 0xDD})  # first bytes, by the specification of msgpack
_MAPS = frozenset({*range(0x80, 0x90), 0xDE, 0xDF})
_BINS = frozenset({0xC4, 0xC5, 0xC6})


class Bounds(NamedTuple):
    """Size and count limits of the payloads of one type."""

    size: int  # [bytes]
    items: int | None = None  # containers, keys and values, at any depth; None: as many as fit
    array: int = MAX_GAPS  # items of one array or map, where items are counted
    uncounted: int = SHORT  # [bytes] up to which it is unpacked at once
    header: int = MAX_WHOLE_BYTES  # [bytes] of what is not binary


_BATCH_BYTES = HEADER_BYTES + 8 * MAX_BATCH_SAMPLES * MAX_COLUMNS
_COMMAND = Bounds(COMMAND_BYTES, 256)
_STATUS = Bounds(1 << 16, 10 * MAX_GAPS)
_LONG = Bounds(MAX_WHOLE_BYTES)

#: Every type that is bounded by more than what a result may be.
BOUNDS: Mapping[type[Message], Bounds] = {
    # The usual batch is not counted: with arrays of 64, what fits into 8 KiB takes less than a megabyte.
    SampleBatch: Bounds(_BATCH_BYTES, 256, array=MAX_COLUMNS, uncounted=1 << 13, header=HEADER_BYTES),
    **dict.fromkeys((Heartbeat, Open, Close, Edit, Preview, Describe, EditProgram, Control), _COMMAND),
    **dict.fromkeys((BridgeControl, BridgeAck, BridgeStatus), _COMMAND),
    Error: Bounds(1 << 16, 512),
    Piece: Bounds(HEADER_BYTES + PIECE_BYTES, 64, header=HEADER_BYTES),
    **dict.fromkeys((Ack, SessionStatus, ServiceStatus), _STATUS),
}


def bounds_of(model: type[Message]) -> Bounds:
    """Return the limits for payloads of this type."""
    return BOUNDS.get(model, _LONG)


def unpacked(payload: bytes, bounds: Bounds) -> Any:
    """Unpack a payload, arrays as tuples. Raises ProtocolError `too_large` or `malformed`."""
    if len(payload) > bounds.size:
        why = "message over the size limit of its type"
        raise ProtocolError("too_large", why, value=len(payload), limit=bounds.size)
    try:
        if len(payload) > bounds.uncounted:
            _check_items(payload, bounds)
        if bounds.items is None:
            return _unpacked_long(payload)
        return msgpack.unpackb(
            payload,
            use_list=False,
            strict_map_key=True,
            max_array_len=bounds.array,
            max_map_len=bounds.array,
            max_str_len=TEXT_BYTES,
            max_ext_len=0,
            ext_hook=_no_extension,
        )
    except (ValueError, IndexError, msgpack.UnpackException, RecursionError) as error:
        why = f"not msgpack: {str(error) or type(error).__name__}"
        raise ProtocolError("malformed", why, value=payload[:16]) from None


def _unpacked_long(payload: bytes) -> Any:
    """Unpack the payload of a result, with a limit on containers that follows from its length."""
    counting = _counting(SHORT + len(payload) // PER_CONTAINER)
    return msgpack.unpackb(
        payload,
        use_list=False,
        strict_map_key=True,
        max_ext_len=0,
        ext_hook=_no_extension,
        list_hook=counting,
        object_hook=counting,
    )


def _no_extension(code: int, _: bytes) -> None:
    """Refuse a msgpack extension: no message has one, and they would not be counted."""
    raise ProtocolError("malformed", "an extension", value=code)


def _counting(limit: int) -> Callable[[Any], Any]:
    """Return a hook that counts unpacked containers. Raises ProtocolError `malformed` past the limit."""
    containers = count(1)

    def count_items(container: Any) -> Any:
        if next(containers) > limit:
            raise ProtocolError("malformed", "too many containers for its size", limit=limit)
        return container

    return count_items


def _check_items(payload: bytes, bounds: Bounds) -> None:
    """Count the items of a payload without unpacking them.

    Raises ProtocolError `malformed` at a header over the limits; ValueError, IndexError or UnpackException if
    the payload is not msgpack, or incomplete.
    """
    size = len(payload)
    unpacker = msgpack.Unpacker(max_buffer_size=size, read_size=size)
    unpacker.feed(payload)
    if bounds.items is None:
        unpacker.skip()
        return
    left = items = 1
    binary = 0
    while left:
        place = unpacker.tell()
        head, more = payload[place], 0
        if head in _ARRAYS:
            more = unpacker.read_array_header()
        elif head in _MAPS:
            more = 2 * unpacker.read_map_header()
        else:
            unpacker.skip()
        if head in _BINS:
            binary += unpacker.tell() - place
        left += more - 1
        items += more
        if items > bounds.items:
            raise ProtocolError("malformed", "too many items", value=items, limit=bounds.items)
    if size - binary > bounds.header:
        why = "too many bytes that are not binary"
        raise ProtocolError("too_large", why, value=size - binary, limit=bounds.header)

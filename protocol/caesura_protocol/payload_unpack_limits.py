"""Limits on the size and structure of a payload by message type, checked before it is unpacked.

Each byte can be an item of msgpack, and each item an object and a validation error. Without a check, a
megabyte of them blocks the interpreter for seconds and uses a gigabyte. So messages of a station may have few
items, which are counted first, without unpacking them. Bytes that are not binary are limited as well, because
one wide character makes a text four times as long. Refusing any message of `tests/bench/refusal_cost.py`
takes less than a millisecond, and less than a megabyte besides the payload.

Changepoints, segments, programs and snapshots may be as long as a demonstration. They are unpacked only if
all of their bytes are present, because an array is allocated by the length in its header. They may have at
most as many containers and items as a valid one of their length, and validation ends at the first error. So
refusing one costs at most three times as much as reading a valid one of its length, in time and in memory.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgpack  # type: ignore[import-untyped]

from caesura_protocol import messages
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_BATCH_SAMPLES,
    MAX_COLUMNS,
    MAX_GAPS,
    MAX_HINTS,
    MAX_HOLES,
    MAX_STARTS,
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
    Hints,
    Message,
    Open,
    Piece,
    Posterior,
    Preview,
    RecordedSamples,
    SampleBatch,
    ServiceStatus,
    SessionStatus,
)

HEADER_BYTES = 1 << 14  # of a message without its samples
COMMAND_BYTES = 1 << 15  # of a command: a description before and after takes 18 kB at most
SHORT = 512  # [bytes] too short for its headers to claim a megabyte
PER_CONTAINER = 16  # [bytes] of a result, at least: a gap takes 30
PER_ITEM = 3  # [bytes] of a result, at least: the shortest items are indices of segments, most of three bytes
MORE_NAMES = 256  # that a result may have: fields of a newer peer. Unpacking many names takes longest of all
NAMES = frozenset(
    name
    for model in vars(messages).values()
    if isinstance(model, type) and issubclass(model, Message)
    for name in model.model_fields
)
TEXT_BYTES = 1 << 13  # of a string, where items are counted
_ARRAYS = frozenset({*range(0x90, 0xA0), 0xDC, 0xDD})  # first bytes, by the specification of msgpack
_MAPS = frozenset({*range(0x80, 0x90), 0xDE, 0xDF})
_BINS = frozenset({0xC4, 0xC5, 0xC6})
_ONE_BYTE_ITEMS = re.compile(rb"[\x00-\x80\x90\xa0\xc0\xc2\xc3\xe0-\xff]+")  # such as small numbers


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
    Posterior: Bounds(1 << 16, 2 * MAX_STARTS + 64, array=MAX_STARTS),
    Hints: Bounds(1 << 17, 32 * MAX_HINTS),  # twice the fields of today
    RecordedSamples: Bounds(
        MAX_WHOLE_BYTES, 8 * MAX_HOLES + 512, array=MAX_HOLES, uncounted=1 << 12, header=1 << 17
    ),
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
    """Unpack the payload of a result, with limits on containers and items that follow from its length."""
    most_items = SHORT + len(payload) // PER_ITEM
    count_array, count_map = _counting(SHORT + len(payload) // PER_CONTAINER, most_items)
    return msgpack.unpackb(
        payload,
        use_list=False,
        strict_map_key=True,
        max_array_len=most_items,
        max_map_len=len(NAMES) + MORE_NAMES,
        max_ext_len=0,
        ext_hook=_no_extension,
        list_hook=count_array,
        object_hook=count_map,
    )


def _no_extension(code: int, _: bytes) -> None:
    """Refuse a msgpack extension: no message has one, and they would not be counted."""
    raise ProtocolError("malformed", "an extension", value=code)


def _counting(most: int, most_items: int) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Return the hooks for arrays and maps that count containers, their items, and unknown names.

    They raise ProtocolError `malformed` past a limit.
    """
    containers = items = 0
    unknown: set[str] = set()

    def count_array(container: Any) -> Any:
        nonlocal containers, items
        containers += 1
        items += len(container)
        if containers > most or items > most_items:
            limit = most if containers > most else most_items
            raise ProtocolError("malformed", "too many items for its size", limit=limit)
        return container

    def count_map(container: Any) -> Any:
        if not container.keys() <= NAMES:
            unknown.update(container.keys() - NAMES)
            if len(unknown) > MORE_NAMES:
                raise ProtocolError("malformed", "too many unknown names", limit=MORE_NAMES)
        return count_array(container)

    return count_array, count_map


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
        if short := _ONE_BYTE_ITEMS.match(payload, place):
            left -= len(unpacker.read_bytes(min(short.end() - place, left)))
            continue
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

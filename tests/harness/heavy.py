"""Messages that cost whoever reads them as much as can be, for their bytes."""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

import msgpack
import numpy as np

from caesura_protocol.codec import decode, encode_error, encoding_of, unpack_samples
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import (
    MAX_BATCH_SAMPLES,
    MAX_COLUMNS,
    MAX_MESSAGE_BYTES,
    Ack,
    BridgeAck,
    BridgeControl,
    BridgeStatus,
    Control,
    Error,
    Heartbeat,
    Hints,
    Message,
    Piece,
    Posterior,
    SampleBatch,
    ServiceStatus,
    SessionStatus,
)
from caesura_protocol.payload_unpack_limits import TEXT_BYTES

# What a station can send to anybody, and what is answered to a query of its.
OF_STATIONS: tuple[type[Message], ...] = (
    *(SampleBatch, Heartbeat, Control, Error, Ack),
    *(BridgeControl, BridgeAck, BridgeStatus),
)
OF_SERVICES: tuple[type[Message], ...] = (SessionStatus, ServiceStatus, Piece, Posterior, Hints)
BOUNDED = OF_STATIONS + OF_SERVICES

HEAD = {"session": "s1", "epoch": 0, "seq": 0}
OPENING = {"type": "open", "session": "s1", "columns": ["t", "px"]}

# What a payload is filled with: short pieces of msgpack, each of them whole.
FILLINGS: Mapping[str, bytes] = {
    "numbers": b"\x01",
    "long numbers": b"\xcf" + b"\x7f" * 8,
    "floats": b"\xcb" + b"\x01" * 8,
    "nothing": b"\xc0",
    "empty arrays": b"\x90",
    "empty maps": b"\x80",
    "maps of one": b"\x81\xa1a\x01",
    "arrays of one": b"\x91\x01",
    "arrays of three": b"\x93\x01\x02\x03",
    "short texts": b"\xa2\xc3\xa4",
    "short bins": b"\xc4\x02ab",
    "arrays of 64": b"\xdc\x00\x40" + b"\x01" * 64,
    "arrays of 64 maps": b"\xdc\x00\x40" + b"\x80" * 64,
    "empty extensions": b"\xc7\x00\x05",
    "timestamps": b"\xd6\xff" + bytes(4),
}
NESTS: Mapping[str, bytes] = {
    "nested arrays": b"\x91",
    "nested maps": b"\x81\xa1a",
    "arrays that claim 60": b"\xdc\x00\x3c",
    "arrays that claim 4000": b"\xdc\x0f\xa0",
    "arrays that claim a million": b"\xdd\x00\x0f\x42\x40",
    "maps that claim 4000": b"\xde\x0f\xa0\xa1a",
}
SIZES = (400, 1000, 4000, 8000, 16_000, 30_000, 60_000, 500_000, 520_000, MAX_MESSAGE_BYTES - 100)


def array_of(filling: bytes, size: int) -> bytes:
    """An array that takes so many bytes."""
    count = max(1, size // len(filling))
    return b"\xdd" + count.to_bytes(4, "big") + filling * count


def nest_of(header: bytes, size: int, depth: int) -> bytes:
    """Containers within each other, as many bytes as that is; filled up with numbers."""
    return header * depth + b"\x01" * max(1, size - depth * len(header))


def message_with(fields: Mapping[str, object], name: str, value: bytes) -> bytes:
    """A map of these fields, and one more that is msgpack already, in the place of its own."""
    kept = {key: one for key, one in fields.items() if key != name}
    packed = b"".join(map(msgpack.packb, (part for field in kept.items() for part in field)))
    return bytes([0x80 + len(kept) + 1]) + packed + msgpack.packb(name) + value


def bin_of(size: int) -> bytes:
    """Binary data that takes so many bytes."""
    return b"\xc6" + max(0, size - 5).to_bytes(4, "big") + bytes(max(0, size - 5))


def text_of(size: int) -> bytes:
    """A text that takes so many bytes, four times as many as an object: its last character is wide."""
    text = ("x" * max(0, size - 9) + "\N{SMILING FACE WITH SUNGLASSES}").encode()
    return b"\xdb" + len(text).to_bytes(4, "big") + text


def long_values(size: int) -> Iterator[tuple[str, bytes]]:
    """A few long values within a container: items do not count them."""
    whole = bin_of(size)
    yield f"a bin of {size} bytes within an array", b"\x91" + whole
    yield f"a bin of {size} bytes within a map", b"\x81\xa1a" + whole
    yield f"a bin of {size} bytes within two maps", b"\x81\xa1a\x81\xa1a" + whole
    yield f"a bin of {size} bytes for a key", b"\x81" + whole + b"\x01"
    yield f"an extension of {size} bytes", b"\x91\xc9" + size.to_bytes(4, "big") + b"\x05" + bytes(size)
    yield f"six bins, {size} bytes", b"\x96" + 6 * bin_of(size // 6)
    for count in (4, 15, 60):
        part = min(size // count, TEXT_BYTES)
        many = b"\xdc" + count.to_bytes(2, "big")
        yield f"{count} texts of {part} bytes", many + count * text_of(part)
        keys = b"".join(bin_of(size // count)[:-1] + bytes([number]) + b"\x01" for number in range(count))
        yield f"{count} long keys, {size} bytes", b"\xde" + count.to_bytes(2, "big") + keys


def heavy_values(sizes: tuple[int, ...] = SIZES) -> Iterator[tuple[str, bytes]]:
    """(what it is, a value of about that size) of every kind."""
    for size in sizes:
        for name, filling in FILLINGS.items():
            yield f"{size} bytes of {name}", array_of(filling, size)
        for name, header in NESTS.items():
            for depth in (30, 500, 1000, 2000):
                yield f"{size} bytes, {name}, {depth} deep", nest_of(header, size, depth)
        yield f"a text of {size} bytes", text_of(size)
        yield f"a bin of {size} bytes", bin_of(size)
        yield from long_values(size)
        yield f"{size} bytes that are not there", b"\xc6\x00\x20\x00\x00" + bytes(size)


def full_batches(*values: float) -> Iterator[tuple[str, bytes]]:
    """(what it is, payload) of batches that are as large as they may be, and are refused once unpacked."""
    columns = ["t", *(f"c{number}" for number in range(1, MAX_COLUMNS))]
    head = {**HEAD, "n": MAX_BATCH_SAMPLES, "columns": columns}
    for kind, value in product(("f4", "f8"), values):
        samples = np.full((MAX_BATCH_SAMPLES, MAX_COLUMNS), value, kind).tobytes()
        yield f"a full batch of {value}, {kind}", msgpack.packb({**head, "t0": 0.0, "samples": samples})
    samples = np.full((MAX_BATCH_SAMPLES, MAX_COLUMNS), 1e308).tobytes()
    yield "times beyond all numbers", msgpack.packb({**head, "t0": 1e308, "samples": samples})


def heavy_messages(model: type[Message], sizes: tuple[int, ...] = SIZES) -> Iterator[tuple[str, bytes]]:
    """(what it is, payload) with every heavy value in every place of a message of that type."""
    batch = {**HEAD, "n": 1, "columns": ["t", "px"], "t0": 0.0, "samples": bytes(16)}
    whole: Mapping[type[Message], Mapping[str, object]] = {
        SampleBatch: batch,
        Heartbeat: HEAD,
        Ack: {"session": "s1", "next_seq": 0, "state": "open"},
        Error: {"code": "malformed", "message": "no"},
        Piece: {"encoding": "x", "whole": 1, "number": 0, "count": 2, "payload": b""},
    }
    fields = whole.get(model, {"station": "cell-1"})
    places = [*fields, *(name for name in model.model_fields if name not in fields), "unheard-of"]
    if model is SampleBatch:
        yield from full_batches(math.nan, math.inf)
    for what, value in heavy_values(sizes):
        yield what, value
        for place in places:
            yield f"{place}: {what}", message_with(fields, place, value)
        if model is Control:
            for place in ("columns", "type", "wrench_source", "preset", "unheard-of"):
                command = message_with(OPENING, place, value)
                yield f"command.{place}: {what}", message_with({}, "command", command)


def distinct_keys(size: int, keys: int = 64) -> bytes:
    """An array of maps of so many bytes, in which no key comes twice."""
    entries = [b"\xa5" + b"%05d" % number + b"\xc0" for number in range(size // 7)]
    maps = [entries[first : first + keys] for first in range(0, len(entries) - keys, keys)]
    return b"\xdd" + len(maps).to_bytes(4, "big") + b"".join(map(_map_of, maps))


def _map_of(entries: list[bytes]) -> bytes:
    return b"\xde" + len(entries).to_bytes(2, "big") + b"".join(entries)


def places_in(value: object, above: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Every place in a tree of maps and arrays, of an array the first item."""
    if isinstance(value, dict):
        items: Iterator[tuple[str | int, object]] = iter(value.items())
    else:
        items = iter(enumerate(value[:1] if isinstance(value, list) else []))
    for name, below in items:
        yield (*above, name)
        yield from places_in(below, (*above, name))


def with_value(tree: object, place: tuple[str | int, ...], value: bytes) -> bytes:
    """The payload of a tree with msgpack in one place of it."""
    if not place:
        return value
    first, rest = place[0], place[1:]
    if isinstance(tree, dict):
        parts = [
            msgpack.packb(name) + (with_value(one, rest, value) if name == first else msgpack.packb(one))
            for name, one in tree.items()
        ]
        return b"\xde" + len(parts).to_bytes(2, "big") + b"".join(parts)
    assert isinstance(tree, list)
    parts = [with_value(one, rest, value) if n == first else msgpack.packb(one) for n, one in enumerate(tree)]
    return b"\xdd" + len(parts).to_bytes(4, "big") + b"".join(parts)


class Cost(NamedTuple):
    """Of reading one message, with what is said of it."""

    seconds: float
    bytes: int  # at most at once, beside the payload
    refused: bool


def refusal_of(payload: bytes, model: type[Message]) -> ProtocolError | None:
    """Read it as its receiver does, and word the refusal."""
    try:
        message = decode(payload, encoding_of(model), model)
        if isinstance(message, SampleBatch):
            unpack_samples(message)
    except ProtocolError as error:
        str(error)
        encode_error(error)
        return error
    return None


def read(payload: bytes, model: type[Message]) -> bool:
    """Was it refused?"""
    return refusal_of(payload, model) is not None


def seconds_of(payload: bytes, model: type[Message], tries: int) -> float:
    """The least time of some tries to read it, for others use the processor too; inf without tries."""
    seconds = [math.inf]
    for _ in range(tries):
        began = time.perf_counter()
        read(payload, model)
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def cost_of(payload: bytes, model: type[Message], tries: int = 5) -> Cost:
    """The least time of some tries; memory is counted in one more.

    Without tries it is the time of the latter, which is longer.
    """
    seconds = seconds_of(payload, model, tries)
    tracemalloc.start()
    try:
        began = time.perf_counter()
        refused = read(payload, model)
        counted = time.perf_counter() - began
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return Cost(seconds if tries else counted, peak, refused)

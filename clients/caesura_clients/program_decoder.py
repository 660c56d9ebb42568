"""Decodes the versions of a program; apps whose bytes did not change are not decoded again.

A program is published whole at each version. During a demonstration most of its apps equal those of the
version before. A program of 2000 apps has 2 MB, and decoding all of them takes a tenth of a second. So the
payload is cut at the first byte that differs. The rest is decoded like any other message, with the same
checks.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import msgpack  # type: ignore[import-untyped]

from caesura_protocol.codec import decode, encoding_of
from caesura_protocol.messages import MAX_WHOLE_BYTES, App, Program
from caesura_protocol.payload_unpack_limits import PER_CONTAINER

APPS = "apps"
BLOCK = 4096  # bytes that are compared at once
MOST_NAME = 64  # [bytes] of a field's name, or of a newer peer's
ONLY_NAMES = {
    "max_str_len": MOST_NAME,
    **dict.fromkeys((f"max_{kind}_len" for kind in ("array", "map", "bin", "ext")), 0),
}


class ProgramDecoder:
    """Decodes the programs of one station, version after version."""

    def __init__(self) -> None:
        self._list = b""  # the apps of the version before, as they were sent
        self._ends: Sequence[int] = ()  # of each app in it
        self._apps: tuple[App, ...] = ()

    def decode(self, payload: bytes) -> Program:
        """Return the program in a payload. Raises ProtocolError as the codec does."""
        encoding = encoding_of(Program)
        try:
            program, begin, ends = self._decoded(payload, encoding)
        except (ValueError, msgpack.UnpackException):  # no such map: the codec names what is wrong
            self._list, self._ends, self._apps = b"", (), ()
            return decode(payload, encoding, Program, limit=MAX_WHOLE_BYTES)
        self._list = payload[begin : begin + ends[-1]] if ends else b""
        self._ends, self._apps = ends, program.apps
        return program

    def _decoded(self, payload: bytes, encoding: str) -> tuple[Program, int, Sequence[int]]:
        """Return the program, the offset of its first app, and the end of each app relative to it [bytes]."""
        header, begin, count = _apps_of(payload)
        known = min(bisect_right(self._ends, common_bytes(self._list, payload[begin:])), count)
        ends = [*self._ends[:known]]
        fresh = begin + (ends[-1] if ends else 0)
        following = _ends(payload, fresh, count - known)
        ends += [end - begin for end in following]
        stop = following[-1] if following else fresh
        short = payload[:header] + msgpack.Packer().pack_array_header(count - known) + payload[fresh:stop]
        program = decode(short + payload[stop:], encoding, Program, limit=MAX_WHOLE_BYTES)
        return program.model_copy(update={APPS: (*self._apps[:known], *program.apps)}), begin, ends


def _apps_of(payload: bytes) -> tuple[int, int, int]:
    """Return the offsets [bytes] of the list of apps and of its first app, and the number of apps.

    Raises ValueError if there is no such list.
    """
    unpacker = msgpack.Unpacker(max_buffer_size=MAX_WHOLE_BYTES, **ONLY_NAMES)
    unpacker.feed(payload)
    for _ in range(unpacker.read_map_header()):
        if unpacker.unpack() == APPS:
            header = unpacker.tell()
            count = unpacker.read_array_header()
            if count * PER_CONTAINER > len(payload):
                break  # these are no apps: the codec stops at the first of them
            return header, unpacker.tell(), count
        unpacker.skip()
    raise ValueError("no apps")


def _ends(payload: bytes, begin: int, count: int) -> list[int]:
    """Return the ends [bytes] of `count` consecutive values, the first of which begins at `begin` [bytes]."""
    unpacker = msgpack.Unpacker(max_buffer_size=MAX_WHOLE_BYTES)
    unpacker.feed(memoryview(payload)[begin:])
    ends = []
    for _ in range(count):
        unpacker.skip()
        ends.append(begin + unpacker.tell())
    return ends


def common_bytes(before: bytes, after: bytes) -> int:
    """Return the length of the common prefix [bytes].

    >>> common_bytes(b"caesura", b"caesar")
    5
    """
    most = min(len(before), len(after))
    first = 0
    while first < most and before[first : first + BLOCK] == after[first : first + BLOCK]:
        first += BLOCK
    stop = min(first + BLOCK, most)
    return next((at for at in range(min(first, most), stop) if before[at] != after[at]), stop)

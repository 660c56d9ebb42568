"""A checksum of every row, which detects flipped bits.

SQLite checks the structure of a file and not what is in it: a bit that flips in a payload comes back as
another sample, or as another correction. A row without a checksum is one of a journal before version 4, and
is read as it is.
"""

from __future__ import annotations

import zlib

from caesura_protocol.packing import Packing

Value = int | float | str | bytes | None

_PACKING = Packing()


def checksum(*values: Value) -> int:
    """CRC-32 of the values of a row, types and boundaries included."""
    return zlib.crc32(_PACKING.pack(values))


def is_intact(crc: int | None, *values: Value) -> bool:
    """Whether a row has its checksum, or none at all."""
    return crc is None or crc == checksum(*values)

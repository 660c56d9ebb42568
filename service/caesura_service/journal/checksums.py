"""A checksum of every row, which detects flipped bits.

SQLite checks the structure of a file and not its content: a flipped bit in a payload would be read as another
sample or correction. A row without a checksum was written before version 4 of the journal, and is read
without a check.
"""

from __future__ import annotations

import zlib

from caesura_protocol.msgpack_packer import Packing

Value = int | float | str | bytes | None

_PACKING = Packing()


def checksum(*values: Value) -> int:
    """Return the CRC-32 of the values of a row, types and boundaries included."""
    return zlib.crc32(_PACKING.pack(values))


def is_intact(crc: int | None, *values: Value) -> bool:
    """Return whether a row matches its checksum, or has none."""
    return crc is None or crc == checksum(*values)

"""Decodes stored messages, also those whose names a new command may not have.

Which characters a name may have has become stricter. A session with an older name is read all the same, with
a space in place of each character that is refused now.
"""

from __future__ import annotations

from typing import Any, TypeVar

import msgpack  # type: ignore[import-untyped]

from caesura_protocol.codec import decode
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import MAX_MESSAGE_BYTES, Message, as_line

M = TypeVar("M", bound=Message)


def decode_stored(payload: bytes, encoding: str, *expected: type[M], limit: int = MAX_MESSAGE_BYTES) -> M:
    """Decode a stored message. Raises ProtocolError as `decode`, except for characters of a text."""
    try:
        return decode(payload, encoding, *expected, limit=limit)
    except ProtocolError as error:
        if error.code != "malformed":
            raise
        try:
            lines = msgpack.packb(_with_lines(msgpack.unpackb(payload, use_list=False)))
            return decode(lines, encoding, *expected, limit=limit)
        except (ProtocolError, ValueError, msgpack.UnpackException):
            raise error from None


def _with_lines(value: Any) -> Any:
    """Return a value whose texts, at any depth, are lines."""
    if isinstance(value, str):
        return as_line(value)
    if isinstance(value, dict):
        return {key: _with_lines(one) for key, one in value.items()}
    return tuple(map(_with_lines, value)) if isinstance(value, tuple) else value

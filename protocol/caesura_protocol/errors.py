"""The errors that a peer can receive. One table; a code that is not in it does not go on the wire."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from numbers import Number
from pathlib import PurePath
from reprlib import Repr
from typing import Any, Literal, get_args

MAX_MESSAGE = 1000  # characters of a message, and of an error in words: readers take texts of 8 KiB
MAX_SHOWN = 200  # characters of a value
MAX_LISTED = 64  # values of a list
NONE_THERE = "none is there"  # expected, of a refusal without alternatives

ErrorCode = Literal[
    "malformed",  # not a message, or a field is wrong
    "unsupported_version",  # another major version, or an unknown type
    "unknown_session",  # the session is not open here
    "evicted",  # asked for samples that the ring no longer has
    "too_large",  # over a size limit
    "forbidden",  # not allowed for this station or role
    "conflict",  # the session or version has moved on
    "overloaded",  # refused before anything was dropped; try again
    "internal",  # an error of the one who was asked; try again
]
ERROR_CODES: tuple[ErrorCode, ...] = get_args(ErrorCode)


class ProtocolError(Exception):
    """A peer's message was refused; names the offending value and the limit.

    value: what was found; limit: the bound it broke; expected: the valid alternatives; each may be None. A
    peer may have chosen all of them and part of the message: they are cut, and the message stays on one line.
    """

    def __init__(
        self, code: ErrorCode, message: str, *, value: Any = None, limit: Any = None, expected: Any = None
    ) -> None:
        self.code: ErrorCode = code
        self.message = printable(message, MAX_MESSAGE)
        self.value = shown(value)
        self.limit = shown(limit)
        self.expected = shown(expected)
        super().__init__(self.message)

    def __str__(self) -> str:
        parts = [f"{self.code}: {self.message}"]
        parts += [
            f"{name} {value!r}"
            for name, value in (("value", self.value), ("limit", self.limit), ("expected", self.expected))
            if value is not None
        ]
        return "; ".join(parts)[:MAX_MESSAGE]


def shown(value: Any) -> Any:
    """A value cut down to what an error may carry, and to what msgpack can."""
    if isinstance(value, list):
        return [_glimpse(item) for item in value[:MAX_LISTED]]
    if isinstance(value, tuple):
        return tuple(map(_glimpse, value[:MAX_LISTED]))
    return _glimpse(value)


def printable(text: str, most: int = MAX_SHOWN) -> str:
    r"""The beginning of a text, on one line.

    >>> printable("no such thing\nERROR: all is lost", 20)
    'no such thing\\nERROR'
    """
    cut = text[:most]
    return cut if cut.isprintable() else repr(cut)[1:-1][:most]


class _Glance(Repr):
    """Text of the first items of a container, and of the beginning of each; of other values the type."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 2

    def repr_bytes(self, value: bytes | bytearray | memoryview, level: int) -> str:
        return repr(bytes(value[: self.maxstring]))[: self.maxstring]

    repr_bytearray = repr_memoryview = repr_bytes

    def repr_int(self, value: int, level: int) -> str:
        return str(_shown_integer(value))

    def repr_dict(self, value: Mapping[Any, Any], level: int) -> str:
        """Return the text of a map in its own order: the base class sorts all keys."""
        if level <= 0 or not value:
            return "{...}" if value else "{}"
        pairs = [
            f"{self.repr1(key, level - 1)}: {self.repr1(item, level - 1)}"
            for key, item in islice(value.items(), self.maxdict)
        ]
        return f"{{{', '.join(pairs + ['...'] * (len(value) > self.maxdict))}}}"

    def repr_instance(self, value: object, level: int) -> str:
        if value is None or isinstance(value, Number | PurePath):
            return super().repr_instance(value, level)
        return f"<{type(value).__name__}>"


_glance = _Glance()


def _shown_integer(value: int) -> int | str:
    """Return an integer for which msgpack has room as it is, else text with its number of bits."""
    return value if -(1 << 63) <= value < 1 << 64 else f"an integer of {value.bit_length()} bits"


def _glimpse(value: Any) -> Any:
    if isinstance(value, int):
        return _shown_integer(value)
    if value is None or isinstance(value, float):
        return value
    if isinstance(value, bytes | bytearray | memoryview):
        return value[:32].hex()
    return (value if isinstance(value, str) else _glance.repr(value))[:MAX_SHOWN]


class CaesuraError(Exception):
    """Something a user can act on; the message is one line and names what was found and what would do."""


class Unreachable(CaesuraError):  # noqa: N818 - a state, and it reads better where it is caught
    """No answer: there is no router at the endpoint, or no service behind it."""


class AccessDenied(Unreachable):
    """A router refuses the credentials, which waiting does not change."""


class NotFound(CaesuraError):  # noqa: N818
    """A station or session that was asked for is not there; the message names those that are."""


class SourceError(CaesuraError):
    """A source delivered what cannot be sent: wrong shape, a value that is not finite, an unknown name."""

"""The errors that a peer can receive, as one table. A code that is not in it is never sent."""

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
    """A peer's message was refused; the error states the offending value and the limit.

    value: the offending value; limit: the violated bound; expected: the valid alternatives; each may be None.
    All of them, and a part of the message, may be chosen by a peer: they are cut, and the message stays on
    one line.
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
    """Return a value reduced to a size that an error may carry, and to types that msgpack supports."""
    if isinstance(value, list):
        return [_glimpse(item) for item in value[:MAX_LISTED]]
    if isinstance(value, tuple):
        return tuple(map(_glimpse, value[:MAX_LISTED]))
    return _glimpse(value)


def printable(text: str, most: int = MAX_SHOWN) -> str:
    r"""Return the beginning of a text, on one line.

    >>> printable("no such thing\nERROR: all is lost", 20)
    'no such thing\\nERROR'
    """
    cut = text[:most]
    return cut if cut.isprintable() else repr(cut)[1:-1][:most]


class _Glance(Repr):
    """Text of the first items of a container, and of their beginnings; for other values the type."""

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
    """Return an integer within msgpack's range unchanged, otherwise a text with its number of bits."""
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
    """An error on which a user can act; the message is one line with the found and the expected value."""


class Unreachable(CaesuraError):  # noqa: N818 - a state, and it reads better where it is caught
    """No answer: no router at the endpoint, or no service connected to it."""


class AccessDenied(Unreachable):
    """A router rejects the credentials; waiting does not change that."""


class NotFound(CaesuraError):  # noqa: N818
    """A requested station or session does not exist; the message lists the existing ones."""


class SourceError(CaesuraError):
    """A source delivered invalid data: a wrong shape, a value that is not finite, or an unknown name."""

"""The errors that a peer can receive. One table; a code that is not in it does not go on the wire."""

from __future__ import annotations

from typing import Any, Literal, get_args

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

    value: what was found; limit: the bound it broke; expected: the valid alternatives; each may be None.
    """

    def __init__(
        self, code: ErrorCode, message: str, *, value: Any = None, limit: Any = None, expected: Any = None
    ) -> None:
        super().__init__(message)
        self.code: ErrorCode = code
        self.message = message
        self.value = value
        self.limit = limit
        self.expected = expected

    def __str__(self) -> str:
        parts = [f"{self.code}: {self.message}"]
        parts += [
            f"{name} {value!r}"
            for name, value in (("value", self.value), ("limit", self.limit), ("expected", self.expected))
            if value is not None
        ]
        return "; ".join(parts)

"""Converts errors of the journal to refusals of the protocol."""

from __future__ import annotations

from types import TracebackType

from caesura_protocol.errors import ProtocolError
from caesura_service.journal import JournalError, JournalShareError, JournalSupersededError


class JournalErrorsAsOverloaded:
    """Raises a JournalError of its context as a ProtocolError `overloaded`: bridges try again.

    JournalSupersededError passes unchanged: that another instance owns the station concerns no session.
    """

    def __enter__(self) -> None:
        """Enter the context. This is a class and not a generator, because every batch uses it."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, JournalSupersededError):
            return
        if isinstance(error, JournalShareError):
            raise ProtocolError("overloaded", str(error), value=error.taken, limit=error.limit) from error
        if isinstance(error, JournalError):
            raise ProtocolError("overloaded", str(error)) from error


AS_OVERLOADED = JournalErrorsAsOverloaded()

"""Parses the actions of `edit` and `edit-program`; an invalid one is rejected before any query."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import typer
from pydantic import TypeAdapter, ValidationError

from caesura_clients.refusal_words import Refused, refusal_words
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock
from caesura_protocol.validation_words import Place, first_finding

A = TypeVar("A")


def wrong(why: str) -> typer.BadParameter:
    """Return the error for an invalid typed action."""
    return typer.BadParameter(why, param_hint="ACTION")


def word_of(place: Place) -> str:
    """Return the placeholder of a value in the usage of an action."""
    return str(place[-1]).upper()


def validated(
    adapter: TypeAdapter[A], fields: Mapping[str, Any], named: Callable[[Place], str] = word_of
) -> A:
    """Return the action with these fields. Raises BadParameter, which names the value."""
    try:
        return adapter.validate_python(dict(fields))
    except ValidationError as error:
        raise wrong(first_finding(error, named=named)) from error


@contextmanager
def refused_in_words(action: Refused, clock: SessionClock = NO_OFFSET) -> Iterator[None]:
    """Raise a refusal of the service as a CaesuraError whose text states what to do.

    clock: of the session.
    """
    try:
        yield
    except ProtocolError as refusal:
        raise CaesuraError(refusal_words(refusal, action, clock)) from refusal

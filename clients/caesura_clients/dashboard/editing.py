"""Corrections from the browser to the service: the only path by which the dashboard changes anything.

Nothing that a browser sends is trusted: it has to be an `Edit` as the wire has it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from caesura_clients.editing import is_stale, send
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import Ack, Action, Edit, LimitForce
from caesura_protocol.transport.network import Transport
from caesura_protocol.validation_words import first_finding

Request = Mapping[str, Any]
Corrector = Callable[[str, Edit], Ack]  # station, what is asked; raises ProtocolError or CaesuraError

_ACTION: TypeAdapter[Action] = TypeAdapter(Action)


class EditRefused(Exception):  # noqa: N818 - the service refused; nothing failed here
    """A correction that was not made; says why in words for an operator."""


def corrector(transport: Transport) -> Corrector:
    """Asks the service that owns the station."""
    return lambda station, edit: send(transport, station, edit)


def correct(ask: Corrector, station: str, request: Request) -> str:
    """Carry out what a browser asks for; what was done, in words. Raises EditRefused."""
    edit = parse(request)
    try:
        ask(station, edit)
    except ProtocolError as error:
        raise EditRefused(said(error)) from error
    except CaesuraError as error:
        raise EditRefused(f"Not done: {error}") from error
    return done(edit.action)


def parse(request: Request) -> Edit:
    """What a browser sent, checked: {do, t, …, session, revision, author}. Raises EditRefused."""
    common = {name: request.get(name) for name in ("session", "revision", "author")}
    own = {name: value for name, value in request.items() if name not in common}
    try:
        return Edit.model_validate({**common, "action": _ACTION.validate_python(own)})
    except ValidationError as error:
        raise EditRefused(f"Not done: {first_finding(error)}") from error


def said(error: ProtocolError) -> str:
    """A refusal, for an operator."""
    if is_stale(error):
        return (
            f"Not done: another operator corrected this session meanwhile (it is at revision {error.limit}, "
            f"you saw {error.value}). What is there now is shown: look, and do it again."
        )
    return f"Not done: {error}"


def done(action: Action) -> str:
    """What was done, in words."""
    return _DONE[action.do].format(**action.model_dump()) if not _unlimits(action) else "The limit is gone."


def _unlimits(action: Action) -> bool:
    return isinstance(action, LimitForce) and action.newton is None


_DONE: Mapping[str, str] = {
    "insert": "Changepoint inserted at {t:.2f} s.",
    "remove": "Changepoint at {t:.2f} s removed.",
    "move": "Changepoint moved from {t:.2f} s to {to:.2f} s.",
    "relabel": "The segment at {t:.2f} s is {kind}.",
    "limit_force": "The force at {t:.2f} s is limited to {newton:g} N.",
    "name_phase": "The phase at {t:.2f} s is called {name}.",
    "undo": "Undone.",
    "take_back": "Correction {number} is taken back.",
    "redo": "Done again.",
}

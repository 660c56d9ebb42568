"""Corrections from the browser to the service: the only path by which the dashboard changes anything.

Nothing that a browser sends is trusted: it has to be an `Edit` as the wire has it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from caesura_clients.correction_words import effect_words
from caesura_clients.editing import is_stale, send
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import Ack, Action, Edit, LimitForce, Preview
from caesura_protocol.transport.network import Transport
from caesura_protocol.validation_words import first_finding

M = TypeVar("M", Edit, Preview)
Request = Mapping[str, Any]
Corrector = Callable[[str, Edit | Preview], Ack]  # station, what is asked; raises ProtocolError, CaesuraError

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


def preview(ask: Corrector, station: str, request: Request) -> dict[str, Any]:
    """What a correction would change: in words, and the segments of its span of time [s] as rows.

    Of one that would be refused: why, and no row.
    """
    try:
        effect = ask(station, parse_preview(request)).effect
    except EditRefused as error:
        return _no_effect(str(error))
    except ProtocolError as error:
        return _no_effect(said(error))
    except CaesuraError as error:
        return _no_effect(f"Not done: {error}")
    if effect is None:
        return _no_effect("The service states no effect.")
    both = (*effect.segments_before, *effect.segments_after)
    shown = () if effect.more else effect.segments_after  # of a part of them the span is not known
    return {
        "words": effect_words(effect),
        "rows": [[round(one.t0, 3), round(one.tn, 3), one.kind] for one in shown],
        "span": [min(one.t0 for one in both), max(one.tn for one in both)] if both else [0.0, 0.0],
        "failed": False,
    }


def _no_effect(why: str) -> dict[str, Any]:
    return {"words": [why], "rows": [], "span": [0.0, 0.0], "failed": True}


def parse(request: Request) -> Edit:
    """What a browser sent, checked: {do, t, …, session, revision, author}. Raises EditRefused."""
    return _parsed(Edit, request, ("session", "revision", "author"))


def parse_preview(request: Request) -> Preview:
    """The same without an author. Raises EditRefused."""
    return _parsed(Preview, request, ("session", "revision"))


def _parsed(model: type[M], request: Request, names: Sequence[str]) -> M:
    common = {name: request.get(name) for name in names}
    own = {name: value for name, value in request.items() if name not in common}
    try:
        return model.model_validate({**common, "action": _ACTION.validate_python(own)})
    except ValidationError as error:
        raise EditRefused(f"Not done: {first_finding(error)}") from error


def said(error: ProtocolError) -> str:
    """A refusal, for an operator."""
    if is_stale(error):
        return (
            f"Not done: another operator corrected this session meanwhile (it is at revision {error.limit}, "
            f"you saw {error.value}). What is there now is shown: look, and do it again."
        )
    return f"Not done: {error.message}{_within(error)}{_there_is(error)}."


def _within(error: ProtocolError) -> str:
    """What a number was not within, where a refusal states two limits."""
    if not isinstance(error.value, int | float) or not isinstance(error.limit, list | tuple):
        return ""
    return f": {error.value:g} is not within {' to '.join(f'{limit:g}' for limit in error.limit)}"


def _there_is(error: ProtocolError) -> str:
    """The alternatives of a refusal."""
    if not isinstance(error.expected, list | tuple):
        return ""
    return f"; there is {', '.join(str(one) for one in error.expected)}"


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

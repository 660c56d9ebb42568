"""Sends corrections from the browser to the service.

Requests of a browser are not trusted: each is validated as an `Edit`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from caesura_clients.correction_words import (
    NOTHING_CHANGES,
    effect_words,
    elsewhere_words,
    landed,
    moved_words,
    relabel_doubt,
)
from caesura_clients.refusal_words import Refused, refusal_words
from caesura_clients.session_corrections import is_stale, send
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import (
    Ack,
    Action,
    Edit,
    EditProgram,
    Insert,
    LimitForce,
    Move,
    Preview,
    Relabel,
    Since,
)
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock
from caesura_protocol.transport.transport_interface import Transport
from caesura_protocol.validation_words import Place, first_finding

M = TypeVar("M", Edit, Preview)
Request = Mapping[str, Any]
Corrector = Callable[[str, Edit | Preview], Ack]  # station, what is asked; raises ProtocolError, CaesuraError

_ACTION: TypeAdapter[Action] = TypeAdapter(Action)
_ASKED: TypeAdapter[Action | Since] = TypeAdapter(Annotated[Action | Since, Field(discriminator="do")])


class Corrected(NamedTuple):
    """A sentence on an applied correction, and what to look at after it.

    doubt: why it may make no sense, and whether other results changed; mostly empty.
    """

    words: str
    doubt: str = ""


class EditRefused(Exception):  # noqa: N818 - the service refused; nothing failed here
    """A correction was not made; the text states why, for an operator.

    revision: of the session, to which the reason applies; None where it applies to any.
    """

    def __init__(self, words: str, revision: int | None = None) -> None:
        super().__init__(words)
        self.revision = revision


def corrector(transport: Transport) -> Corrector:
    """Return a function that sends a correction to the service that owns the station."""
    return lambda station, edit: send(transport, station, edit)


def correct(ask: Corrector, station: str, request: Request, clock: SessionClock = NO_OFFSET) -> Corrected:
    """Apply the correction that a browser requests; return what was done. Raises EditRefused.

    clock: of the session, for the sentence.
    """
    edit = parse(request)
    try:
        ack = ask(station, edit.model_copy(update={"with_effect": True}))
    except (ProtocolError, CaesuraError) as error:
        raise refused(error, edit, clock) from error
    effect = ack.effect
    beside = [] if effect is None else [relabel_doubt(edit.action, effect), elsewhere_words(effect)]
    return Corrected(done(edit, ack, clock), " ".join(filter(None, beside)))


def refused(
    error: ProtocolError | CaesuraError, command: Edit | EditProgram, clock: SessionClock
) -> EditRefused:
    """Return the refusal of a command for an operator, with the revision to which its reason applies."""
    revision = command.revision
    if isinstance(error, ProtocolError) and is_stale(error):
        revision = error.limit
    return EditRefused(said(error, command.action, clock), revision)


def preview(
    ask: Corrector, station: str, request: Request, clock: SessionClock = NO_OFFSET
) -> dict[str, Any]:
    """Ask the service for the effect of one correction, or of all corrections after a given one.

    Returns the payload of the drawing: `lead` and `words` (text), `rows` [t0, tn, kind] of segments [s],
    `span` [s] from the first to the last changed segment, and `failed`. If the service would refuse the
    correction, `words` states the reason, and `rows` is empty. clock: of the session, for the text.
    """
    try:
        asked = parse_preview(request)
    except EditRefused as error:
        return _no_effect(str(error))
    try:
        effect = ask(station, asked).effect
    except (ProtocolError, CaesuraError) as error:
        return _no_effect(said(error, asked.action, clock))
    if effect is None:
        return _no_effect("The service states no effect.")
    both = (*effect.segments_before, *effect.segments_after)
    is_past = isinstance(asked.action, Since)  # the band shows what is not there
    segments = effect.segments_before if is_past else effect.segments_after
    shown = () if effect.more else segments  # of a part of them the span is not known
    return {
        "lead": "Changed" if is_past else "Preview",
        "words": [*effect_words(effect, clock), *filter(None, [relabel_doubt(asked.action, effect)])],
        "rows": [[round(one.t0, 3), round(one.tn, 3), one.kind] for one in shown],
        "span": [min(one.t0 for one in both), max(one.tn for one in both)] if both else [0.0, 0.0],
        "failed": False,
    }


def _no_effect(why: str) -> dict[str, Any]:
    return {"words": [why], "rows": [], "span": [0.0, 0.0], "failed": True}


def parse(request: Request) -> Edit:
    """Return the edit of a browser's request, checked. Raises EditRefused.

    request: {do, t, …, session, revision, author}.
    """
    return _parsed(Edit, _ACTION, request, ("session", "revision", "author"))


def parse_preview(request: Request) -> Preview:
    """Return the preview of a browser's request, checked; it has no author. Raises EditRefused."""
    return _parsed(Preview, _ASKED, request, ("session", "revision"))


def _parsed(model: type[M], action: TypeAdapter[Any], request: Request, names: Sequence[str]) -> M:
    common = {name: request.get(name) for name in names}
    own = {name: value for name, value in request.items() if name not in common}
    try:
        return model.model_validate({**common, "action": action.validate_python(own)})
    except ValidationError as error:
        raise EditRefused(said(first_finding(error, named=field_words))) from error


def field_words(place: Place) -> str:
    """Return the name of a field on the page from its place in a request: `your name`, `tag 2`."""
    if not place:
        return ""
    last = place[-1]
    if isinstance(last, int):
        return f"{str(place[-2]).removesuffix('s')} {last + 1}" if len(place) > 1 else f"item {last + 1}"
    return {"author": "your name", "seconds": "duration"}.get(last, last)


def said(
    why: ProtocolError | CaesuraError | str,
    action: Refused | None = None,
    clock: SessionClock = NO_OFFSET,
    *,
    lead: str = "Not done",
) -> str:
    """Return a refusal as a sentence for an operator. action: the refused one; clock: of its session."""
    return f"{lead}: {refusal(why, action, clock)}"


def refusal(
    why: ProtocolError | CaesuraError | str, action: Refused | None = None, clock: SessionClock = NO_OFFSET
) -> str:
    """Return a refusal with its full stop. Arguments as `said`."""
    words = refusal_words(why, action, clock) if isinstance(why, ProtocolError) else clock.text(str(why))
    return f"{words}{'' if words.endswith(('.', '?')) else '.'}"


def done(edit: Edit, ack: Ack, clock: SessionClock = NO_OFFSET) -> str:
    """Return a sentence on an applied correction, with the times at which its changepoints lie.

    Of an undo and a redo it is on the correction that was undone or restored. clock: of the session.
    """
    action = landed(edit.action, ack.effect)
    if isinstance(action, LimitForce) and action.newton is None:
        return "The limit is gone."
    values = action.model_dump()
    times = {name: clock.shown(values[name]) for name in ("t", "to") if name in values}
    words, moved = _DONE[action.do].format(**(values | times)), moved_words(action, ack, clock)
    if moved:
        return f"{words.removesuffix('.')}: {moved}."
    is_listed = isinstance(action, Insert | Move | Relabel)  # all that it may change
    if is_listed and ack.effect is not None and effect_words(ack.effect) == [NOTHING_CHANGES]:
        return f"{words} {NOTHING_CHANGES}"
    return words


_DONE: Mapping[str, str] = {
    "insert": "Changepoint inserted at {t} s.",
    "remove": "Changepoint at {t} s removed.",
    "move": "Changepoint moved from {t} s to {to} s.",
    "relabel": "The segment at {t} s is {kind}.",
    "limit_force": "The force at {t} s is limited to {newton:g} N.",
    "name_phase": "The phase at {t} s is called {name}.",
    "undo": "Undone.",
    "take_back": "Correction {number} is taken back.",
    "redo": "Done again.",
}

"""Corrections in words, the same on the command line and in the dashboard."""

from __future__ import annotations

from collections.abc import Mapping

from caesura_protocol.messages import Action, Correction, LimitForce
from caesura_protocol.session_clock import NO_OFFSET, SessionClock

_WORDS: Mapping[str, str] = {
    "insert": "inserted a changepoint at {t} s",
    "remove": "removed the changepoint at {t} s",
    "move": "moved the changepoint at {t} s to {to} s",
    "relabel": "named the segment at {t} s {kind}",
    "limit_force": "limited the force at {t} s to {newton} N",
    "name_phase": "named the phase at {t} s {name}",
    "undo": "took the last correction back",
    "redo": "made the correction that was taken back last once more",
    "take_back": "took correction {number} back",
}
_UNLIMITED = "lifted the limit of the force at {t} s"


def in_words(action: Action, clock: SessionClock = NO_OFFSET) -> str:
    """What a correction does, to stand behind the name of its author. clock: of its session.

    >>> from caesura_protocol.messages import Move
    >>> in_words(Move(t=4.2, to=4.55))
    'moved the changepoint at 4.20 s to 4.55 s'
    """
    values = action.model_dump()
    times = {name: clock.shown(values[name]) for name in ("t", "to") if name in values}
    lifts = isinstance(action, LimitForce) and action.newton is None
    newton = "" if values.get("newton") is None else f"{values['newton']:g}"
    return (_UNLIMITED if lifts else _WORDS[action.do]).format(**(values | times | {"newton": newton}))


def described(correction: Correction, clock: SessionClock = NO_OFFSET) -> str:
    """A correction with its author.

    >>> from caesura_protocol.messages import Move
    >>> described(Correction(number=1, author="Maria", at=0.0, action=Move(t=4.2, to=4.55)))
    'Maria moved the changepoint at 4.20 s to 4.55 s'
    """
    return f"{correction.author} {in_words(correction.action, clock)}"

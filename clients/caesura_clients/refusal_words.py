"""Refusals as text that states what to do, for the command line and the dashboard.

A refusal states a value, a limit and the alternatives as on the wire. Their meaning follows from the refused
action: a time has a unit and the session's clock, a force a unit.
"""

from __future__ import annotations

from caesura_clients.session_corrections import is_stale
from caesura_protocol.errors import NONE_THERE, ProtocolError
from caesura_protocol.messages import Action, LimitForce, Move, ProgramAction, Remove, Since
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock, is_of_day

Refused = Action | ProgramAction | Since


def refusal_words(
    error: ProtocolError, action: Refused | None = None, clock: SessionClock = NO_OFFSET
) -> str:
    """Return the text of a refusal, without the full stop.

    action: the refused correction or edit, if it was one; clock: of its session.

    >>> outside = ProtocolError("malformed", "the time is outside", value=9.2, limit=[0.0, 8.4])
    >>> refusal_words(outside, Remove(t=9.2))
    'time 9.2 s is outside the session (0 to 8.4 s)'
    """
    if is_stale(error):
        return (
            f"another operator changed this meanwhile (it is at revision {error.limit}, "
            f"you saw {error.value}): look at the current state, and do it again"
        )
    if action is not None and _has_no_such(error, action):
        return f"the service has no action {action.do!r}: it is an older version. Update it"
    if _is_time(error, action):
        return _of_time(error, action, clock)
    return clock.text(f"{error.message}{_found(error, action)}{_there_is(error, clock)}")


def _has_no_such(error: ProtocolError, action: Refused) -> bool:
    """Return whether a service refuses a kind of action that came after its version."""
    return error.code == "malformed" and f"Input tag {action.do!r} found" in error.message


def _is_time(error: ProtocolError, action: Refused | None) -> bool:
    """Return whether the value of a refusal is a time.

    It is a time of the action, or one with the ends of the session as its limit.
    """
    stated = [getattr(action, name, None) for name in ("t", "to")]
    has_ends = isinstance(error.limit, list | tuple) and len(error.limit) == 2
    return isinstance(error.value, int | float) and (error.value in stated or has_ends)


def _of_time(error: ProtocolError, action: Refused | None, clock: SessionClock) -> str:
    """Return the refusal of a time as text, with the times that would be accepted."""
    at, limit = clock.brief(error.value), error.limit
    if isinstance(limit, list | tuple) and len(limit) == 2:
        return f"time {at} s is outside the session ({' to '.join(map(clock.brief, limit))} s)"
    near = error.expected if isinstance(error.expected, list | tuple) else []
    if isinstance(action, LimitForce) and error.expected is not None:
        spans = ", ".join(f"{_span(str(span), clock)} s" for span in near)
        there = f"the nearest that do: {spans}" if spans else "no app of this session does"
        return f"no app exerts a force at {at} s; {there}"
    if isinstance(action, Remove | Move) and error.expected is not None:
        times = ", ".join(f"{clock.brief(float(t))} s" for t in near)
        there = f"the nearest are at {times}" if times else "this session has none"
        return f"there is no changepoint near {at} s; {there}"
    if limit is None and error.expected is None:
        return clock.text(error.message)
    return f"at {at} s {clock.text(error.message)}{_there_is(error, clock)}"


def _span(words: str, clock: SessionClock) -> str:
    """Return the two times of a refusal, `[3.0, 4.5]`, as text."""
    return " to ".join(clock.brief(float(t)) for t in words.strip("[]()").split(", "))


def _found(error: ProtocolError, action: Refused | None) -> str:
    """Return text on the refused value and the limit that it violates; empty if the message states them."""
    value, limit = error.value, error.limit
    bare = limit is None and error.expected is None and not isinstance(value, str)
    if value is None or bare or type(error.expected) is int:
        return ""
    unit = " N" if isinstance(action, LimitForce) else ""
    is_bound = isinstance(value, int | float) and isinstance(limit, int | float)
    if is_bound and not isinstance(error.expected, list | tuple):
        return f": {value:g}{unit}, {'at most' if value > limit else 'at least'} {limit:g}{unit}"
    return "" if str(value) in error.message else f": {value!r}"


def _there_is(error: ProtocolError, clock: SessionClock) -> str:
    """Return text on the alternatives of a refusal; empty without any."""
    there = error.expected
    if isinstance(there, list | tuple):
        return f"; there is {', '.join(_alternative(one, clock) for one in there)}"
    return f"; expected {there}" if isinstance(there, str) and there != NONE_THERE else ""


def _alternative(one: object, clock: SessionClock) -> str:
    return clock.brief(one) if isinstance(one, int | float) and is_of_day(one) else str(one)

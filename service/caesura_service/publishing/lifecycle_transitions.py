"""The lifecycle of a session as a table of transitions. An illegal event raises and changes nothing.

A session is opened once, receives samples and closes once. A heartbeat, a late answer to a replay, or a
repeated batch may arrive after the close, and a close may be repeated because its acknowledgement was lost. A
session can be corrected and described, and its program edited, as long as it is in memory. In `failed` the
pipeline has raised an error: clients see a closed session, with the reason in its status.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from caesura_protocol.errors import ProtocolError

Lifecycle = Literal["open", "closed", "failed"]
LifecycleEvent = Literal[
    "open", "samples", "heartbeat", "replayed", "close", "edit", "describe", "edit_program", "fail"
]

TRANSITIONS: Mapping[tuple[Lifecycle, LifecycleEvent], Lifecycle] = {
    ("open", "open"): "open",
    ("open", "samples"): "open",
    ("open", "heartbeat"): "open",
    ("open", "replayed"): "open",
    ("open", "close"): "closed",
    ("open", "edit"): "open",
    ("open", "describe"): "open",
    ("open", "edit_program"): "open",
    ("open", "fail"): "failed",
    ("closed", "close"): "closed",
    ("closed", "heartbeat"): "closed",
    ("closed", "replayed"): "closed",
    ("closed", "edit"): "closed",
    ("closed", "describe"): "closed",
    ("closed", "edit_program"): "closed",
    ("failed", "heartbeat"): "failed",
    ("failed", "replayed"): "failed",
    ("failed", "describe"): "failed",
    ("failed", "edit_program"): "failed",
}

# How a refusal names states and events to people. The others are messages of a bridge.
STATE_WORDS: Mapping[Lifecycle, str] = {
    "open": "the session is open",
    "closed": "the session is closed",
    "failed": "the session has failed",
}
EVENT_WORDS: Mapping[str, str] = {
    "open": "second opening",
    "edit": "corrections",
    "describe": "description",
    "edit_program": "edits of its program",
}


def next_state(state: Lifecycle, event: LifecycleEvent) -> Lifecycle:
    """Return the state after an event. Raises ProtocolError `conflict` if the table has no transition."""
    try:
        return TRANSITIONS[state, event]
    except KeyError:
        why = f"{STATE_WORDS[state]}: it takes no {EVENT_WORDS.get(event, event)}"
        raise ProtocolError("conflict", f"{why}{_what_is_left(state, event)}") from None


def _what_is_left(state: Lifecycle, event: LifecycleEvent) -> str:
    """Return text on what an operator can still do after a refused command; empty if nothing."""
    commands: tuple[LifecycleEvent, ...] = ("edit", "describe", "edit_program")
    left = [EVENT_WORDS[one] for one in commands if (state, one) in TRANSITIONS]
    return f", only {' and '.join(left)}" if event in commands and left else ""

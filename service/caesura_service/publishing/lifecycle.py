"""The lifecycle of a session as a table of moves. An illegal move raises and changes nothing.

A session is opened once, takes samples and closes once. A heartbeat, a late answer to a replay, or what it
has already may trail behind the close, and a close may be repeated because its acknowledgement was lost.
It can be corrected as long as it is kept.
`failed` is a session whose pipeline raised: closed for the world, with the reason in its status.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from caesura_protocol.errors import ProtocolError

State = Literal["open", "closed", "failed"]
Move = Literal["open", "samples", "heartbeat", "replayed", "close", "edit", "fail"]

MOVES: Mapping[tuple[State, Move], State] = {
    ("open", "open"): "open",
    ("open", "samples"): "open",
    ("open", "heartbeat"): "open",
    ("open", "replayed"): "open",
    ("open", "close"): "closed",
    ("open", "edit"): "open",
    ("open", "fail"): "failed",
    ("closed", "close"): "closed",
    ("closed", "heartbeat"): "closed",
    ("closed", "replayed"): "closed",
    ("closed", "edit"): "closed",
    ("failed", "heartbeat"): "failed",
    ("failed", "replayed"): "failed",
}


def after(state: State, move: Move) -> State:
    """The state that a move leads to. Raises ProtocolError `conflict` where the table has none."""
    try:
        return MOVES[state, move]
    except KeyError:
        allowed = [name for known, name in MOVES if known == state]
        raise ProtocolError(
            "conflict", f"the session is {state}: it takes no {move}", value=move, expected=allowed
        ) from None

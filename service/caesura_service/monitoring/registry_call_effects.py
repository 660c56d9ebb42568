"""The effects of one call of the registry, for counters and log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from caesura_protocol.messages import Refusal
from caesura_service.publishing.events import Incoming, Output
from caesura_service.publishing.session_state import SessionState


class Change(NamedTuple):
    """A session before and after; None if it did not exist."""

    before: SessionState | None
    after: SessionState | None


class RegistryCall(NamedTuple):
    """A call of the registry with its effects: one message, command or tick.

    station: None if the key has none, or if the call concerns all. refused: number of refusals, of which
    `refusal` is the last. batches: number of batches processed together, of which `message` is the first.
    """

    station: str | None
    message: Incoming | None
    changes: Sequence[Change]
    outputs: Sequence[Output]
    refused: int
    refusal: Refusal | None
    duration_s: float
    batches: int = 1


def changes_between(before: Mapping[str, SessionState], after: Mapping[str, SessionState]) -> list[Change]:
    """Return the change of every session whose state is another object than before, by name."""
    names = before if before.keys() == after.keys() else dict.fromkeys((*before, *after))
    pairs = [(before.get(name), after.get(name)) for name in names]
    return [Change(old, new) for old, new in pairs if old is not new]

"""Sources whose messages are dropped unread for a short time, because their station has used up a budget.

Refusing a message with its reason costs more than accepting it. So a flood of refused ones would use the
interpreter's time of all stations. After a refusal the next messages of the source cost only a table lookup.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from caesura_protocol.token_bucket import SENDERS

MUTED_S = 0.02  # in which a hundred messages of a station's budget come back


class MutedSources:
    """Counts the messages that are dropped unread. Only one thread at a time may call it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._until_s: dict[str, float] = {}
        self._dropped: dict[str, int] = {}

    def mute(self, source: str) -> None:
        """Drop the messages of a source for MUTED_S from now on."""
        self._until_s.pop(source, None)
        self._until_s[source] = self._clock() + MUTED_S
        if len(self._until_s) > SENDERS:
            del self._until_s[next(iter(self._until_s))]

    def drops(self, source: str) -> bool:
        """Return whether a message of a source is dropped; if so, count it."""
        until_s = self._until_s.get(source)
        if until_s is None:
            return False
        if self._clock() >= until_s:
            del self._until_s[source]
            return False
        self._dropped[source] = self._dropped.get(source, 0) + 1
        return True

    def pop_drops(self) -> Mapping[str, int]:
        """Return how many messages of each source were dropped since the last call."""
        dropped, self._dropped = self._dropped, {}
        return dropped

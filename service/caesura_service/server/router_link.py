"""The link of an instance to its router, and whether the router rejects only this instance.

A router distinguishes sessions by their Zenoh ids, which every reply states, and rejects a second session
with the same id. So a client that uses the id of an instance without a link blocks that instance as long as
it is connected; so does an old link that hangs. A session with another id is accepted.
"""

from __future__ import annotations

import time
from collections.abc import Callable

LOOK_S = 3.0  # between two tries with another session, while the link is down
KEPT_OUT_S = 15.0  # a link that hangs is given up within 12 s


class RouterLink:
    """The state of the link. One thread calls `is_kept_out`, any thread the other methods."""

    def __init__(self, lets_in: Callable[[], bool], clock: Callable[[], float] = time.monotonic) -> None:
        """lets_in: returns whether the router accepts another session now."""
        self.is_up = True
        self._lets_in, self._clock = lets_in, clock
        self._look_at = float("-inf")  # [s]
        self._kept_out_since: float | None = None  # [s]

    def report(self, up: bool) -> None:
        """Record that the link was restored (True) or lost."""
        self.is_up = up

    def is_kept_out(self) -> bool:
        """Whether the router has accepted other sessions for KEPT_OUT_S, and not this one."""
        now = self._clock()
        if self.is_up:
            self._kept_out_since, self._look_at = None, now + LOOK_S
            return False
        if now < self._look_at:
            return False
        lets_in = self._lets_in()
        now = self._clock()
        self._look_at = now + LOOK_S
        if not lets_in or self.is_up:
            self._kept_out_since = None
        elif self._kept_out_since is None:
            self._kept_out_since = now
        return self._kept_out_since is not None and now - self._kept_out_since >= KEPT_OUT_S

"""The link of an instance to its router, and whether the router keeps it out while it lets others in.

A router distinguishes sessions by their Zenoh ids, which every reply states, and refuses a second one. So a
client that takes the id of an instance while the instance has no link keeps it out for as long as it stays;
so does an old link that hangs. A session with another id is let in.
"""

from __future__ import annotations

import time
from collections.abc import Callable

LOOK_S = 3.0  # between two tries with another session, while the link is down
KEPT_OUT_S = 15.0  # a link that hangs is given up within 12 s


class RouterLink:
    """The state of the link. One thread asks `is_kept_out`, any thread calls the rest."""

    def __init__(self, lets_in: Callable[[], bool], clock: Callable[[], float] = time.monotonic) -> None:
        """lets_in: whether the router lets another session in now."""
        self.is_up = True
        self._lets_in, self._clock = lets_in, clock
        self._look_at = float("-inf")  # [s]
        self._kept_out_since: float | None = None  # [s]

    def report(self, up: bool) -> None:
        """The link was restored (True) or lost."""
        self.is_up = up

    def is_kept_out(self) -> bool:
        """Whether the router has let other sessions in for KEPT_OUT_S, and not this one."""
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

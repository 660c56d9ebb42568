"""The live instances, computed from tokens, the own link and time, without a network.

An instance whose token disappears while the own link is up is gone, and its stations are reassigned. If the
own link is lost, all tokens disappear at once, which does not show that their holders are gone. They count as
live until the link is restored, and then for the time that their own return may take.
"""

from __future__ import annotations

from collections.abc import Iterable

SETTLE_S = 0.05  # the loss of a link is reported just after that of the tokens behind it
RETURN_S = 1.5  # between our own link and those of others; they try every 0.5 s


class Membership:
    """The live instances. Times [s] are those of the caller's clock."""

    def __init__(self, me: str) -> None:
        self._me = me
        self._linked = True
        self._live: set[str] = set()
        self._until: dict[str, float] = {}  # instances without a token, and until when they count as live [s]

    def begin(self, others: Iterable[str]) -> None:
        """Start with the instances live before tokens were watched; they stay until RETURN_S after that."""
        self._until = dict.fromkeys(set(others) - {self._me}, float("inf"))

    def start_watching(self, now: float) -> None:
        """Drop instances of `begin` that do not reappear within RETURN_S. now: [s]."""
        self._until = dict.fromkeys(self._until, now + RETURN_S)

    def add(self, instance: str, now: float) -> bool:
        """Add a live instance; return True if it was not a member before. now: [s]."""
        if instance == self._me:
            return False
        missed = self._until.pop(instance, now)
        is_new = instance not in self._live and missed <= now
        self._live.add(instance)
        return is_new

    def remove(self, instance: str, now: float) -> None:
        """Remove an instance after SETTLE_S, or once the own link is back. now: [s]."""
        if instance in self._live:
            self._live.remove(instance)
            self._until[instance] = now + SETTLE_S if self._linked else float("inf")

    def link_lost(self) -> None:
        """Record that the own link is lost; the current members stay members."""
        self._linked = False
        self._until = dict.fromkeys({*self._live, *self._until}, float("inf"))
        self._live.clear()

    def link_restored(self, now: float) -> None:
        """Record that the own link is restored; members get RETURN_S to reappear. now: [s]."""
        self._linked = True
        self._until = dict.fromkeys(self._until, now + RETURN_S)

    def members(self, now: float) -> frozenset[str]:
        """Return the live instances, this one included, and drop the others."""
        self._until = {instance: until for instance, until in self._until.items() if until > now}
        return frozenset({self._me, *self._live, *self._until})

    def next_change_s(self, now: float) -> float:
        """Return the time [s] at which the next instance stops being a member without an event.

        Infinite if none does.
        """
        return min((until for until in self._until.values() if until > now), default=float("inf"))

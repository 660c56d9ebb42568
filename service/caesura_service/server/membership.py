"""Which instances live, as one of them sees it: a fold over tokens, its own link and time. Sees no network.

An instance whose token goes while our own link stands is gone, and its stations are given away. With our own
link all tokens go at once, which says nothing about their holders: they count as there until the link is
back, and then for as long as they take to come back too.
"""

from __future__ import annotations

from collections.abc import Iterable

SETTLE_S = 0.05  # the loss of a link is reported just after that of the tokens behind it
RETURN_S = 1.5  # between our own link and those of others; they try every 0.5 s


class Membership:
    """Times [s] are those of the caller's clock."""

    def __init__(self, me: str) -> None:
        self._me = me
        self._linked = True
        self._there: set[str] = set()
        self._until: dict[str, float] = {}  # whose token is gone, and how long they count as there

    def begin(self, others: Iterable[str]) -> None:
        """These were there before we watched; they count until `watching`, and a while longer."""
        self._until = dict.fromkeys(set(others) - {self._me}, float("inf"))

    def watching(self, now: float) -> None:
        """From here on changes of members are reported, after the members present now."""
        self._until = dict.fromkeys(self._until, now + RETURN_S)

    def came(self, instance: str, now: float) -> bool:
        """A token is there. True where its holder was not a member, and may have taken itself for alone."""
        if instance == self._me:
            return False
        missed = self._until.pop(instance, now)
        fresh = instance not in self._there and missed <= now
        self._there.add(instance)
        return fresh

    def went(self, instance: str, now: float) -> None:
        """A token is gone."""
        if instance in self._there:
            self._there.remove(instance)
            self._until[instance] = now + SETTLE_S if self._linked else float("inf")

    def link_lost(self) -> None:
        """Note that the own link is lost; the members of the last query stay members."""
        self._linked = False
        self._until = dict.fromkeys({*self._there, *self._until}, float("inf"))
        self._there.clear()

    def link_back(self, now: float) -> None:
        """We see others again."""
        self._linked = True
        self._until = dict.fromkeys(self._until, now + RETURN_S)

    def members(self, now: float) -> frozenset[str]:
        """Return the live instances, this one included, and drop the others."""
        self._until = {instance: until for instance, until in self._until.items() if until > now}
        return frozenset({self._me, *self._there, *self._until})

    def due(self, now: float) -> float:
        """Return when the next instance stops being a member without an event; infinite if none does."""
        return min((until for until in self._until.values() if until > now), default=float("inf"))

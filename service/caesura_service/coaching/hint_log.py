"""Raises and clears hints: one per kind, or per kind and place, with hysteresis and a refractory time.

A rule has a level, of which 1 is its limit. A hint is raised when the level was at 1 or more for `confirm`
observations, and cleared when it was below `clear_below` for `release` of them. For `refractory_s` after that
no hint of its kind is raised.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from caesura_protocol.messages import MAX_HINTS, Hint, HintKind

LOUD = 2.0  # of the limit: a level that is no flicker about it, and is not silenced
CLEARED_KEPT = 24  # cleared hints that are kept, the newest ones

Words = tuple[str, str]  # what was found, and what to do


@dataclass(frozen=True)
class Trigger:
    """The conditions to raise and to clear a hint: counts of observations, and a time [s]."""

    kind: HintKind
    confirm: int = 2
    release: int = 5
    clear_below: float = 0.8
    refractory_s: float = 5.0


Cause = tuple[HintKind, float | None]  # a kind, and the place that it is about [s], where it has several


class _Standing(NamedTuple):
    """The state of one cause of hints: its counts, and its active hint."""

    hint: Hint | None = None  # the active one
    streak: int = 0  # observations in a row that speak for a change
    silent_until: float = -math.inf  # [s]


class HintLog:
    """The active hint of each cause, and the newest cleared ones."""

    def __init__(self) -> None:
        self._standing: dict[Cause, _Standing] = {}
        self._cleared: tuple[Hint, ...] = ()
        self.stirred: set[HintKind] = set()  # kinds that are active, or about to be
        self.hints: tuple[Hint, ...] = ()  # the same tuple as long as nothing changes
        self.first: dict[HintKind, float] = {}  # [s] when a hint of each kind was first raised

    def step(self, trigger: Trigger, t: float, level: float, words: Callable[[], Words]) -> None:
        """Raise or clear a hint by the level of a rule at a time [s]; nan counts as a level of 0.

        words: text and advice of a new hint.
        """
        before = self._standing.get((trigger.kind, None), _Standing())
        if before.hint is None:
            streak = before.streak + 1 if level >= (1.0 if t >= before.silent_until else LOUD) else 0
            if streak >= trigger.confirm:
                text, advice = words()
                self.raise_hint(Hint(kind=trigger.kind, since=t, text=text, advice=advice))
                return
        else:
            streak = 0 if level >= trigger.clear_below else before.streak + 1
            if streak >= trigger.release:
                self.clear(trigger.kind, t, trigger.refractory_s)
                return
        if streak != before.streak:
            self._standing[trigger.kind, None] = before._replace(streak=streak)
            if streak:
                self.stirred.add(trigger.kind)
            elif before.hint is None:
                self.stirred.discard(trigger.kind)

    def raise_hint(self, hint: Hint, place: float | None = None) -> None:
        """Make a hint the active one of its kind, at a place [s] if it has several."""
        self._standing[hint.kind, place] = _Standing(hint)
        self.first.setdefault(hint.kind, hint.since)
        self.stirred.add(hint.kind)
        self._publish()

    def update_hint(self, kind: HintKind, place: float | None, changes: Mapping[str, object]) -> None:
        """Replace fields of the active hint of a cause, if there is one: it stays the same hint."""
        standing = self._standing.get((kind, place), _Standing())
        if standing.hint is not None:
            changed = Hint.model_validate({**standing.hint.model_dump(), **changes})
            self._standing[kind, place] = standing._replace(hint=changed)
            self._publish()

    def clear(
        self, kind: HintKind, t: float, refractory_s: float = 0.0, *, place: float | None = None
    ) -> None:
        """Clear the active hint of a cause, if there is one, at a time [s]."""
        hint = self._standing.get((kind, place), _Standing()).hint
        if hint is None:
            return
        over = hint.model_copy(update={"until": max(t, hint.since)})
        self._cleared = (*self._cleared, over)[-CLEARED_KEPT:]
        if place is None:
            self._standing[kind, None] = _Standing(silent_until=t + refractory_s)
        else:
            del self._standing[kind, place]
        self.stirred.discard(kind)
        self._publish()

    def clear_all(self, t: float) -> None:
        """Clear every active hint at the end of the demonstration."""
        for kind, place in [*self._standing]:
            self.clear(kind, t, place=place)

    def _publish(self) -> None:
        active = [one.hint for one in self._standing.values() if one.hint is not None]
        self.hints = tuple(sorted([*self._cleared, *active], key=lambda hint: hint.since))


def all_hints(*logs: HintLog) -> tuple[Hint, ...]:
    """Return the hints of all logs by the time at which they were raised, at most MAX_HINTS."""
    if sum(map(bool, (log.hints for log in logs))) == 1:
        return next(log.hints for log in logs if log.hints)
    merged = sorted((hint for log in logs for hint in log.hints), key=lambda hint: hint.since)
    return tuple(merged)[-MAX_HINTS:]

"""Hints that are raised, updated and cleared from one update of a session to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from caesura_clients.session_follower import Event, SessionRemoved
from caesura_clients.session_state_reader import Update
from caesura_protocol.messages import Hint, HintKind

Key = tuple[str, str]  # station and session
Active = dict[tuple[HintKind, float], Hint]  # by kind and the time at which it was raised


@dataclass(frozen=True)
class HintChange:
    """A hint that was raised, updated or cleared.

    active: number of the station's active hints after the change; updated: the same hint with other content.
    """

    event: Literal["raised", "updated", "cleared"]
    station: str
    session: str
    hint: Hint
    active: int


class HintChanges:
    """A fold over events. A hint that was raised and cleared between two updates is not reported."""

    def __init__(self) -> None:
        self._active: dict[Key, Active] = {}

    def receive(self, event: Event) -> list[HintChange]:
        """Return what an event changes, cleared hints first."""
        match event:
            case Update():
                active = {(one.kind, one.since): one for one in event.hints if one.until is None}
                ended = {(one.kind, one.since): one for one in event.hints if one.until is not None}
                return self._replace((event.station, event.session), {} if event.closed else active, ended)
            case SessionRemoved():
                return self._replace((event.station, event.session), {}, {})
        return []

    def clear(self) -> list[HintChange]:
        """Return every active hint as cleared, because they are no longer followed."""
        return [change for key in [*self._active] for change in self._replace(key, {}, {})]

    def _replace(self, key: Key, active: Active, ended: Active) -> list[HintChange]:
        before, (station, session) = self._active.pop(key, {}), key
        changes: list[HintChange] = []
        for one in before.keys() - active.keys():
            count = self._count(station) + len(before.keys() & active.keys())
            changes.append(HintChange("cleared", station, session, ended.get(one, before[one]), count))
        if active:
            self._active[key] = active
        for one in active.keys() - before.keys():
            changes.append(HintChange("raised", station, session, active[one], self._count(station)))
        for one in active.keys() & before.keys():
            if active[one].advice != before[one].advice:
                changes.append(HintChange("updated", station, session, active[one], self._count(station)))
        return changes

    def _count(self, station: str) -> int:
        return sum(len(active) for (name, _), active in self._active.items() if name == station)

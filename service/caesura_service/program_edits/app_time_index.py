"""Finds the taught apps near a time without a search through all apps."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from itertools import accumulate

from caesura_protocol.messages import App, AppReference
from caesura_service.program_edits.edited_app import SLACK_S


class AppTimeIndex:
    """The taught apps, sorted by start time. Immutable."""

    def __init__(self, apps: Sequence[App]) -> None:
        """Leave out the apps that an edit has added."""
        taught = (index for index, app in enumerate(apps) if app.added is None)
        self._indices = sorted(taught, key=lambda index: apps[index].t0)
        self._apps = [apps[index] for index in self._indices]
        self._starts = [app.t0 for app in self._apps]
        self._latest = list(accumulate((app.tn for app in self._apps), max))  # end of those up to each one

    def near(self, wanted: AppReference) -> Iterator[int]:
        """Yield the indices of the apps whose time is close to that of a reference, in no order."""
        first, last = wanted.t0 - 2 * SLACK_S, wanted.tn + 2 * SLACK_S
        place = bisect_left(self._starts, last) - 1
        while place >= 0 and first < self._latest[place]:
            if first < self._apps[place].tn:
                yield self._indices[place]
            place -= 1

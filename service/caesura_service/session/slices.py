"""Long work in slices, between which other work has its turn.

What takes long (an hour that is filtered anew, a batch of a minute) calls `give_way` as it goes. Nothing
between there and where the work was begun has to know of it, for the work runs on a stack of its own, a
greenlet: it stops in `give_way` once its slice is over, and goes on from there in its next one. Where nobody
has begun it as slices, `give_way` does nothing. So slices change when something is computed, and never what.

Rules
- Until the work ends, others see of its session what they saw before it began.
- Before a station changes hands its work is brought to its end (`finish`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf

from greenlet import GreenletExit, getcurrent, greenlet

SLICE_S = 0.005  # a tenth of what a result may take


class _Work(greenlet):  # type: ignore[misc]  # greenlet comes without types
    until = inf  # [s] when its slice is over


def give_way() -> None:
    """Let others have their turn, if the slice of the work that calls this is over."""
    current = getcurrent()
    if isinstance(current, _Work) and time.perf_counter() >= current.until:
        current.parent.switch()


class Slices:
    """Work by name, at most one piece of each. One thread uses it."""

    def __init__(self, slice_s: float = SLICE_S) -> None:
        self.slice_s = slice_s
        self._under_way: dict[str, _Work] = {}

    def is_under_way(self, name: str) -> bool:
        """Is there a slice left to do?"""
        return name in self._under_way

    def begin(self, name: str, work: Callable[[], None]) -> bool:
        """Do the first slice; True where that was all."""
        return self._do(name, _Work(work), self.slice_s)

    def go_on(self, name: str) -> bool:
        """Do the next slice, if there is one; True where nothing is left."""
        work = self._under_way.pop(name, None)
        return work is None or self._do(name, work, self.slice_s)

    def finish(self, name: str) -> None:
        """Do all that is left."""
        if (work := self._under_way.pop(name, None)) is not None:
            self._do(name, work, inf)

    def stop(self) -> None:
        """Leave off where it stands."""
        under_way, self._under_way = self._under_way, {}
        for work in under_way.values():
            work.throw(GreenletExit)

    def _do(self, name: str, work: _Work, slice_s: float) -> bool:
        work.parent = getcurrent()
        work.until = time.perf_counter() + slice_s
        work.switch()
        if not work.dead:
            self._under_way[name] = work
        return bool(work.dead)

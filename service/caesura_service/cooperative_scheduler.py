"""Divides long work into time slices, between which the work of other stations runs.

Long work (filtering an hour again, a batch of a minute) calls `give_way` repeatedly. The functions between
that call and the start of the work need no change, because the work runs in a greenlet with its own stack. It
is suspended in `give_way` once its slice is over, and continues there in its next slice. Outside of a work
`give_way` does nothing. So slices change when a result is computed, and never the result.

Work calls `stand_aside` once its urgent part is done. The rest gets slices when no other work is left, or
when the caller requests it.

A greenlet is reused for the next work, because a new stack takes more memory than most messages do.

Rules
- Until the work ends, others see its session as before it began; after `stand_aside`, as of that call.
- Before a station changes its owner its work is completed (`finish`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from math import inf
from typing import Generic, TypeVar

from greenlet import GreenletExit, getcurrent, greenlet

T = TypeVar("T")

SLICE_S = 0.005  # a tenth of what a result may take
IDLE = 4  # stacks that are kept for later work


class _Stack(greenlet):  # type: ignore[misc]  # greenlet comes without types
    """A greenlet that runs one work after the other.

    Each work ends with a switch to the greenlet that started its last slice.
    """

    until = inf  # [s] when the slice of its work is over
    work: Callable[[], None] | None = None  # to be begun
    error: Exception | None = None  # with which the last work ended
    is_idle = True
    stands_aside = False  # for the rest of its work

    def run(self) -> None:
        """Run works until the greenlet is abandoned; keep no reference to a work that has ended."""
        while (work := self.work) is not None:
            self.is_idle, self.work, self.stands_aside = False, None, False
            try:
                work()
            except Exception as error:
                self.error = error
            self.is_idle, work = True, None
            self.parent.switch()


def give_way() -> None:
    """Switch to other works, if the slice of the calling work is over."""
    current = getcurrent()
    if isinstance(current, _Stack) and time.perf_counter() >= current.until:
        current.parent.switch()


class GivingWay(Generic[T]):
    """Items before each of which works give way."""

    def __init__(self, items: Iterable[T]) -> None:
        self._items = items

    def __iter__(self) -> Iterator[T]:
        for item in self._items:
            give_way()
            yield item


def stand_aside() -> None:
    """Switch to other works now, and continue only when they have nothing to do."""
    current = getcurrent()
    if isinstance(current, _Stack):
        current.stands_aside = True
        current.parent.switch()


class Slices:
    """Works by name, at most one per name. Only one thread may use it."""

    def __init__(self, slice_s: float = SLICE_S) -> None:
        self.slice_s = slice_s
        self._under_way: dict[str, _Stack] = {}
        self._idle: list[_Stack] = []

    def is_under_way(self, name: str) -> bool:
        """Whether a work of this name is unfinished."""
        return name in self._under_way

    def stands_aside(self, name: str) -> bool:
        """Whether the rest of a work may wait until other works have nothing to do."""
        return name in self._under_way and self._under_way[name].stands_aside

    def begin(self, name: str, work: Callable[[], None]) -> bool:
        """Run the first slice of a work; return whether the work is finished. Raises what the work raises."""
        stack = self._idle.pop() if self._idle else _Stack()
        stack.work = work
        return self._do(name, stack, self.slice_s)

    def go_on(self, name: str) -> bool:
        """Run the next slice of a work, if there is one; return whether the work is finished."""
        stack = self._under_way.pop(name, None)
        return stack is None or self._do(name, stack, self.slice_s)

    def finish(self, name: str) -> None:
        """Run the rest of a work at once, if it is unfinished; also the part after `stand_aside`."""
        while (stack := self._under_way.pop(name, None)) is not None:
            self._do(name, stack, inf)

    def stop(self) -> None:
        """Abandon all unfinished works."""
        stacks = [*self._under_way.values(), *self._idle]
        self._under_way, self._idle = {}, []
        for stack in stacks:
            stack.parent = getcurrent()
            stack.throw(GreenletExit)

    def _do(self, name: str, stack: _Stack, slice_s: float) -> bool:
        """Run one slice of a work; return whether the work is finished. Raises what the work raises."""
        stack.parent = getcurrent()
        stack.until = time.perf_counter() + slice_s
        stack.switch()
        if not stack.is_idle:
            self._under_way[name] = stack
            return False
        if len(self._idle) < IDLE:
            self._idle.append(stack)
        error, stack.error = stack.error, None
        try:
            if error is not None:
                raise error
        finally:
            del error  # or its traceback would keep itself, and what the work had
        return True

"""Threads that repeat their work while a context lasts, also after network errors."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

RETRY_S = 1.0  # from an error to the next attempt


class RepeatingThreads:
    """Repeats each function in a separate thread while the context lasts, also after an error.

    works: functions by thread name; each returns soon after `_over` is set. on_error: called by the thread
    with its name and the text of the error.
    """

    def __init__(self, works: Mapping[str, Callable[[], None]], on_error: Callable[[str, str], None]) -> None:
        self._over = threading.Event()
        self._on_error = on_error
        self._threads = [
            threading.Thread(target=self._repeat, args=named, name=named[0], daemon=True)
            for named in works.items()
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _repeat(self, name: str, work: Callable[[], None]) -> None:
        while not self._over.is_set():
            try:
                work()
            except Exception as error:  # whatever it is, it must be seen, and not end the thread
                self._on_error(name, str(error) or type(error).__name__)
                self._over.wait(RETRY_S)

"""A base class that runs a thread while its context lasts."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Self

JOIN_S = 2.0  # until a thread that is still working is left alone at the end


class BackgroundThread(ABC):
    """Runs `_run`, which ends once `_stopped` is set; `wake` interrupts its waiting."""

    def __init__(self, name: str, wake: Callable[[], None]) -> None:
        self._stopped = threading.Event()
        self._wake = wake
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._wake()
        self._thread.join(JOIN_S)

    @abstractmethod
    def _run(self) -> None:
        """Work until stopped."""

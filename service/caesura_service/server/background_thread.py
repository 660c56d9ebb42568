"""What works in a thread of its own while the context lasts."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Self

JOIN_S = 2.0  # for what is under way when the service stops


class BackgroundThread(ABC):
    """Runs `_run`, which looks at `_stopped`, and is made to look by `wake`."""

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

"""Whether a service is live, from liveliness tokens as they appear and disappear.

>>> services = LiveServices()
>>> [services.receive(TokenChange("service/a/alive", alive)) for alive in (True, True, False, True)]
['there', None, 'gone', 'there']
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from caesura_protocol.keys import service_key
from caesura_protocol.transport.inbox import Inbox, TokenChange
from caesura_protocol.transport.transport_interface import Transport

TICK_S = 0.1
Change = Literal["there", "gone"]


class LiveServices:
    """The live instances of the service: a fold over changes of liveliness tokens."""

    def __init__(self) -> None:
        self._alive: set[str] = set()

    def __bool__(self) -> bool:
        """Return whether any instance of the service is alive."""
        return bool(self._alive)

    def receive(self, presence: TokenChange) -> Change | None:
        """Apply a change of a token.

        Return `there` for the first service, `gone` after the last one, else None.
        """
        before = bool(self)
        if presence.alive:
            self._alive.add(presence.key)
        else:
            self._alive.discard(presence.key)
        if bool(self) == before:
            return None
        return "there" if self else "gone"


@contextmanager
def watch_services(transport: Transport, on_change: Callable[[Change], None]) -> Iterator[None]:
    """Call `on_change`, in a separate thread, whenever the last service goes or a first one appears."""
    inbox, over = Inbox(), threading.Event()

    def listen() -> None:
        services = LiveServices()
        while not over.is_set():
            item = inbox.get(TICK_S)
            change = services.receive(item) if isinstance(item, TokenChange) else None
            if change is not None:
                on_change(change)

    with transport.watch_liveliness(service_key("*", "alive"), inbox):
        thread = threading.Thread(target=listen, name="service liveliness", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

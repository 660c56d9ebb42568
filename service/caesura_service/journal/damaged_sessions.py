"""The sessions of a journal that no query finds: their results are unreadable, or they are set aside.

A closed session is listed by its results. If these are damaged, or were never stored, its samples may still
be undamaged. After a start the journal checks the results of all closed sessions once, in a thread.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Generator, Iterable, Iterator, Set
from contextlib import closing, contextmanager, suppress
from heapq import nlargest
from typing import NamedTuple

from caesura_protocol.keys import is_name
from caesura_protocol.messages import MAX_DAMAGED, MAX_STATUS_TEXT, DamagedSession, as_line
from caesura_service.journal.journal import JournalError, Key

CHECK_SHARE = 0.2  # of the time of its thread that a check reads
NOT_STORED = "its results were not stored before the service ended"


class DamageReport(NamedTuple):
    """The newest damaged sessions of a journal, and the number of further ones."""

    listed: tuple[DamagedSession, ...] = ()
    before: int = 0


class UnreadableResults:
    """The closed sessions whose results cannot be read, with the reason. Any thread may call the methods."""

    def __init__(self) -> None:
        # Held from a read that fails to its `add`, so that no newer write is missed.
        self.lock = threading.Lock()
        self._found: dict[Key, tuple[float, str]] = {}

    def add(self, key: Key, opened: float, why: str) -> None:
        """Record why the results cannot be read. The caller holds the lock."""
        self._found[key] = opened, why

    def has(self, key: Key) -> bool:
        """Whether the results of a session are known to be unreadable."""
        return key in self._found

    def remove(self, key: Key) -> None:
        """Remove a session whose results have been written, or can be read again."""
        with self.lock:
            self._found.pop(key, None)

    def report(self, aside: Iterable[tuple[str, str, float, str]], existing: Set[Key]) -> DamageReport:
        """Return the newest of these sessions and of those set aside.

        aside: station, name in the file, time of opening [s], reason; existing: the sessions of the journal.
        """
        with self.lock:
            for key in self._found.keys() - existing:
                del self._found[key]
            found = [(opened, *key, why, False) for key, (opened, why) in self._found.items()]
        found += [(opened, station, name.split(".")[0], why, True) for station, name, opened, why in aside]
        newest = nlargest(MAX_DAMAGED, (one for one in found if is_name(one[1]) and is_name(one[2])))
        listed = tuple(
            DamagedSession(
                station=station, session=name, why=_printable(why), opened=opened, set_aside=is_aside
            )
            for opened, station, name, why, is_aside in newest
        )
        return DamageReport(listed, len(found) - len(listed))


@contextmanager
def beside(steps: Generator[None, None, None], name: str) -> Iterator[None]:
    """Run the steps in a thread of this name while the context lasts, for CHECK_SHARE of the time.

    A JournalError ends the thread: the journal's other readers report it.
    """
    stopped = threading.Event()

    def run() -> None:
        began = time.monotonic()
        with suppress(JournalError), closing(steps):
            for _ in steps:
                took_s = time.monotonic() - began
                if stopped.wait(took_s * (1.0 / CHECK_SHARE - 1.0)):
                    return
                began = time.monotonic()

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def _printable(why: str) -> str:
    """Return a reason as the text of a status. It is cut first: a joiner needs the character after it."""
    return as_line(why[:MAX_STATUS_TEXT]) or "damaged"

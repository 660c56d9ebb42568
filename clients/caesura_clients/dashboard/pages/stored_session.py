"""Reads the session of a page from the journal while the service does not hold it."""

from __future__ import annotations

from nicegui import background_tasks, run

from caesura_clients.dashboard.network_follower import NetworkFollower
from caesura_clients.session_state_reader import Update
from caesura_protocol.errors import CaesuraError, ProtocolError

AGAIN_S = 2.0  # after the first query; the interval doubles
LONGEST_S = 60.0


class StoredSession:
    """One session of a page, which was read from the journal when the page was opened."""

    def __init__(
        self, gateway: NetworkFollower, station: str, session: str, *, was_read: bool = False
    ) -> None:
        """was_read: the service has answered a query for it already."""
        self._gateway, self._named = gateway, (station, session)
        self._wait_s, self._due_s = AGAIN_S, gateway.clock() + AGAIN_S
        self._is_read = False  # a query is under way
        self.is_missing = was_read  # if it is not known now, the service has no such session

    def follow(self, update: Update | None) -> None:
        """Read the session if it is not known: at once if it was known before, then repeatedly.

        update: its state. The service may be absent, or newer sessions have taken its place.
        """
        now = self._gateway.clock()
        if update is not None:
            self.is_missing = False
            self._wait_s, self._due_s = AGAIN_S, now
        elif now >= self._due_s and not self._is_read:
            self._is_read = True
            background_tasks.create(self._read())

    async def _read(self) -> None:
        try:
            await run.io_bound(self._gateway.read_stored, *self._named)
            self.is_missing = True
        except (CaesuraError, ProtocolError):
            self.is_missing = False  # the service has not answered: nothing is known
        finally:
            self._due_s = self._gateway.clock() + self._wait_s
            self._wait_s, self._is_read = min(2.0 * self._wait_s, LONGEST_S), False

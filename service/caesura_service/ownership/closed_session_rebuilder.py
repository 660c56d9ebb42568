"""Rebuilds closed sessions for an edit, one journal record at a time.

A session restored from its outcome has no pipeline. Replaying an hour takes seconds, and other stations must
not wait for it, neither with their samples nor with rebuilds of their own. Until the end the client gets
`overloaded`, and must retry.
"""

from __future__ import annotations

from collections.abc import Generator, Set

from caesura_protocol.errors import ErrorCode, ProtocolError
from caesura_service.journal import JournalError, Key, PeerJournalError
from caesura_service.ownership.session_copies import JournalSet, SessionCopies
from caesura_service.ownership.takeover import NotRecordedError, Takeover
from caesura_service.publishing.events import Output, Owner, TakeoverFailed
from caesura_service.sessions.session import Session


class ClosedSessionRebuilder:
    """The rebuilds in progress, by station and session."""

    def __init__(self, takeover: Takeover, journals: JournalSet) -> None:
        self._takeover = takeover
        self._journals = journals
        self._under_way: dict[Key, Generator[list[Output], None, None]] = {}
        self._failed: dict[Key, tuple[ErrorCode, str]] = {}

    @property
    def stations(self) -> Set[str]:
        """The stations with a rebuild in progress."""
        return {station for station, _ in self._under_way}

    def request(self, station: str, session: Session, owner: Owner) -> ProtocolError:
        """Start or continue a rebuild; return the answer to the editing client.

        Raises ProtocolError `conflict` if the session cannot be rebuilt, `overloaded` if it cannot be rebuilt
        now, JournalError.
        """
        key = (station, session.name)
        if key not in self._under_way:
            if (failed := self._failed.pop(key, None)) is not None:
                code, why = failed
                raise ProtocolError(code, f"the session cannot be corrected: {why}", value=session.name)
            copies = self._journals.copies_of_station(station, session.name).get(session.name)
            if copies is None:
                why = "the journal no longer has the session's samples: it cannot be corrected"
                raise ProtocolError("conflict", why, value=session.name)
            self._under_way[key] = self._rebuild(key, session, copies, owner)
        why = "the session is being rebuilt from the journal: try again"
        return ProtocolError("overloaded", why, value=session.name)

    def step(self, station: str) -> list[Output]:
        """Replay one more record of the station's first rebuild; return the outputs."""
        key = next((key for key in self._under_way if key[0] == station), None)
        if key is None:
            return []
        try:
            return next(self._under_way[key])
        except StopIteration:
            self._under_way.pop(key, None)
        except Exception as error:
            self._under_way.pop(key, None)
            is_passing = isinstance(error, NotRecordedError | PeerJournalError)
            self._failed[key] = (
                "overloaded" if is_passing else "conflict",
                f"{type(error).__name__}: {error}",
            )
            return [TakeoverFailed(*key, error)]
        return []

    def cancel(self, station: str) -> None:
        """Cancel the rebuilds of a station, whose sessions have changed."""
        for key in [key for key in self._under_way if key[0] == station]:
            self._under_way.pop(key).close()

    def _rebuild(
        self, key: Key, session: Session, copies: SessionCopies, owner: Owner
    ) -> Generator[list[Output], None, None]:
        work = self._takeover.rebuild(copies, owner)
        while True:
            try:
                outputs = next(work)
            except StopIteration as done:
                rebuilt: Session | None = done.value
                break
            for one in outputs:
                if isinstance(one, TakeoverFailed):
                    self._failed[key] = "conflict", str(one.error)
            yield outputs
        if rebuilt is None:
            return
        if rebuilt.is_open or rebuilt.revision != session.revision:
            raise JournalError(
                f"its records end at revision {rebuilt.revision}, {rebuilt.state.lifecycle}; "
                f"expected revision {session.revision}, closed"
            )
        session.adopt_rebuilt(rebuilt)

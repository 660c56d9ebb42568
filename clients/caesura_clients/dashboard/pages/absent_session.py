"""The content of a session's page while the service has no such session."""

from __future__ import annotations

from collections.abc import Sequence

from nicegui.element import Element

from caesura_clients.dashboard.pages.layout import text

WHY_ABSENT = (
    "Its name may be mistyped, or the journal has removed it because of its age or size. "
    "If it is only now being taught, it appears here by itself."
)
LINKED = 5  # sessions of the station


class AbsentSession:
    """Text and links of a page whose session the service does not have."""

    def __init__(self, station: str, session: str) -> None:
        self._station, self._listed = station, tuple[str, ...]()
        self._all = Element("div").classes("absent-session")
        with self._all:
            text("p", f"There is no session {session} at station {station}.").props('role="status"')
            text("p", WHY_ABSENT)
            text("a", "Go to the list of sessions").props('href="/sessions"')
            self._others = Element("div")
        self._all.set_visibility(False)

    def show(self, sessions: Sequence[str] | None) -> None:
        """Show it with links to sessions of the station, the newest first; None: hide it."""
        self._all.set_visibility(sessions is not None)
        listed = tuple((sessions or ())[:LINKED])
        if listed == self._listed:
            return
        self._listed = listed
        self._others.clear()
        if not listed:
            return
        with self._others:
            text("h2", f"Newest sessions of {self._station}")
            with Element("ul").classes("links"):
                for session in listed:
                    with Element("li"):
                        text("a", session).props(f'href="/sessions/{self._station}/{session}"')

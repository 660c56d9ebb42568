"""What the banner of a station shows: the active hints of what is being taught, the newest first."""

from __future__ import annotations

from typing import Any

from caesura_clients.results import Update


def banner_of(update: Update | None) -> dict[str, Any]:
    """The payload of the banner; no hint without a session, and none of one that is over."""
    active = [] if update is None or update.closed else [one for one in update.hints if one.until is None]
    newest_first = sorted(active, key=lambda hint: -hint.since)
    return {"hints": [{"kind": one.kind, "text": one.text, "advice": one.advice} for one in newest_first]}

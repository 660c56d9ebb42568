"""Banner of a station: the active hints of the current session, the newest first."""

from __future__ import annotations

from typing import Any

from caesura_clients.dashboard.station_summary import session_clock
from caesura_clients.session_state_reader import Update
from caesura_protocol.messages import Hint


def banner_of(update: Update | None) -> dict[str, Any]:
    """Return the payload of the banner; no hints without a session or for a closed one."""
    active = [] if update is None or update.closed else [one for one in update.hints if one.until is None]
    newest_first = sorted(active, key=lambda hint: -hint.since)
    return {"hints": [_shown(one, update) for one in newest_first if update is not None]}


def _shown(hint: Hint, update: Update) -> dict[str, Any]:
    """Return the payload of a hint, with a link to the part to replace if the hint concerns one."""
    key = f"{hint.kind} {hint.since}"
    clock = session_clock(update)
    text, advice = clock.text(hint.text), clock.text(hint.advice)
    shown = {"key": key, "kind": hint.kind, "text": text, "advice": advice}
    if hint.t0 is None or hint.tn is None or hint.tn <= hint.t0:
        return shown
    part = f"the apps of {clock.shown(hint.t0, 1)} to {clock.shown(hint.tn, 1)} s: Edit, Teach again"
    return shown | {"href": f"/sessions/{update.station}/{update.session}", "link": f"Replace {part}"}

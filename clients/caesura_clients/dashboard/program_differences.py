"""Two versions of one program side by side: which apps differ, and in which values.

A version is the inferred program with the effective edits up to one of them. The service recomputes it, so
versions exist after a restart too. Apps of two versions are the same if their kind, their taught time and the
edit that added them are equal; moving an app does not change these.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from typing import Any

from caesura_clients.dashboard.correction_requests import EditRefused, said
from caesura_clients.query import program_at_edit
from caesura_protocol.app_kinds import app_number, app_title
from caesura_protocol.errors import CaesuraError, ProtocolError
from caesura_protocol.messages import App, Program
from caesura_protocol.number_words import counted
from caesura_protocol.programs.comparison import field_differences
from caesura_protocol.transport.transport_interface import Transport

Row = dict[str, Any]
NO_EDIT = 0  # the number of the version without edits


def compared_versions(
    transport: Transport, station: str, session: str, request: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the comparison of two versions: {said, rows}.

    request: the numbers of their last edits, {from, to}. A row is {app, was, changes}, each change [value,
    before, after]. Raises EditRefused.
    """
    numbers = [request.get(name) for name in ("from", "to")]
    if not all(type(number) is int and number >= NO_EDIT for number in numbers):
        raise EditRefused("Not compared: choose two versions.")
    try:
        before, after = (program_at_edit(transport, station, session, int(number or 0)) for number in numbers)
    except (ProtocolError, CaesuraError) as error:
        raise EditRefused(said(error, lead="Not compared")) from error
    return _outcome(before, after)


def _outcome(before: Program, after: Program) -> dict[str, Any]:
    rows = differing(before.apps, after.apps)
    count = counted(len(rows), "app")
    said = [f"{count} {'differs' if len(rows) == 1 else 'differ'}" if rows else "no app differs"]
    if before.name != after.name:
        said.append(f"the name is {after.name or 'none'}, was {before.name or 'none'}")
    words = "; ".join(said)
    return {"said": f"{words[0].upper()}{words[1:]}.", "rows": rows}


def differing(before: Sequence[App], after: Sequence[App]) -> list[Row]:
    """Return the apps that differ, in the order of the later version; a deleted one at its earlier place."""
    places: defaultdict[object, deque[int]] = defaultdict(deque)
    for index, app in enumerate(before):
        places[_identity(app)].append(index)
    rows: list[tuple[float, Row]] = []
    for index, app in enumerate(after):
        known = places[_identity(app)]
        if not known:
            rows.append((index, _row(after, index, "added")))
        elif changes := _changes(before, known[0], after, index):
            rows.append((index, _row(after, index, "", changes)))
        if known:
            known.popleft()
    gone = sorted(index for rest in places.values() for index in rest)
    rows += [(index - 0.5, _row(before, index, "left out")) for index in gone]
    return [row for _, row in sorted(rows, key=lambda one: one[0])]


def _identity(app: App) -> object:
    return app.kind, app.t0, app.tn, app.added


def _row(apps: Sequence[App], index: int, was: str, changes: Sequence[Sequence[str]] = ()) -> Row:
    app = apps[index]
    name = f"{app_number(index)} · {_title(app)}"
    return {"app": name, "was": was, "changes": [list(one) for one in changes]}


def _title(app: App) -> str:
    return app.name or app_title(app.kind)


def _changes(before: Sequence[App], old: int, after: Sequence[App], new: int) -> list[tuple[str, str, str]]:
    """Return the values that differ; the place counts only if an edit moved this app, not its neighbours."""
    found = [
        (one.what, one.other, one.one) if one.one else (one.what, "", one.apart)
        for one in field_differences(after[new], before[old])
    ]
    if _moves(after[new]) != _moves(before[old]):
        found.append(_place_change(old, after, new))
    return found


def _place_change(old: int, after: Sequence[App], new: int) -> tuple[str, str, str]:
    """Return the change of a place; where other edits left the number equal, the app before is named."""
    if old != new:
        return "place", f"{app_number(old)}", f"{app_number(new)}"
    behind = f"after {_title(after[new - 1])}" if new else "the first"
    return "place", "", f"{app_number(new)}, {behind}"


def _moves(app: App) -> list[int]:
    return [mark.edit for mark in app.changes if mark.field == "place"]

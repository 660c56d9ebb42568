"""The task program as a timeline: a card per app with text, units, and a drawing of its path."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from caesura_clients.dashboard.drawing_updates import common
from caesura_clients.dashboard.program_edits import app_editing, checked, editing_of
from caesura_clients.dashboard.program_path import program_path, target_before
from caesura_protocol.app_force_limit import is_limited, is_path_limited, path_force_in_words, rests_in_words
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.command_line_advice import on_page
from caesura_protocol.messages import App, Program, Quaternion, Vector
from caesura_protocol.number_words import counted, fixed
from caesura_protocol.programs.app_time_shifts import speed_in_words
from caesura_protocol.programs.path_drawing import path_svg
from caesura_protocol.reproduced_path import NAMED_TURN_RAD, turn_of
from caesura_protocol.rotations import roll_pitch_yaw
from caesura_protocol.screw_torque_and_text import screw_in_words
from caesura_protocol.session_time_display import NO_OFFSET, SessionClock

LISTED = 100  # apps of which a page has cards at a time
DRAWN = 200  # apps that a program may have whose whole path is drawn; of a longer one, the path of the cards
ROWS = {"apps": "before", "path": "pathBefore"}  # what a page has row by row, and how many come before

Row = dict[str, Any]
Findings = Mapping[int, list[list[str]]]


class Timeline:
    """The timeline of a growing program, as the page shows it; unchanged rows are reused."""

    def __init__(self, listed: int = LISTED, drawn: int = DRAWN) -> None:
        """listed: number of apps that are listed at a time. drawn: of a program whose whole path is drawn."""
        self._listed, self._drawn = listed, drawn
        self._apps: Sequence[App] = ()
        self._placed: Sequence[App] = ()  # at the times of the document
        self._cards: dict[int, Row] = {}
        self._path: list[Row] = []  # of the apps from `_path_before` on
        self._path_before = 0

    def of(
        self, program: Program, clock: SessionClock = NO_OFFSET, last: int | None = None
    ) -> dict[str, Any]:
        """Return the payload of a program: a part of its apps, the numbers of those around it, and the path.

        clock: of the session, for text; times in apps and path are on the clock of the samples. last: the
        number of the last app of the part; None for the newest apps.
        """
        count = len(program.apps)
        end = count if last is None else min(count, max(last, self._listed))
        before = max(0, end - self._listed)
        drawn = (0, count) if count <= self._drawn else (before, end)
        placed, of_program, of_apps = checked(program, clock)
        self._make_path(placed[: drawn[1]], drawn[0])
        self._make_cards(program.apps, before, end, of_apps)
        return {
            **editing_of(program, clock),
            "start": clock.start_s,
            "findings": of_program,
            "found": [index + 1 for index, found in sorted(of_apps.items()) if found],
            "version": program.version,
            "complete": program.complete,
            "author": program.author or "",
            "edited": program.edited,
            "notes": [clock.text(on_page(note)) for note in program.notes],
            "before": before,
            "after": count - end,
            "pathBefore": drawn[0],
            "pathAfter": count - drawn[1],
            "path": self._path,
            "apps": list(self._cards.values()),
        }

    def _make_path(self, placed: Sequence[App], before: int) -> None:
        """Rebuild the path's rows from the first app that differs on; all rows if their start has changed."""
        begins_alike = target_before(self._placed, before) == target_before(placed, before)
        is_known = begins_alike and before >= self._path_before
        first = _first_other(self._placed, placed, before) if is_known else before
        kept = [row for row in self._path if before < row["number"] <= first]
        self._path, self._placed, self._path_before = kept + program_path(placed, first), placed, before

    def _make_cards(self, apps: Sequence[App], before: int, end: int, findings: Findings) -> None:
        """Rebuild the cards from the one before the first changed app on, and those with other findings.

        A card states the two apps before it and the one after it.
        """
        first = _first_other(self._apps, apps, max(0, before - 2))
        cards = {}
        for index in range(before, end):
            found = findings.get(index, [])
            known = self._cards.get(index) if index < first - 1 else None
            if known is None or known["findings"] != found:
                known = card(index + 1, apps[index]) | app_editing(apps, index) | {"findings": found}
            cards[index] = known
        self._cards, self._apps = cards, apps


def _first_other(before: Sequence[App], after: Sequence[App], begin: int) -> int:
    """Return the number of the first app from `begin` on that differs."""
    return begin + common(before[begin:], after[begin:])


def changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of `after` that a page with `before` lacks; empty if nothing is new.

    Both are payloads of `Timeline.of`. Rows are {first, rows}: they replace those from number `first` on.
    """
    if before.get("session") != after["session"]:
        before = {}
    found = {name: value for name, value in after.items() if name not in before or before[name] != value}
    for name in ROWS.keys() & found.keys():
        known = [row for row in before.get(name, ()) if row["number"] > after[ROWS[name]]]
        same = common(known, after[name])
        first = 1 + (after[name][same - 1]["number"] if same else after[ROWS[name]])
        found[name] = {"first": first, "rows": after[name][same:]}
    return found


def card(number: int, app: App) -> dict[str, Any]:
    """Return the payload of one app.

    Lines are (name, value with unit); drawing: an svg element of its path.
    """
    return {
        "number": number,
        "kind": app.kind,
        "title": APP_KINDS[app.kind].title,
        "t0": round(app.t0, 2),
        "tn": round(app.tn, 2),
        "confidence": round(app.confidence, 2),
        "segments": list(app.segments),
        "limited": is_limited(app) and not any(mark.field == "force_n" for mark in app.changes),
        "drawing": path_svg(app),
        "lines": [[name, value] for name, value in _lines(app) if value],
    }


def _lines(app: App) -> list[tuple[str, str]]:
    return [
        ("target", "" if app.target is None else vector(scaled(app.target, 1000.0), "mm", 0)),
        ("position", app.target_name or ""),
        ("orientation", "" if app.orientation is None else orientation(app.orientation)),
        ("path", path(app)),
        ("speed", speed_in_words(app)),
        ("turn", "" if app.screw is None else screw_in_words(app.screw)),
        ("force", force(app)),
        ("rests", rests_in_words(app)),
        ("load", load(app)),
        ("gripper", "" if app.gripper_width is None else f"{fixed(1000 * app.gripper_width, 0)} mm"),
    ]


def scaled(values: Vector, factor: float) -> Vector:
    """Return the vector multiplied by a factor, to convert its unit."""
    x, y, z = values
    return factor * x, factor * y, factor * z


def vector(values: Vector | None, unit: str, digits: int) -> str:
    """Return the vector as text, (x, y, z) with its unit.

    >>> vector((0.3, -0.00001, 0.25), "m", 3)
    '(0.300, 0.000, 0.250) m'
    """
    if values is None:
        return ""
    return f"({', '.join(f'{round(v, digits) + 0.0:.{digits}f}' for v in values)}) {unit}"


def orientation(quaternion: Quaternion) -> str:
    """Return an orientation as text: the turns about the base's x, then y, then z.

    >>> orientation((1.0, 0.0, 0.0, 0.0))
    'x 180°, y 0°, z 0°'
    """
    degrees = (round(math.degrees(turn)) for turn in roll_pitch_yaw(quaternion))
    turns = zip("xyz", (180 if turn == -180 else turn for turn in degrees), strict=True)
    return ", ".join(f"{axis} {turn}°" for axis, turn in turns)


def path(app: App) -> str:
    """Return an app's path as text: its length, turn, via points and deviation; empty without a path."""
    if app.path is None:
        return ""
    via, off = len(app.path.via), f"within {fixed(1000 * app.path.deviation_m, 1)} mm"
    turn = turn_of(app)
    turned = f"turns {math.degrees(turn):.0f}°, " if turn >= NAMED_TURN_RAD else ""
    way = f"{counted(via, 'via point')}, {off}" if via else f"straight {off}"
    return f"{fixed(1000 * app.path.length_m, 0)} mm, {turned}{way}"


def force(app: App) -> str:
    """Return the force that the robot exerts as text, with the taught one if a limit has reduced it."""
    limited = f", limited to {path_force_in_words(app)}" if is_path_limited(app) else ""
    return f"{vector(app.force, 'N', 1)}{limited}"


def load(app: App) -> str:
    """Return the carried load with its standard deviation [kg] as text; empty without a load."""
    if app.load_kg is None:
        return ""
    spread = "" if app.load_sd_kg is None else f" ± {fixed(app.load_sd_kg, 2)}"
    return f"{fixed(app.load_kg, 2)}{spread} kg"

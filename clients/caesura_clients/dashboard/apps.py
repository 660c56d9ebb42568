"""The task program as a timeline: one card an app: words, units, and its path drawn."""

from __future__ import annotations

import math
from typing import Any

from caesura_clients.dashboard.program_edits import app_editing, checked, editing_of
from caesura_clients.dashboard.program_path import program_path
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.force_limit import force_in_words, is_limited
from caesura_protocol.messages import App, Program, Vector
from caesura_protocol.number_words import fixed
from caesura_protocol.paths import NAMED_TURN_RAD, turn_of
from caesura_protocol.programs.path_drawing import path_svg
from caesura_protocol.screw_motion import screw_in_words

NEWEST = 100  # apps that are drawn


def timeline(program: Program, newest: int = NEWEST) -> dict[str, Any]:
    """What the page shows of a program; of a long one the newest apps, and how many come before them."""
    before = max(0, len(program.apps) - newest)
    apps, of_program, of_apps = checked(program)
    return {
        **editing_of(program),
        "findings": of_program,
        "version": program.version,
        "complete": program.complete,
        "author": program.author or "",
        "edited": program.edited,
        "notes": list(program.notes),
        "before": before,
        "path": program_path(apps, before),
        "apps": [
            card(index + 1, program.apps[index])
            | app_editing(program.apps, index)
            | {"findings": of_apps.get(index, [])}
            for index in range(before, len(program.apps))
        ],
    }


def card(number: int, app: App) -> dict[str, Any]:
    """One app in words, with its path drawn. Lines are (name, value with unit); drawing: an svg element."""
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
    taught = f"{vector(app.force_taught, 'N', 1)}: {force_in_words(app)}" if is_limited(app) else ""
    return [
        ("target", "" if app.target is None else vector(scaled(app.target, 1000.0), "mm", 0)),
        ("path", path(app)),
        ("turn", "" if app.screw is None else screw_in_words(app.screw)),
        ("force", vector(app.force, "N", 1)),
        ("taught", taught),
        ("load", load(app)),
        ("gripper", "" if app.gripper_width is None else f"{fixed(1000 * app.gripper_width, 0)} mm"),
    ]


def scaled(values: Vector, factor: float) -> Vector:
    """The vector in another unit."""
    x, y, z = values
    return factor * x, factor * y, factor * z


def vector(values: Vector | None, unit: str, digits: int) -> str:
    """(x, y, z) with its unit.

    >>> vector((0.3, -0.00001, 0.25), "m", 3)
    '(0.300, 0.000, 0.250) m'
    """
    if values is None:
        return ""
    return f"({', '.join(f'{round(v, digits) + 0.0:.{digits}f}' for v in values)}) {unit}"


def path(app: App) -> str:
    """How long the way was, by how many via points it leads, and how far it is off at most."""
    if app.path is None:
        return ""
    via, off = len(app.path.via), f"within {fixed(1000 * app.path.deviation_m, 1)} mm"
    turn = turn_of(app)
    turned = f"turns {math.degrees(turn):.0f}°, " if turn >= NAMED_TURN_RAD else ""
    way = f"{via} via point{'s' if via > 1 else ''}, {off}" if via else f"straight {off}"
    return f"{fixed(1000 * app.path.length_m, 0)} mm, {turned}{way}"


def load(app: App) -> str:
    """What is carried, with its uncertainty."""
    if app.load_kg is None:
        return ""
    spread = "" if app.load_sd_kg is None else f" ± {fixed(app.load_sd_kg, 2)}"
    return f"{fixed(app.load_kg, 2)}{spread} kg"

"""The path of a task program as points in time and space, for the drawing in three dimensions.

An app's row is {number, words, kind, points, via, force}. A point is [t, x, y, z]: time of the program [s]
and base frame [mm]. Times are those of the program's document (`programs.app_time_shifts`): the taught times,
unless an operator changed order or speed. Points lie on the path that the robot follows
(`reproduced_path.curve_of`), within the app's tolerance of the taught path. An app without a path is a
straight line to its target, and one that stays is its position at start and end. An app whose position is
unknown has no row.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_kinds import APP_KINDS, app_title
from caesura_protocol.messages import App, Vector
from caesura_protocol.reproduced_path import curve_of

Array = NDArray[np.float64]

PARTS = 5  # points of a leg of a path
MM = 1000.0


class _Drawn(NamedTuple):
    points: list[list[float]]
    via: list[list[float]]


def program_path(apps: Sequence[App], first: int = 0) -> list[dict[str, Any]]:
    """Return the rows of the apps from number `first` on, counted from 0.

    apps: at the times of the document.
    """
    rows: list[dict[str, Any]] = []
    place = target_before(apps, first)
    for index in range(first, len(apps)):
        app = apps[index]
        drawn = _drawn(app, place)
        place = app.target or place
        if drawn.points:
            rows.append({"number": index + 1} | _look(app) | drawn._asdict())
    return rows


def _look(app: App) -> dict[str, Any]:
    """Return an app's name, the kind that determines its colour, and the force [N] that the robot exerts."""
    moving, staying = APP_KINDS[app.kind].drawn_as
    kind = "turning" if app.screw is not None else moving if app.path is not None else staying
    force = None if app.force is None else [round(value, 2) for value in app.force]
    return {"words": app.name or app_title(app.kind), "kind": kind, "force": force}


def target_before(apps: Sequence[App], first: int) -> Vector | None:
    """Return the target [m] of the last app before number `first` that has one; None if none has."""
    return next((app.target for app in reversed(apps[:first]) if app.target is not None), None)


def _drawn(app: App, place: Vector | None) -> _Drawn:
    """Return points and via points of an app. place: where the app before it ended [m]."""

    def rows(t: Array, values: Array) -> list[list[float]]:
        table: list[list[float]] = (
            np.column_stack([t.round(2), (MM * values[:, :3]).round(1)]) + 0.0
        ).tolist()
        return table

    if app.path is not None and app.target is not None:
        curve = curve_of(app)
        t = np.interp(np.arange(PARTS * (len(curve.t) - 1) + 1) / PARTS, np.arange(len(curve.t)), curve.t)
        return _Drawn(rows(t, curve.sampled(PARTS)), rows(curve.t[1:-1], curve.values[1:-1]))
    goal = app.target or place
    start = place if place is not None and APP_KINDS[app.kind].travels else goal
    return _Drawn([] if goal is None else rows(np.array([app.t0, app.tn]), np.array([start, goal])), [])

"""The fields of an app that an edit may set: how each is read and set, and which kinds of app have it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, get_args

from caesura_protocol.app_force_limit import LEAST_FORCE_N, is_press
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, AppField, RestForce, Vector
from caesura_protocol.programs.app_time_shifts import may_retime

FIELDS: tuple[AppField, ...] = get_args(AppField)


def value(app: App, name: str) -> Any:
    """Return the value of a field in the form of an edit; None if the app has none."""
    match name:
        case "force_n":
            return None if app.force is None else math.hypot(*app.force)
        case "tolerance_m":
            return None if app.path is None else app.path.tolerance_m
        case _:
            return getattr(app, name)


def _set_target(app: App, target: Vector) -> dict[str, Any]:
    """Return the fields of an app with another target.

    It has no joints, because none were taught there. Its path ends at rest, and its stated deviation grows by
    the shift.
    """
    if target == app.target:
        return {}
    path = app.path
    if path is not None and app.target is not None:
        off_m = path.deviation_m + math.dist(target, app.target)
        rests = {"end_velocity": None, "end_angular_velocity": None}
        path = path.model_copy(update={"deviation_m": off_m, **rests})
    return {"target": target, "joints": None, "path": path}


def _set_force(app: App, newtons: float) -> dict[str, Any]:
    """Return the fields of an app with another force [N]; its rests change by the same factor."""
    direction = _direction(app)
    x, y, z = (newtons / math.hypot(*direction) * component for component in direction)
    factor = newtons / max(math.hypot(*(app.force or direction)), LEAST_FORCE_N)
    rests = (("rest_before", app.rest_before), ("rest_after", app.rest_after))
    pressed = {name: _pressed(rest, factor, newtons) for name, rest in rests if rest is not None}
    return {"force": (x, y, z), **pressed}


def _pressed(rest: RestForce, factor: float, newtons: float) -> RestForce:
    """Return a rest with its force times a factor, at most the force of its stroke or its own before.

    Both of these are within the limit.
    """
    most = max(rest.newton, newtons)
    return rest.model_copy(update={"newton": min(factor * rest.newton, most)})


def _set_tolerance(app: App, tolerance_m: float) -> dict[str, Any]:
    return {"path": app.path and app.path.model_copy(update={"tolerance_m": tolerance_m})}


def _set(name: str) -> Callable[[App, Any], dict[str, Any]]:
    return lambda _, value: {name: value}


#: Fields on which no other one depends, and which depend on none.
SIMPLE_FIELDS = frozenset(("name", "note", "target_name", "speed", "gripper_width"))

SETTERS: Mapping[str, Callable[[App, Any], dict[str, Any]]] = {
    **{name: _set(name) for name in SIMPLE_FIELDS},
    "target": _set_target,
    "force_n": _set_force,
    "tolerance_m": _set_tolerance,
}


def _direction(app: App) -> Vector:
    return app.force_taught or app.force or (0.0, 0.0, 0.0)


def _lacks_force(app: App) -> str:
    if not APP_KINDS[app.kind].presses or app.force is None:
        return "exerts no force"
    return "" if is_press(math.hypot(*_direction(app))) else "has no direction of force that was taught"


#: Why an app cannot have a field, empty where it can; fields that are not here every app has.
LACKS: Mapping[str, Callable[[App], str]] = {
    "target": lambda app: "" if "target" in APP_KINDS[app.kind].ports else "has no target",
    "target_name": lambda app: "has no target" if app.target is None else "",
    "speed": lambda app: "" if may_retime(app) else "is no movement in free space: its speed stays as taught",
    "force_n": _lacks_force,
    "tolerance_m": lambda app: "has no path" if app.path is None else "",
    "gripper_width": lambda app: "" if "width" in APP_KINDS[app.kind].ports else "moves no fingers",
}

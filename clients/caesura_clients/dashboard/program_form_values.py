"""Converts the values of an app to those of a form: texts, and rounded numbers in the units of the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.programs.app_time_shifts import may_retime

TEXTS = ("name", "note", "target_name")
SCALES: Mapping[str, tuple[float, int]] = {  # from the wire to the page, and the decimals there
    "target": (1000.0, 1),
    "speed": (100.0, 0),
    "force_n": (1.0, 2),
    "tolerance_m": (1000.0, 2),
    "gripper_width": (1000.0, 1),
}


def shown_texts(app: App) -> dict[str, str]:
    """Return the name, note and position name of an app; empty texts where it has none."""
    return {name: getattr(app, name) or "" for name in TEXTS}


def shown_numbers(app: App) -> dict[str, Any]:
    """Return the editable numbers of an app by field."""
    return {name: shown_value(name, read(app)) for name, has, read in _NUMBERS if has(app)}


def shown_values(app: App) -> dict[str, Any]:
    """Return the texts and editable numbers of an app by field."""
    return {**shown_texts(app), **shown_numbers(app)}


def shown_value(field: str, value: Any) -> Any:
    """Return a value of a message in the units of the page.

    >>> shown_value("target", (0.3, 0.0, 0.25004)), shown_value("speed", 0.5), shown_value("name", "home")
    ([300.0, 0.0, 250.0], 50, 'home')
    """
    if field not in SCALES or value is None:
        return value
    scale, digits = SCALES[field]
    if isinstance(value, Sequence):
        return [round(scale * one, digits) for one in value]
    return round(scale * value, digits or None)


_NUMBERS: Sequence[tuple[str, Callable[[App], bool], Callable[[App], Any]]] = (
    (
        "target",
        lambda app: "target" in APP_KINDS[app.kind].ports and app.target is not None,
        lambda app: app.target,
    ),
    ("speed", may_retime, lambda app: app.speed or 1.0),
    (
        "force_n",
        lambda app: APP_KINDS[app.kind].presses and app.force is not None,
        lambda app: math.hypot(*(app.force or ())),
    ),
    ("tolerance_m", lambda app: app.path is not None, lambda app: app.path.tolerance_m if app.path else 0.0),
    ("gripper_width", lambda app: "width" in APP_KINDS[app.kind].ports, lambda app: app.gripper_width),
)

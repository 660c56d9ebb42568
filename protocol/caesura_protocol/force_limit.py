"""Force limits of a cell or an operator, applied to the forces of a program."""

from __future__ import annotations

import math

from caesura_protocol.messages import App
from caesura_protocol.number_words import fixed


def with_force_limit(app: App, limit_n: float) -> App:
    """The app, exerting no more than that [N]; one that exerts less, or nothing, stays as it is."""
    exerted = 0.0 if app.force is None else math.hypot(*app.force)
    if app.force is None or exerted <= limit_n:
        return app
    x, y, z = (limit_n / exerted * component for component in app.force)
    return app.model_copy(update={"force": (x, y, z), "force_taught": app.force_taught or app.force})


def force_in_words(app: App) -> str:
    """The size of an app's force, with what was taught where a limit has cut it; empty without a force."""
    if app.force is None:
        return ""
    exerted = math.hypot(*app.force)
    taught = exerted if app.force_taught is None else math.hypot(*app.force_taught)
    cut = f" of {fixed(taught, 1)} N taught" if is_limited(app) else ""
    return f"{fixed(exerted, 1)} N{cut}"


def is_limited(app: App) -> bool:
    """Does an app exert less than was taught?"""
    if app.force is None or app.force_taught is None:
        return False
    return math.hypot(*app.force) < math.hypot(*app.force_taught) * (1.0 - 1e-9)

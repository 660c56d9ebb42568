"""Less force than was taught, where somebody says so."""

from __future__ import annotations

import math

from caesura_protocol.messages import App


def with_force_limit(app: App, limit_n: float) -> App:
    """The app, exerting no more than that [N]; one that exerts less, or nothing, stays as it is."""
    exerted = 0.0 if app.force is None else math.hypot(*app.force)
    if app.force is None or exerted <= limit_n:
        return app
    x, y, z = (limit_n / exerted * component for component in app.force)
    return app.model_copy(update={"force": (x, y, z)})

"""The velocity of the hand where one app continues into the next.

If one movement in the air continues into the next, the hand need not stop. A path that rests there would stop
the robot.
"""

from __future__ import annotations

from collections.abc import Sequence

from caesura_protocol.messages import App
from caesura_protocol.programs.app_time_shifts import goes_on
from caesura_service.program.apps.paths import Paths


def with_end_velocities(apps: Sequence[App], paths: Paths, before: App | None) -> tuple[App, ...]:
    """Return apps in time order whose paths state the velocities of their ends.

    The start has a velocity if the app before continues into it, the target if it continues into the next
    app. before: the app before the first one.
    """
    made: list[App] = []
    for last, app, following in zip([before, *apps], apps, [*apps[1:], None], strict=False):
        begins = last is not None and goes_on(last, app)
        ends = goes_on(app, following)
        if app.path is None or not (begins or ends):
            made.append(app)
            continue
        t0, tn = app.path.start.t, app.path.tn
        path = paths.between(t0, tn, begins_moving=begins, ends_moving=ends)
        made.append(app.model_copy(update={"path": path}))
    return tuple(made)

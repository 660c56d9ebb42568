"""The straight way of a robot to the start of a path, if the app before it ends elsewhere.

No app leads there: the taught movement between the two is in no app, or an edit has changed the apps. The
robot goes straight to the start of the path first, at the mean speed of the path. In contact a turn alone is
no way: it would drive the tool's tip into the surface.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Quaternion, Vector
from caesura_protocol.programs.app_time_shifts import TURNED_M
from caesura_protocol.programs.program_gripper import GRIPS
from caesura_protocol.reproduced_path import turn_of
from caesura_protocol.rotations import angle_between

ASTRAY_M = 0.01  # from where a path begins, from which on a robot goes there first


class WayToPath(NamedTuple):
    """A way to the start of a path: its length [m], its turn [rad], and how long it takes [s]."""

    metres: float
    radians: float
    seconds: float


def ways_to_paths(apps: Sequence[App]) -> Iterator[WayToPath | None]:
    """Yield for each app the way to the start of its path.

    None for an app without a path, before any movement, and for a start within ASTRAY_M.

    An app that only moves the fingers is run where the app before it ends, and changes no pose.
    """
    place: Vector | None = None
    orientation: Quaternion | None = None
    touches = False
    for app, following in zip(apps, [*apps[1:], None], strict=True):
        yield _way_from(place, orientation, app, turns=not touches)
        if app.kind not in GRIPS:
            place, orientation = app.target or place, app.orientation or orientation
            touches = APP_KINDS[app.kind].presses or ends_in_contact(app, following)


def _way_from(
    place: Vector | None, orientation: Quaternion | None, app: App, *, turns: bool
) -> WayToPath | None:
    """Return the way from a pose to the start of an app's path; turns: whether a turn alone is one."""
    if place is None or app.path is None:
        return None
    start = app.path.start
    metres, radians = math.dist(place, start.position), 0.0
    if orientation is not None and start.orientation is not None:
        radians = angle_between(orientation, start.orientation)
    away_m = metres + TURNED_M * radians
    if (away_m if turns else metres) <= ASTRAY_M:
        return None
    way_m = max(app.path.length_m + TURNED_M * turn_of(app), ASTRAY_M)
    return WayToPath(metres, radians, away_m / way_m * (app.path.tn - start.t))

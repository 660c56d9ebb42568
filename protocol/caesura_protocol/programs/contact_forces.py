"""The force of an app in contact, as scripts exert it: without friction, in the axes of the tool."""

from __future__ import annotations

import math

import numpy as np

from caesura_protocol.messages import App, Quaternion, Vector
from caesura_protocol.reproduced_path import curve_of
from caesura_protocol.rotations import matrix_of

SLIDE_M = 0.015  # from which on a way in contact is one along a surface, as in franky's template
MOST_FRICTION = 1.0  # coefficient of Coulomb friction, as coaching takes it
STRAIGHT_SHARE = 0.9  # of the way of a stroke, that its ends are apart
TILTED_RAD = math.radians(20.0)


def without_friction(app: App) -> App:
    """Return the app with its force along the surface normal, if it slides.

    A sliding hand also exerts the force of friction, along its path. Controllers control a force along one
    axis, and the path separately. The friction component is removed if the remaining force leans less from
    the tool's axis, the path is straight, and a coefficient up to MOST_FRICTION explains it. A larger
    component is a push. The force on an object that is pushed in, and a force along the tool, are unchanged.
    If the path tilts the tool, see `force_in_tool`.
    """
    orientation = orientation_halfway(app)
    if app.force is None or app.path is None or app.target is None or orientation is None or _is_tilted(app):
        return app
    force, way = np.array(app.force), np.subtract(app.target, app.path.start.position)
    metres, axis = float(np.linalg.norm(way)), matrix_of(orientation)[:, 2]
    rubbed_n = float(force @ way) / max(metres, SLIDE_M)
    if metres < max(SLIDE_M, STRAIGHT_SHARE * app.path.length_m) or rubbed_n <= 0.0:
        return app
    normal = force - rubbed_n / metres * way
    if rubbed_n > MOST_FRICTION * float(np.linalg.norm(normal)):
        return app
    x, y, z = normal.tolist()
    is_nearer = axis @ normal * np.linalg.norm(force) > axis @ force * np.linalg.norm(normal)
    return app.model_copy(update={"force": (x, y, z)}) if is_nearer else app


def friction_of(app: App) -> float:
    """Return the friction force [N] along its path that scripts remove from a stroke; 0 if none."""
    return math.dist(app.force or (), without_friction(app).force or ())


def touching_force(following: App | None) -> Vector | None:
    """Return the force [N] with which an app presses from the touch on; None if it does not press.

    It is also None if its path tilts the tool, because its force then differs from that of the touch.
    """
    if following is None or following.force is None or not any(following.force):
        return None
    return None if _is_tilted(following) else following.force


def force_in_tool(app: App) -> Vector | None:
    """Return the force [N] of a press in the tool's axes if its path tilts the tool: it turns with the tool.

    None if the force keeps its direction. An app's force is given at the orientation in the middle of the
    press, which is not exactly the middle of its path. So a force within 45° of the tool's axis is along that
    axis, as on the simulated robot.
    """
    halfway = orientation_halfway(app)
    if app.force is None or halfway is None or not _is_tilted(app):
        return None
    x, y, z = (matrix_of(halfway).T @ app.force).tolist()
    return (0.0, 0.0, math.hypot(x, y, z)) if z > math.hypot(x, y) else (x, y, z)


def orientation_halfway(app: App) -> Quaternion | None:
    """Return the flange's orientation halfway along an app's path; without one, at its target.

    None if it is unknown.
    """
    if app.path is None or app.path.start.orientation is None or app.orientation is None:
        return app.orientation
    curve = curve_of(app)
    x, y, z, w = curve.at(0.5 * float(curve.t[0] + curve.t[-1]))[0][3:].tolist()
    return x, y, z, w


def _is_tilted(app: App) -> bool:
    """Whether the path of an app tilts the tool by `TILTED_RAD`."""
    points = () if app.path is None else (app.path.start, *app.path.via)
    shown = [one.orientation for one in points] + [app.orientation]
    axes = [matrix_of(quaternion)[:, 2] for quaternion in shown if quaternion is not None]
    return any(float(axes[0] @ axis) < math.cos(TILTED_RAD) for axis in axes[1:])


def press_direction(app: App, following: App | None) -> Vector:
    """Return the unit vector along which a contact is searched, base frame.

    It is the direction of the following force, or else the z-axis of the tool.
    """
    force = touching_force(following)
    if force is not None:
        size = math.hypot(*force)
        x, y, z = (value / size for value in force)
    else:
        x, y, z = matrix_of(app.orientation or (1.0, 0.0, 0.0, 0.0))[:, 2].tolist()
    return x, y, z

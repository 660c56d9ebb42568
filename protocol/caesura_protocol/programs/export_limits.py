"""Limits that exporters check before they write, and functions on contacts that exporters share."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from caesura_protocol.app_force_limit import LEAST_FORCE_N, exerted_forces, is_press
from caesura_protocol.app_kinds import APP_KINDS, app_name
from caesura_protocol.messages import App, Quaternion, Vector
from caesura_protocol.programs.checks.preconditions import order_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import curve_of
from caesura_protocol.robots import RobotDescription
from caesura_protocol.rotations import matrix_of

CONSTANTS = {
    "MAX_SPEED_M_PER_S": ("speed_m_per_s", "of the flange, never faster"),
    "MAX_TURN_RAD_PER_S": ("turn_rad_per_s", "of the flange, never faster"),
    "CONTACT_SPEED_M_PER_S": ("contact_speed_m_per_s", "where a contact is looked for"),
    "MAX_FORCE_N": ("most_force_n", "that an app may ask for"),
    "STOP_FORCE_N": ("felt_force_n", "of anything: the robot stops"),
    "CONTACT_FORCE_N": ("contact_n", "from which a contact is one"),
    "SEARCH_M": (
        "search_m",
        "that a contact may be from where it was taught, and a press beyond its way",
    ),
    "MAX_LOAD_KG": ("load_kg", "in the gripper"),
    "GRASP_FORCE_N": ("grasp_force_n", "of the fingers"),
    "GRIPPER_M_PER_S": ("gripper_m_per_s", "of the fingers"),
    "WORKSPACE_LOW_M": ("workspace_low", "x, y, z of the flange in the base frame"),
    "WORKSPACE_HIGH_M": ("workspace_high", "x, y, z of the flange in the base frame"),
    "MAX_PAUSE_S": ("pause_s", "between two apps; what was taught longer is shortened"),
}
FORCE_SLACK_N = 1e-6
SLIDE_M = 0.015  # from which on a way in contact is one along a surface, as in franky's template
MOST_FRICTION = 1.0  # coefficient of Coulomb friction, as coaching takes it
STRAIGHT_SHARE = 0.9  # of the way of a stroke, that its ends are apart
TILTED_RAD = math.radians(20.0)
ACTING = (  # limits on which a running script acts; the others are kept when it is written
    "MAX_SPEED_M_PER_S",
    "CONTACT_SPEED_M_PER_S",
    "MAX_FORCE_N",
    "STOP_FORCE_N",
    "CONTACT_FORCE_N",
    "SEARCH_M",
)


def acting_limits(safety: Safety) -> Iterator[str]:
    """Yield the limits as lines of a script."""
    for name in ACTING:
        field, why = CONSTANTS[name]
        yield f"{name} = {getattr(safety, field):g}  # {why}"


def within_robot(acceleration: float, robot: RobotDescription | None) -> float:
    """Return an acceleration of the flange [m/s²], limited to half of the robot's maximum."""
    return acceleration if robot is None else min(acceleration, 0.5 * robot.flange_acceleration_limit)


def refuse_beyond_limits(program: ProgramFile) -> None:
    """Raise ValueError for an app beyond the limits of position, force or load, or without a precondition.

    A press needs a contact before it: otherwise it would begin at any position of the arm. A carry needs a
    grasp: otherwise the robot would compensate a load that it does not have.
    """
    safety = program.safety
    for index, app in enumerate(program.apps):
        name = app_name(index, app.kind)
        _refuse_incomplete(name, app)
        _refuse_outside(name, app, safety)
        force = max((one.newton for one in exerted_forces(app)), default=0.0)
        if force > safety.most_force_n + FORCE_SLACK_N:
            raise ValueError(f"{name}: force {force:.1f} N, at most {safety.most_force_n:.1f} N are allowed")
        if app.load_kg is not None and not 0.0 <= app.load_kg <= safety.load_kg:
            raise ValueError(f"{name}: load {app.load_kg} kg, at most {safety.load_kg} kg are allowed")
    for one in order_findings(program.apps):
        if one.index is None:
            continue
        kind = program.apps[one.index].kind
        if APP_KINDS[kind].presses or APP_KINDS[kind].carries:
            raise ValueError(f"{app_name(one.index, kind)}: {one.reason}")


def _refuse_outside(name: str, app: App, safety: Safety) -> None:
    places = [("target", app.target)]
    if app.path is not None:
        places += [("its path", point.position) for point in (app.path.start, *app.path.via)]
    for what, place in places:
        limits = zip("xyz", place or (), safety.workspace_low, safety.workspace_high, strict=False)
        for axis, value, low, high in limits:
            if not low <= value <= high:
                limit = f"the workspace is {low} to {high} m; state that of the cell with --cell"
                raise ValueError(f"{name}: {what} at {axis} {value:g} m, {limit}")


def _refuse_incomplete(name: str, app: App) -> None:
    for field in APP_KINDS[app.kind].needs:
        if getattr(app, field) is None:
            raise ValueError(f"{name} has no {field}")
    if app.path is not None and app.target is None:
        raise ValueError(f"{name} has a path, but no target")
    newtons = math.hypot(*(app.force or ()))
    if APP_KINDS[app.kind].presses and not is_press(newtons):
        expected = f"expected one with a direction, at least {LEAST_FORCE_N:g} N"
        raise ValueError(f"{name}: force {newtons:g} N, {expected}")


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

"""How a setpoint moves: along the reproduced path of an app (`caesura_protocol.paths`)."""

from __future__ import annotations

import numpy as np

from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.app_kinds import APP_KINDS, ends_in_contact
from caesura_protocol.messages import App
from caesura_protocol.paths import Curve, knots_of
from caesura_protocol.programs.safety import Safety
from caesura_protocol.rotations import angle_of_matrices, matrix_of, quaternion_of, turned_along

ALIGNED = 0.7  # cosine between tool and force, above which the tool's axis is the direction of a press
ASTRAY_M = 0.01  # from where a path was taught to start
LEAST_S = 1e-3
ARRIVING_SHARE = 0.6  # of the mean speed towards a contact is left when it is met
LEAST_SEARCH_M_PER_S = 0.01
EARLY_S, BLEND_S = 0.09, 0.3  # a via point sooner than that is no taught one; time to get onto such a path
FINE, PACE_M, TURNED_M = 40, 0.01, 0.1  # looks at a leg; between two knots of the pace; a radian of a turn


def app_path(
    app: App, position: Array, rotation: Array, seconds: float, arriving: Array | None = None
) -> Curve:
    """The reproduced path of an app from where the robot is, (3,) [m] and (3, 3), in some seconds.

    arriving: (3,) [m/s] at its target, None where it rests there.
    The speed is that which was taught. A robot that is more than `ASTRAY_M` away from where the path was
    taught to start goes there first, at the pace of the path; else it goes to the first via point. Without a
    path, straight. Where ways are compared, a radian of a turn counts as `TURNED_M`.
    """
    path, target = app.path, position if app.target is None else np.array(app.target)
    if path is None or app.target is None:
        turns = app.orientation is not None
        end = [*target, *(app.orientation or ())] if turns else target
        times, values = np.array([0.0, seconds]), np.array([end, end], dtype=np.float64)
        passing = np.full((2, 3), np.nan)
    else:
        times, values, passing = knots_of(app)
        away = float(np.linalg.norm(values[0, :3] - position))
        turn = 0.0
        if values.shape[1] == 7:
            away += TURNED_M * angle_of_matrices(rotation, matrix_of(values[0, 3:]))
            turn = float(np.linalg.norm(np.diff(turned_along(values[:, 3:]), axis=0), axis=1).sum())
        if away > ASTRAY_M:
            way = max(path.length_m + TURNED_M * turn, ASTRAY_M)
            pace = way / max(path.tn - path.start.t, LEAST_S)
            times, values = np.append(times[0] - away / pace, times), np.vstack([values[:1], values])
            passing = np.vstack([passing[:1], passing])
        slower = seconds / (times[-1] - times[0])
        times, passing = (times - times[0]) * slower, passing / slower
    if times[1] < EARLY_S:
        _blend(times, values, passing, position)
    values[0, :3] = position
    if values.shape[1] == 7:
        values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        values[0, 3:] = quaternion_of(rotation)
    curve = Curve.through(times, values, passing=passing, arriving=arriving)
    return curve if arriving is None or len(times) == 2 else _paced(curve, arriving)


def _blend(times: Array, values: Array, passing: Array, position: Array) -> None:
    """Begin a path at a position, and get onto it within `BLEND_S` in place of before its first via point."""
    aside = position - values[0, :3]
    back = Curve.through([0.0, min(BLEND_S, float(times[-1]))], [aside, np.zeros(3)])
    for knot in range(1, int(np.searchsorted(times, back.t[-1]))):
        offset, velocity, _ = back.at(float(times[knot]))
        values[knot, :3] += offset
        passing[knot] += velocity


def _paced(curve: Curve, arriving: Array) -> Curve:
    """The same path in the same time, with one rise and fall of the speed along it: minimum jerk.

    Towards a contact a hand is faster than a robot may be, so the taught speed is not followed there.
    The way along it counts a turn as `TURNED_M` a radian.
    """
    poses = curve.sampled(FINE)
    step = np.diff(poses, axis=0)
    turned = TURNED_M * 2.0 * np.linalg.norm(step[:, 3:], axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step[:, :3], axis=1) + turned)])
    if along[-1] < 1e-6:
        return curve
    seconds, end = float(curve.t[-1]), float(np.linalg.norm(arriving))
    law = Curve.through([0.0, seconds], [[0.0] * 3, [along[-1], 0.0, 0.0]], arriving=(end, 0.0, 0.0))
    ticks = np.linspace(0.0, seconds, 501)
    reached = np.maximum.accumulate([law.at(t)[0][0] for t in ticks])
    count = int(np.clip(along[-1] / PACE_M, 8, 400))
    places = np.linspace(0.0, along[-1], count + 1)
    times = np.interp(places, reached, ticks)
    knots = np.column_stack([np.interp(places, along, column) for column in poses.T])
    tangents = np.gradient(knots[:, :3], places, axis=0)
    speeds = np.array([law.at(t)[1][0] for t in times])
    times[0], times[-1] = 0.0, seconds
    return Curve.through(times, knots, passing=tangents * speeds[:, None], arriving=arriving)


def arrival_speed(way_m: float, seconds: float, safety: Safety) -> float:
    """Speed [m/s] with which a contact is met: slow, and no faster than the way to it [m] asks for."""
    fits = ARRIVING_SHARE * way_m / seconds
    return min(max(fits, LEAST_SEARCH_M_PER_S), safety.contact_speed_m_per_s)


def approach_direction(app: App, following: App | None, rotation: Array) -> Array | None:
    """Direction (3,) in which an app meets the contact that ends it; None where none does.

    It is the direction of a press that follows, else the axis of the tool. rotation: (3, 3) at the target.
    """
    if not ends_in_contact(app.kind, None if following is None else following.kind):
        return None
    force = following.force if following is not None and APP_KINDS[following.kind].presses else None
    return press_direction(rotation, None if force is None else np.array(force))


def press_direction(rotation: Array, force: Array | None) -> Array:
    """Direction (3,) of a press: the tool's axis, or the force's own where the two do not go together."""
    axis: Array = rotation[:, 2]
    if force is None:
        return axis
    own: Array = force / np.linalg.norm(force)
    return axis if float(axis @ own) > ALIGNED else own

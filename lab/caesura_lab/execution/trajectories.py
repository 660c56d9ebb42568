"""The trajectory of a setpoint: along the reproduced path of an app (`caesura_protocol.reproduced_path`)."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from caesura_lab.teacher.motion_profiles import Array
from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.messages import App, AppPath
from caesura_protocol.programs.app_time_shifts import TURNED_M
from caesura_protocol.programs.contact_forces import touching_force
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.ways_between_apps import ASTRAY_M
from caesura_protocol.reproduced_path import Curve, knots_of
from caesura_protocol.rotations import (
    align_signs,
    angle_of_matrices,
    angular_velocities,
    matrix_of,
    quaternion_of,
    turned_along,
)

ALIGNED = 0.7  # cosine between tool and force, above which the tool's axis is the direction of a press
LEAST_S = 1e-3
ARRIVING_SHARE = 0.6  # of the mean speed towards a contact is left when it is met
LEAST_SEARCH_M_PER_S, LEAST_M_PER_S = 0.01, 1e-6
EARLY_S, BLEND_S = 0.09, 0.3  # a via point sooner than that is no taught one; time to get onto such a path
SLOW_M = 0.002  # before a target that a contact ends: it may be met so much earlier
BRAKE_M_PER_S2 = 1.0  # towards a contact
KNOT_S, LEAST_KNOTS = 0.02, 8  # between two knots of a path with brakes; legs of it
EASED = 11  # knots over which braking begins
BRAKES_IN_TIME = 1.05  # of the limits of speed towards a contact, below which a path is followed as it is


def app_path(
    app: App,
    position: Array,
    rotation: Array,
    seconds: float,
    arriving: Array | None = None,
    *,
    moving: Array | None = None,
    passes_on: bool = False,
) -> Curve:
    """Return the reproduced path of an app from the robot's pose, (3,) [m] and (3, 3), in `seconds`.

    arriving: (3,) [m/s] at its target if a contact ends it; moving: (6,) [m/s], [rad/s] current velocity of
    the robot, None at rest; passes_on: whether its target has the stated velocity, otherwise it is a rest.
    The speed is the taught one. A robot more than `ASTRAY_M` from the taught start goes there first, at the
    speed of the path; otherwise it goes to the first via point. Without a path it moves straight. In
    comparisons a radian of a turn counts as `TURNED_M`.
    """
    if app.path is None or app.target is None:
        end = [*(position if app.target is None else app.target), *(app.orientation or ())]
        times, values = np.array([0.0, seconds]), np.array([end, end], dtype=np.float64)
        passing = np.full((2, 6), np.nan)
    else:
        times, values, passing = _taught_knots(app, app.path, position, rotation)
        slower = seconds / (times[-1] - times[0])
        times, passing = (times - times[0]) * slower, passing / slower
    here = position
    if values.shape[1] == 7:
        values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        here = np.append(position, quaternion_of(rotation))
        align_signs(values[:, 3:])
        here[3:] *= np.copysign(1.0, here[3:] @ values[0, 3:])
    if times[1] < EARLY_S:
        _blend(times, values, passing, here)
    values[0] = here
    passing[0] = np.nan if moving is None else moving
    if not passes_on:
        passing[-1] = np.nan
    if arriving is not None:
        passing[-1, :3] = arriving
    curve = Curve.through(times, values, passing=passing)
    return curve if arriving is None else _braked(curve, arriving)


def _taught_knots(app: App, path: AppPath, position: Array, rotation: Array) -> tuple[Array, Array, Array]:
    """Return the knots of the taught path, with the way to its start if the robot is far from it.

    As `knots_of`: times (n,) [s], poses (n, c) and velocities (n, 6).
    """
    times, values, passing = knots_of(app)
    away = float(np.linalg.norm(values[0, :3] - position))
    turn = 0.0
    if values.shape[1] == 7:
        away += TURNED_M * angle_of_matrices(rotation, matrix_of(values[0, 3:]))
        turn = float(np.linalg.norm(np.diff(turned_along(values[:, 3:]), axis=0), axis=1).sum())
    if away <= ASTRAY_M:
        return times, values, passing
    way = max(path.length_m + TURNED_M * turn, ASTRAY_M)
    pace = way / max(path.tn - path.start.t, LEAST_S)
    return (
        np.append(times[0] - away / pace, times),
        np.vstack([values[:1], values]),
        np.vstack([passing[:1], passing]),
    )


def _blend(times: Array, values: Array, passing: Array, here: Array) -> None:
    """Begin a path at a pose (c,), and join it within `BLEND_S`, not before its first via point."""
    aside = here - values[0]
    back = Curve.through([0.0, min(BLEND_S, float(times[-1]))], [aside, np.zeros_like(aside)])
    for knot in range(1, int(np.searchsorted(times, back.t[-1]))):
        offset, velocity, _ = back.at(float(times[knot]))
        values[knot] += offset
        passing[knot, :3] += velocity[:3]
        if len(here) == 7:
            values[knot, 3:] /= np.linalg.norm(values[knot, 3:])
            passing[knot, 3:] += angular_velocities(values[None, knot, 3:], velocity[None, 3:])[0]


def _braked(curve: Curve, arriving: Array) -> Curve:
    """Return the same path, slower than taught where it could not brake to the contact speed in time.

    A hand approaches a contact faster than a robot may. The robot brakes with about `BRAKE_M_PER_S2`, and
    starts braking gently.
    """
    taught = np.linspace(0.0, curve.t[-1], max(round(curve.t[-1] / KNOT_S), LEAST_KNOTS) + 1)
    poses, rates, _ = (np.array(column) for column in zip(*map(curve.at, taught), strict=True))
    steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    left = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    end_m_per_s = max(float(np.linalg.norm(arriving)), LEAST_M_PER_S)
    limits = np.sqrt(end_m_per_s**2 + 2.0 * BRAKE_M_PER_S2 * np.maximum(left - SLOW_M, 0.0))
    slower = np.maximum(np.linalg.norm(rates[:, :3], axis=1) / limits, 1.0)
    if slower.max() < BRAKES_IN_TIME:
        return curve
    slower = uniform_filter1d(maximum_filter1d(slower, EASED, mode="nearest"), EASED, mode="nearest")
    times = np.append(0.0, np.cumsum(np.diff(taught) * 0.5 * (slower[1:] + slower[:-1])))
    passing = Curve(taught, poses, rates, rates).passing / slower[:, None]
    passing[-1, :3] = arriving
    return Curve.through(times, poses, passing=passing)


def arrival_speed(app: App, approach: Array, position: Array, safety: Safety) -> float:
    """Return the speed [m/s] at which a contact is met: low, and no higher than its approach needs.

    approach: (3,) the direction of the contact; position: (3,) [m] where the app begins. The approach begins
    at the via point that is furthest from the contact, if the app lifts off before.
    """
    way_m, seconds = 0.0 if app.target is None else float(approach @ (app.target - position)), app.tn - app.t0
    if app.path is not None and app.target is not None and app.path.via:
        ways = [float(approach @ np.subtract(app.target, via.position)) for via in app.path.via]
        furthest = int(np.argmax(ways))
        if ways[furthest] > way_m:
            way_m, path = ways[furthest], app.path
            seconds *= (path.tn - path.via[furthest].t) / (path.tn - path.start.t)
    fits = ARRIVING_SHARE * way_m / max(seconds, LEAST_S)
    return min(max(fits, LEAST_SEARCH_M_PER_S), safety.contact_speed_m_per_s)


def approach_direction(app: App, following: App | None, rotation: Array) -> Array | None:
    """Return the direction (3,) in which an app meets the contact that ends it; None without one.

    It is the direction of a following press, else the axis of the tool. rotation: (3, 3) at the target.
    """
    if not ends_in_contact(app, following):
        return None
    force = touching_force(following)
    return press_direction(rotation, None if force is None else np.array(force))


def press_direction(rotation: Array, force: Array | None) -> Array:
    """Return the direction (3,) of a press: the tool's axis, or the force's own if they differ too much."""
    axis: Array = rotation[:, 2]
    if force is None:
        return axis
    own: Array = force / np.linalg.norm(force)
    return axis if float(axis @ own) > ALIGNED else own

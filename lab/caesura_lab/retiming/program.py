"""Re-times the movements of a program to the limits of the robot, along the taught paths.

For each movement it computes the length along its path (a turn by a radian counts as `TURNED_M`), joints
along the path, the fastest time law (`time_law`), and via points dense enough for the same reproduced path.
Then the reproduced path is checked at every millisecond, and its time scaled until it keeps the limits. A
movement that ends in a contact brakes as the executor requires, and is scaled until the executor's path keeps
the limits too. A movement that cannot be timed keeps its taught times, and a note states that. A speed set by
an operator is kept, and so are the times of a movement that stays near a contact that it leaves or meets.

A pause that is not marked is removed. If the hand crept in it by more than `CREPT_M`, it lasts as long as the
executor needs to creep there. Below that the robot joins the next path from its position.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_smoothing_spline

from caesura_lab.execution.skills import CREEP_M_PER_S
from caesura_lab.execution.trajectories import (
    ASTRAY_M,
    BRAKE_M_PER_S2,
    SLOW_M,
    app_path,
    approach_direction,
    arrival_speed,
)
from caesura_lab.path_distance import furthest
from caesura_lab.retiming.limits import MotionLimits, hurry, limits_of, poses_at
from caesura_lab.retiming.time_law import AT_REST, Arrival, TimeLawError, fastest
from caesura_protocol.app_kinds import APP_KINDS, app_name, ends_in_contact
from caesura_protocol.messages import App, ViaPoint
from caesura_protocol.programs.app_time_shifts import TURNED_M, may_retime, moved
from caesura_protocol.programs.document import ProgramFile, ProgramStep
from caesura_protocol.programs.planned_apps import STANDOFF_M
from caesura_protocol.programs.program_speed import retimed
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import Curve, curve_of, unit
from caesura_protocol.rotations import angular_velocities, matrix_of
from caesura_service.robot import ReachError, Robot, load_robot

Array = NDArray[np.float64]

FINE = 200  # looks at a leg of the taught path
PLACES = 2000  # at which two paths are compared
KNOT_M, FEWEST, MOST = 0.004, 40, 80  # of the way, between two inverse kinematics; how many of them
VIA_S, FEWEST_VIA, MOST_VIA = 0.025, 6, 60  # between two via points
ROUNDS, EVEN = 8, 0.01  # of scaling a movement that a contact ends; by which it may be slower than need be
STEP, FAR = 0.04, 1.3  # by which it gets slower at least; a factor from which on it is far from its time
REACH_M = 1e-3  # from the start of the path
OFF_M, OFF_RAD = 1e-3, math.radians(0.5)  # from the taught path to the re-timed one
FINGERS_DOWN = (1.0, 0.0, 0.0, 0.0)
SMOOTHED = 0.7  # of what a path may be off; the rest is for the via points that lead along it
SMOOTHNESS = -10.0, 1.0  # decimal logarithms of the least and the largest weight of a smoothing [m³]
HALVINGS = 8  # rounds in which the largest weight is found that is near enough
LOOKS, FIXED = 2, 1e6  # at a path between two knots; weight of its ends
CREPT_M = 0.5 * ASTRAY_M  # the executor goes onto a path whose start is up to `ASTRAY_M` away
TOO_FAST = "the hand was faster than the limits allow, of the robot or towards a contact"
TICKS_PER_S = 1000.0  # a movement takes whole ticks of the robot's controller


@dataclass(frozen=True)
class _Way:
    """The smoothed taught path by its length: (k,) [m], with poses (k, 7) and joints (k, n)."""

    geometry: BSpline
    along: Array
    poses: Array
    joints: Array


def optimal(
    program: ProgramFile, keeps_pause: Collection[int] = (), robot: Robot | None = None
) -> ProgramFile:
    """Return the program at the fastest times within its robot's limits. Raises CaesuraError as `retimed`.

    keeps_pause: apps before which the taught pause is kept. A movement that cannot be timed stays as taught.
    """
    steps, notes = dict[int, ProgramStep](), list[str]()
    if robot is None:
        if program.robot is None:
            notes.append("Robot not stated: timed within the limits of a Panda.")
        robot = load_robot(program.robot or "panda")
    still = FINGERS_DOWN
    for index, app in enumerate(program.apps):
        following = program.apps[index + 1] if index + 1 < len(program.apps) else None
        before = program.apps[index - 1] if index else None
        if may_retime(app) and app.speed is None and not _is_at_contact(app, before, following):
            limits = limits_of(robot, program.safety, app.load_kg or 0.0)
            try:
                steps[index] = _fastest(app, following, np.array(still), robot, limits, program.safety)
                if steps[index].tn - steps[index].t0 > app.tn - app.t0:
                    notes.append(f"{app_name(index, app.kind)} lasts longer than taught: {TOO_FAST}.")
            except ValueError as error:
                notes.append(f"{app_name(index, app.kind)} is not re-timed: {error}.")
        still = app.orientation or still
    noted = program.model_copy(update={"notes": (*program.notes, *notes)})
    return retimed(noted, steps, "optimal", lambda index, _: _crept_s(program.apps, index), keeps_pause)


def _is_at_contact(app: ProgramStep, before: App | None, following: App | None) -> bool:
    """Whether a movement leaves or meets a contact, and stays within the standoff from it."""
    meets = ends_in_contact(app.kind, None if following is None else following.kind)
    leaves = before is not None and APP_KINDS[before.kind].presses
    return (meets or leaves) and app.path is not None and app.path.length_m <= STANDOFF_M


def _crept_s(apps: tuple[ProgramStep, ...], index: int) -> float:
    """Return the time [s] in which the executor creeps to the begin of an app's path; 0 within `CREPT_M`.

    Also 0 where it does not creep: without a path, after an app that does not travel, in too short a pause.
    """
    path, before = apps[index].path, apps[index - 1]
    if path is None or before.target is None or not APP_KINDS[before.kind].travels:
        return 0.0
    crept_m, pause_s = math.dist(path.start.position, before.target), apps[index].t0 - before.tn
    seconds = math.ceil(TICKS_PER_S * crept_m / CREEP_M_PER_S) / TICKS_PER_S + 1.0 / TICKS_PER_S
    return seconds if crept_m > CREPT_M and seconds < pause_s else 0.0


def _fastest(
    app: ProgramStep, following: App | None, still: Array, robot: Robot, limits: MotionLimits, safety: Safety
) -> ProgramStep:
    """Return the app at its fastest, from its taught start on. Raises ValueError if it cannot be timed."""
    way = _way(app, still, robot)
    until = approach_direction(app, following, matrix_of(app.orientation or FINGERS_DOWN))

    def timed(arrival: Arrival) -> ProgramStep:
        law = fastest(way.along, *_with_flange(way, limits), limits.rise_s, arrival)
        return _on_its_path(app, _timed(app, way, *law))

    def of_limits(curve: Curve) -> float:
        return hurry(curve, still, robot, way.joints[0], limits)

    if until is None:
        made = timed(AT_REST)
        factor = of_limits(_from_zero(curve_of(made)))
        made = _lasting(made, factor * (made.tn - made.t0))
        # A jerk that peaks between two looks is seen once the movement is much slower.
        return made if factor < FAR else _scaled(made, lambda one: of_limits(_from_zero(curve_of(one))))
    found = list[ProgramStep]()
    for arrival in (Arrival(safety.contact_speed_m_per_s, SLOW_M, BRAKE_M_PER_S2), AT_REST):
        # Aslant to the contact the speed of the way is not that of the contact: rest may be the better end.
        if not found or found[0].tn > app.tn:
            with suppress(TimeLawError):
                found.append(
                    _scaled(timed(arrival), lambda one: of_limits(_towards_contact(one, until, safety)))
                )
    if not found:
        raise TimeLawError(f"no time within the limits after {ROUNDS} rounds")
    best = min(found, key=lambda one: one.tn)
    if best.tn > app.tn and of_limits(_towards_contact(app, until, safety)) <= 1.0:
        raise TimeLawError("it was taught as fast as the limits allow")
    return best


def _scaled(made: ProgramStep, hurried: Callable[[ProgramStep], float]) -> ProgramStep:
    """Return the app in the least time for which `hurried` is at most 1. Raises TimeLawError without one.

    Towards a contact `hurried` does not fall steadily with the time, because the knots of the executor's path
    lie elsewhere each time. So the first steps are small, and none is smaller than `STEP`.
    """
    least_s, too_fast_s = made.tn - made.t0, 0.0
    best: ProgramStep | None = None
    for number in range(1, ROUNDS + 1):
        seconds, factor = made.tn - made.t0, hurried(made)
        slower = factor / (1.0 - 0.5 * EVEN)
        if factor > 1.0:
            too_fast_s = seconds
            if factor < FAR:
                slower = min(max(slower, 1.0 + STEP), 1.0 + number * STEP)
        else:
            best = made if best is None or made.tn < best.tn else best
            if factor > 1.0 - EVEN or seconds <= max(least_s + EVEN, too_fast_s * (1.0 + STEP + EVEN)):
                break
        made = _lasting(made, max(slower * seconds, least_s))
    if best is None:
        raise TimeLawError(f"no time within the limits after {ROUNDS} rounds")
    return best


def _on_its_path(app: App, made: ProgramStep) -> ProgramStep:
    """Return the re-timed app, with its deviation from the taught path added to its stated deviations.

    Raises TimeLawError where that is more than `OFF_M` or `OFF_RAD`.
    """
    assert made.path is not None, "is timed by its path"
    curves = curve_of(app), curve_of(made)
    taught, reproduced = (one.sampled(math.ceil(PLACES / (len(one.t) - 1))) for one in curves)
    off_m, off_rad = furthest([(taught, reproduced), (reproduced, taught)], OFF_M, OFF_RAD)
    if off_m > OFF_M:
        raise TimeLawError(
            f"its path would be {1000 * off_m:.1f} mm off, at most {1000 * OFF_M:g} mm are allowed"
        )
    if off_rad > OFF_RAD:
        raise TimeLawError(
            f"its path would be turned by {math.degrees(off_rad):.1f}°, "
            f"at most {math.degrees(OFF_RAD):g}° are allowed"
        )
    deviations = {
        "deviation_m": made.path.deviation_m + off_m,
        "deviation_rad": made.path.deviation_rad + off_rad,
    }
    return made.model_copy(update={"path": made.path.model_copy(update=deviations)})


def _from_zero(curve: Curve) -> Curve:
    return Curve(curve.t - curve.t[0], curve.values, curve.velocities, curve.accelerations)


def _towards_contact(app: App, until: Array, safety: Safety) -> Curve:
    """Return the path that the executor follows for an app that a contact ends."""
    start = curve_of(app).values[0]
    rotation = matrix_of(start[3:] if len(start) == 7 else np.array(FINGERS_DOWN))
    arriving = arrival_speed(app, until, start[:3], safety) * until
    return app_path(app, start[:3], rotation, app.tn - app.t0, arriving)


def _way(app: ProgramStep, still: Array, robot: Robot) -> _Way:
    path, curve = app.path, curve_of(app)
    assert path is not None, "is timed by its path"
    fine = curve.sampled(FINE)
    step = np.diff(fine, axis=0)
    size = np.linalg.norm(step[:, :3], axis=1) + 2.0 * TURNED_M * np.linalg.norm(step[:, 3:], axis=1)
    along = np.concatenate([[0.0], np.cumsum(size)])
    legs = np.linspace(0.0, 1.0, FINE, endpoint=False)
    times = np.append((curve.t[:-1, None] + np.diff(curve.t)[:, None] * legs).ravel(), curve.t[-1])
    count = int(np.clip(along[-1] / KNOT_M, FEWEST, MOST))
    places = np.linspace(0.0, along[-1], LOOKS * count + 1)
    left_m = min(OFF_M, path.tolerance_m - path.deviation_m)
    left_rad = min(OFF_RAD, path.tolerance_rad - path.deviation_rad)
    poses = poses_at(curve, np.interp(places, along, times), still)
    geometry = _smoothed(places, poses, SMOOTHED * left_m, SMOOTHED * left_rad)
    places = places[::LOOKS]
    poses = unit(geometry(places))
    seed = robot.postures[0] if app.joints is None else np.array(app.joints)
    q, left, turn = robot.nearest_joints(poses[0, :3], poses[0, 3:], seed)
    if left > REACH_M or turn > REACH_M:
        raise ReachError(f"{1000 * left:.1f} mm and {turn:.3f} rad are left to the start of the path")
    return _Way(geometry, places, poses, robot.joints_along(poses, q))


def _smoothed(places: Array, poses: Array, left_m: float, left_rad: float) -> BSpline:
    """Return the smoothest path within a distance [m] and an angle [rad] of poses (k, 7) at lengths (k,) [m].

    It begins and ends at the first and the last pose. Its smoothness is one weight of its second derivatives.
    """
    weights = np.ones(len(places))
    weights[[0, -1]] = FIXED

    def smoothed(smoothness: float) -> BSpline:
        return make_smoothing_spline(places, poses, weights, lam=10.0**smoothness)

    def is_near(path: BSpline) -> bool:
        off = path(places) - poses
        apart, turned = (np.linalg.norm(part, axis=1).max() for part in (off[:, :3], 2.0 * off[:, 3:]))
        return bool(apart <= left_m and turned <= left_rad)

    least, most = SMOOTHNESS
    for _ in range(HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if is_near(smoothed(middle)) else (least, middle)
    return smoothed(least)


def _with_flange(way: _Way, limits: MotionLimits) -> tuple[Array, Array, Array]:
    """Return joints, length and turn of the flange (k, n + 2), with limits of velocity and acceleration.

    The limits are (n + 2,). The law jumps from one limit of an acceleration to the other, and is averaged
    over `rise_s`: the limit is one at which that jump keeps the jerk, too.
    """
    step = np.diff(way.poses, axis=0)
    moved = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step[:, :3], axis=1))])
    turned = np.concatenate([[0.0], np.cumsum(2.0 * np.linalg.norm(step[:, 3:], axis=1))])
    velocity = np.append(limits.joints[0], (limits.speed, limits.turn))
    acceleration = np.append(limits.joints[1], (limits.acceleration, limits.acceleration / TURNED_M))
    jerk = np.append(limits.joints[2], (limits.jerk, limits.jerk / TURNED_M))
    acceleration = np.minimum(acceleration, 0.5 * limits.rise_s * jerk)
    return np.column_stack([way.joints, moved, turned]), velocity, acceleration


def _timed(app: ProgramStep, way: _Way, t: Array, covered: Array) -> ProgramStep:
    """Return the app with via points at the times of a law, evenly spaced in time and along the path."""
    assert app.path is not None, "is timed by its path"
    seconds, t0 = float(t[-1]), app.t0
    count = int(np.clip(seconds / VIA_S, FEWEST_VIA, MOST_VIA))
    even = 0.5 * t / seconds + 0.5 * covered / covered[-1]
    times = np.interp(np.linspace(0.0, 1.0, count + 2)[1:-1], even, t)
    taught = curve_of(app)
    turns = taught.values.shape[1] == 7
    speeds = np.gradient(covered, t)
    via = []
    for when in times:
        place = float(np.interp(when, t, covered))
        pose, rates = way.geometry(place), way.geometry(place, 1) * np.interp(when, t, speeds)
        quaternion = pose[3:] / np.linalg.norm(pose[3:])
        turning = angular_velocities(pose[None, 3:], rates[None, 3:])[0]
        via.append(
            ViaPoint(
                t=t0 + float(when),
                position=tuple(pose[:3].tolist()),
                orientation=tuple(quaternion.tolist()) if turns else None,
                velocity=tuple(rates[:3].tolist()),
                angular_velocity=tuple(turning.tolist()) if turns else None,
            )
        )
    rests = {"end_velocity": None, "end_angular_velocity": None}
    start = app.path.start.model_copy(update={"t": t0, "velocity": None, "angular_velocity": None})
    path = app.path.model_copy(update={"start": start, "via": tuple(via), "tn": t0 + seconds, **rests})
    return app.model_copy(update={"tn": t0 + seconds, "path": path})


def _lasting(app: ProgramStep, seconds: float) -> ProgramStep:
    """Return the app with its times scaled to a duration [s], rounded up to whole ticks."""
    assert app.path is not None, "is timed by its path"
    seconds = math.ceil(TICKS_PER_S * seconds) / TICKS_PER_S
    factor = seconds / (app.tn - app.t0)
    path = moved(app.path, lambda t: app.t0 + factor * (t - app.t0), 1.0 / factor)
    return app.model_copy(update={"tn": app.t0 + seconds, "path": path})

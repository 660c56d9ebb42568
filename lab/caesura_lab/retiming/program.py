"""Re-times the movements of a program to the limits of the robot, along the taught paths.

For each movement it computes the length along its path (a turn by a radian counts as `TURNED_M`), joints
along the path, the fastest time law (`time_law`), and via points dense enough for the same reproduced path.
Then the reproduced path is checked at every millisecond. Where it is too fast, the next law is slower; the
last one is scaled until it keeps the limits. A movement that ends in a contact brakes as the executor
requires, and it is the executor's path that is checked. A movement that cannot be timed keeps its taught
times, and a note states that. A speed set by an operator is kept, and so are the times of a movement that
stays near a contact that it leaves or meets.

A pause that is not marked is removed. If the hand crept in it by more than `CREPT_M`, it lasts as long as the
executor needs to creep there. Below that the robot joins the next path from its position.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d

from caesura_lab.execution.simulated_arm import OFF_SETPOINT_M
from caesura_lab.execution.skills import CREEP_M_PER_S, MOST_CREEP_M_PER_S
from caesura_lab.execution.trajectories import (
    BRAKE_M_PER_S2,
    SLOW_M,
    app_path,
    approach_direction,
    arrival_speed,
)
from caesura_lab.path_distance import furthest
from caesura_lab.retiming.limits import MotionLimits, limits_of, poses_at, slowdown
from caesura_lab.retiming.time_law import UNLIMITED, Ceiling, Planned, TimeLawError, fastest
from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.messages import App, ViaPoint
from caesura_protocol.programs.app_time_shifts import TURNED_M, may_retime, moved
from caesura_protocol.programs.checks.fidelity import STRAYED_M
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
VIA_S, MOST_VIA, LEAST_LEGS = 0.016, 60, 2  # between two via points; legs between two changes of sign
LAST_S = 0.06  # between the last via point and a contact, whose speed is the executor's
LEAST_RISE_S, MOST_RISE_S = 0.02, 0.15  # over which a law is averaged first
MEETS_S = 0.06  # likewise, at most, of a movement to a contact
SMOOTH_S = 0.03  # over which it is averaged then, at most
TO_JERK = 2.4  # of acceleration by jerk: from that rise on a jump between both accelerations keeps the jerk
BENT = 0.4  # of a limit of the jerk that the bends of a path may take
FITTED, NEAR, GAIN = 4, 1.02, 0.01  # laws tried at most; a factor of time and a gain below which no more are
AROUND_TICKS, LEAST_M_PER_S = 10, 0.01  # around a tick that is too fast; a speed that gets no lower
SOONER = 0.3  # of its taught time that a movement to a contact takes, at a guess
SLOWING, LOOKED = 4, 8  # times the way that is slow before a contact, in which so many places are added
ROUNDS, EVEN = 8, 0.01  # of scaling a movement that a contact ends; by which it may be slower than need be
STEP, FAR = 0.04, 1.3  # by which it gets slower at least; a factor from which on it is far from its time
REACH_M = 1e-3  # from the start of the path
OFF_M, OFF_RAD = 1e-3, math.radians(0.5)  # from the taught path to the re-timed one
FINGERS_DOWN = (1.0, 0.0, 0.0, 0.0)
SMOOTHED = 0.8  # of what a path may be off; the rest is for the via points that lead along it
SMOOTHED_LESS = 0.5  # likewise, where that leaves them too little
SMOOTHNESS = -10.0, 1.0  # decimal logarithms of the least and the largest weight of a smoothing [m³]
HALVINGS = 8  # rounds in which the largest weight is found that is near enough
LOOKS, FIXED = 2, 1e6  # at a path between two knots; weight of its ends
CREPT_M = STRAYED_M - OFF_SETPOINT_M  # the executor begins a path so far beside its start
TOO_FAST = "the hand was faster than the limits allow, of the robot or towards a contact"
TICKS_PER_S = 1000.0  # a movement takes whole ticks of the robot's controller


class _OffPathError(TimeLawError):
    """The re-timed path is too far from the taught one."""


@dataclass(frozen=True)
class _Way:
    """The smoothed taught path by its length: (k,) [m], with poses (k, 7) and joints (k, n)."""

    geometry: CubicSpline
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
                    notes.append(f"{name_of_app(index, app)} lasts longer than taught: {TOO_FAST}.")
            except ValueError as error:
                notes.append(f"{name_of_app(index, app)} is not re-timed: {error}.")
        still = app.orientation or still
    noted = program.model_copy(update={"notes": (*program.notes, *notes)})
    return retimed(noted, steps, "optimal", lambda index, _: _crept_s(program, index), keeps_pause)


def _is_at_contact(app: ProgramStep, before: App | None, following: App | None) -> bool:
    """Whether a movement leaves or meets a contact, and stays within the standoff from it."""
    meets = ends_in_contact(app, following)
    leaves = before is not None and APP_KINDS[before.kind].presses
    return (meets or leaves) and app.path is not None and app.path.length_m <= STANDOFF_M


def _crept_s(program: ProgramFile, index: int) -> float:
    """Return the time [s] in which the executor creeps to the begin of an app's path; 0 within `CREPT_M`.

    At most the taught pause. Also 0 where it does not creep: without a path, before an app that keeps the
    contact, in too short a pause. In a contact it slides, at most at the speed of a contact.
    """
    app, before = program.apps[index], program.apps[index - 1]
    if app.path is None or before.target is None or not APP_KINDS[app.kind].has_target:
        return 0.0
    crept_m, pause_s = math.dist(app.path.start.position, before.target), app.t0 - before.tn
    seconds = math.ceil(TICKS_PER_S * crept_m / CREEP_M_PER_S) / TICKS_PER_S + 1.0 / TICKS_PER_S
    stands = APP_KINDS[before.kind].in_contact and before.force_taught is not None
    most_m_per_s = program.safety.contact_speed_m_per_s if stands else MOST_CREEP_M_PER_S
    creeps = CREPT_M < crept_m <= most_m_per_s * pause_s
    return min(seconds, pause_s) if creeps else 0.0


def _fastest(
    app: ProgramStep, following: App | None, still: Array, robot: Robot, limits: MotionLimits, safety: Safety
) -> ProgramStep:
    """Return the app at its fastest, from its taught start on. Raises ValueError if it cannot be timed."""

    def along(share: float) -> ProgramStep:
        way = _way(app, still, robot, share)
        return _fastest_along(way, app, following, still, robot, limits, safety)

    try:
        return along(SMOOTHED)
    except _OffPathError:
        return along(SMOOTHED_LESS)


def _fastest_along(
    way: _Way,
    app: ProgramStep,
    following: App | None,
    still: Array,
    robot: Robot,
    limits: MotionLimits,
    safety: Safety,
) -> ProgramStep:
    """Return the app at its fastest along a smoothed path. Raises ValueError if it cannot be timed."""
    until = approach_direction(app, following, matrix_of(app.orientation or FINGERS_DOWN))

    def slower(one: ProgramStep) -> Array:
        curve = _from_zero(curve_of(one)) if until is None else _towards_contact(one, until, safety)
        return slowdown(curve, still, robot, way.joints[0], limits)

    def hurried(one: ProgramStep) -> float:
        return float(slower(one).max())

    if until is None:
        made, factor = _fitted(app, way, limits, slower)
        made = _lasting(made, factor * (made.tn - made.t0))
        # A jerk that peaks between two looks is seen once the movement is slower.
        return _sooner(app, made if factor <= 1.0 else _scaled(made, hurried), hurried)
    found = list[ProgramStep]()
    sooner = app.model_copy(update={"tn": app.t0 + SOONER * (app.tn - app.t0)})
    for arrives in (arrival_speed(sooner, until, way.poses[0, :3], safety), 0.0):
        # Aslant to the contact the speed of the way is not that of the contact: rest may be the better end.
        if not found or found[0].tn > app.tn:
            with suppress(TimeLawError):
                made, factor = _fitted(app, way, limits, slower, arrives)
                found.append(made if factor <= 1.0 else _scaled(made, hurried))
    if not found:
        raise TimeLawError(f"no time within the limits after {ROUNDS} rounds")
    return _sooner(app, min(found, key=lambda one: one.tn), hurried)


def _sooner(app: ProgramStep, made: ProgramStep, hurried: Callable[[ProgramStep], float]) -> ProgramStep:
    """Return the re-timed app. Raises TimeLawError for a longer one than one that keeps the limits."""
    if made.tn > app.tn and hurried(app) <= 1.0:
        raise TimeLawError("it was taught as fast as the limits allow")
    return _on_its_path(app, made)


def _fitted(
    app: ProgramStep,
    way: _Way,
    limits: MotionLimits,
    slower: Callable[[ProgramStep], Array],
    arrives: float | None = None,
) -> tuple[ProgramStep, float]:
    """Return the app by the fastest time law, and the factor of time that it still needs, at least 1.

    Where a movement is too fast, the next law gets a lower speed there, instead of more time everywhere.
    slower: returns the factors (n,) of an app at even times; arrives: [m/s] at a contact, None without one.
    """
    planned = _planned(way, limits, MOST_RISE_S if arrives is None else MEETS_S)
    ceiling = _braking(way, _ceiling(way, limits), arrives or 0.0, planned.rises_s)
    best, least_s, least = app, math.inf, 1.0
    for _ in range(FITTED):
        t, covered = fastest(planned, ceiling)
        made = _timed(app, way, t, covered, 0.0 if arrives is None else LAST_S)
        factors = slower(made)
        factor = max(float(factors.max()), 1.0)
        gained = 1.0 - factor * float(t[-1]) / least_s
        if gained > 0.0:
            best, least_s, least = made, factor * float(t[-1]), factor
        if factor < NEAR or gained < GAIN:
            break
        speeds = np.minimum(ceiling.speeds, _slower_there(ceiling.places, t, covered, factors))
        ceiling = ceiling._replace(speeds=speeds)
    return best, least


def _slower_there(places: Array, t: Array, covered: Array, factors: Array) -> Array:
    """Return the speeds [m/s] of a law at places (g,), lower where a movement is too fast; else no limit.

    t, covered: (n,) the law; factors: of time, at even times from begin to end of the movement.
    """
    around = maximum_filter1d(factors, 2 * AROUND_TICKS + 1, mode="nearest")
    ticks = np.linspace(0.0, t[-1], len(around))
    there = np.interp(np.interp(places, covered, t), ticks, around)
    speeds = np.interp(places, covered, np.gradient(covered, t)) / there
    speeds[(there <= 1.0) | (speeds < LEAST_M_PER_S)] = np.inf
    return speeds


def _scaled(made: ProgramStep, hurried: Callable[[ProgramStep], float]) -> ProgramStep:
    """Return the app in the least time for which `hurried` is at most 1. Raises TimeLawError without one.

    Towards a contact `hurried` does not fall steadily with the time, because the executor brakes otherwise
    each time. So steps are small at first, and from the second one on none is smaller than `STEP`.
    """
    least_s, too_fast_s = made.tn - made.t0, 0.0
    best: ProgramStep | None = None
    for number in range(1, ROUNDS + 1):
        seconds, factor = made.tn - made.t0, hurried(made)
        slower = factor / (1.0 - 0.5 * EVEN)
        if factor > 1.0:
            too_fast_s = seconds
            if factor < FAR:
                slower = min(max(slower, 1.0 + (number - 1) * STEP), 1.0 + number * STEP)
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

    Raises _OffPathError where that is more than `OFF_M` or `OFF_RAD`.
    """
    assert made.path is not None, "is timed by its path"
    curves = curve_of(app), curve_of(made)
    taught, reproduced = (one.sampled(math.ceil(PLACES / (len(one.t) - 1))) for one in curves)
    off_m, off_rad = furthest([(taught, reproduced), (reproduced, taught)], OFF_M, OFF_RAD)
    if off_m > OFF_M:
        raise _OffPathError(
            f"its path would be {1000 * off_m:.1f} mm off, at most {1000 * OFF_M:g} mm are allowed"
        )
    if off_rad > OFF_RAD:
        raise _OffPathError(
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


def _way(app: ProgramStep, still: Array, robot: Robot, smoothed: float) -> _Way:
    """Return the taught path smoothed by a share of what it may be off."""
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
    geometry = _smoothed(places, poses, smoothed * left_m, smoothed * left_rad)
    places = places[::LOOKS]
    poses = unit(geometry(places))
    seed = robot.postures[0] if app.joints is None else np.array(app.joints)
    q, left, turn = robot.nearest_joints(poses[0, :3], poses[0, 3:], seed)
    if left > REACH_M or turn > REACH_M:
        raise ReachError(f"{1000 * left:.1f} mm and {turn:.3f} rad are left to the start of the path")
    return _Way(geometry, places, poses, robot.joints_along(poses, q))


def _smoothed(places: Array, poses: Array, left_m: float, left_rad: float) -> CubicSpline:
    """Return the smoothest path within a distance [m] and an angle [rad] of poses (k, 7).

    places: (k,) their lengths [m], evenly spaced. It begins and ends at the first and the last pose. Its
    smoothness is a weight of its second derivatives, one for positions and one for turns: with a common one
    the turn trembled on where the position reached its distance. They are γ at the places, and the values are
    poses - weight W⁻¹ Q γ, with (R + weight Qᵀ W⁻¹ Q) γ = Qᵀ poses (Reinsch 1967).
    scipy's make_smoothing_spline gives the same path; with it some programs take more than 200 ms to time.
    """
    step = places[1] - places[0]
    loose = np.ones(len(places))
    loose[[0, -1]] = 1.0 / FIXED
    bent = np.diff(poses, 2, axis=0) / step
    first, middle, last = loose[:-2], loose[1:-1], loose[2:]
    across = np.stack([last, -2.0 * (middle + last), first + 4.0 * middle + last]) / step**2
    across[0, 2:], across[1, 1:] = across[0, :-2].copy(), across[1, :-1].copy()
    along = step * np.array([[0.0], [1.0 / 6.0], [2.0 / 3.0]])

    def smoothed(weight: float, columns: slice) -> Array:
        bends = np.pad(solveh_banded(along + weight * across, bent[:, columns]), ((2, 2), (0, 0)))
        return np.asarray(poses[:, columns] - weight * loose[:, None] * np.diff(bends, 2, axis=0) / step)

    def nearest(columns: slice, left: float) -> Array:
        least, most = SMOOTHNESS
        for _ in range(HALVINGS):
            weight = 0.5 * (least + most)
            off = smoothed(10.0**weight, columns) - poses[:, columns]
            near = np.linalg.norm(off, axis=1).max() <= left
            least, most = (weight, most) if near else (least, weight)
        return smoothed(10.0**least, columns)

    parts = [nearest(slice(0, 3), left_m), nearest(slice(3, None), 0.5 * left_rad)]
    return CubicSpline(places, np.hstack(parts), bc_type="natural")


def _planned(way: _Way, limits: MotionLimits, most_rise_s: float) -> Planned:
    """Return joints, length and turn of the flange along the way, with their limits.

    The law jumps from one limit of an acceleration to the other, and is averaged over the rise. A limit is
    one at which that jump keeps the jerk, too. Where a jerk binds, a longer rise allows a larger
    acceleration: over a way d from rest to rest a rise of about (d / 2 jerk)^(1/3) takes the least time.
    """
    step = np.diff(way.poses, axis=0)
    moved = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step[:, :3], axis=1))])
    turned = np.concatenate([[0.0], np.cumsum(2.0 * np.linalg.norm(step[:, 3:], axis=1))])
    values = np.column_stack([way.joints, moved, turned])
    velocity = np.append(limits.joints[0], (limits.speed, limits.turn))
    acceleration = np.append(limits.joints[1], (limits.acceleration, limits.acceleration / TURNED_M))
    jerk = np.append(limits.joints[2], (limits.jerk, limits.jerk / TURNED_M))
    rises = np.minimum(TO_JERK * acceleration / jerk, np.cbrt(0.5 * np.ptp(values, axis=0) / jerk))
    rise_s = float(np.clip(rises.max(), LEAST_RISE_S, most_rise_s))
    acceleration = np.minimum(acceleration, 0.5 * rise_s * jerk)
    return Planned(way.along, values, velocity, acceleration, (rise_s, min(rise_s, SMOOTH_S)))


def _ceiling(way: _Way, limits: MotionLimits) -> Array:
    """Return the speeds (k,) [m/s] along the way at which its bends take `BENT` of a limit of the jerk."""
    bends = np.column_stack([way.joints, way.poses[:, :3]])
    for _ in range(3):
        bends = np.gradient(bends, way.along, axis=0)
    joints = len(limits.joints[2])
    share = (np.abs(bends[:, :joints]) / limits.joints[2]).max(axis=1)
    share = np.maximum(share, np.linalg.norm(bends[:, joints:], axis=1) / limits.jerk)
    return np.asarray(np.cbrt(BENT / np.maximum(share, BENT / UNLIMITED**3)))


def _braking(way: _Way, speeds: Array, arrives: float, rises_s: tuple[float, float]) -> Ceiling:
    """Return the ceiling of a movement that meets a contact with a speed of the flange [m/s]; 0: it rests.

    speeds: (k,) [m/s] along the way otherwise. The law is averaged over the rises, so it has to be as slow as
    the executor somewhat earlier.
    """
    if not arrives:
        return Ceiling(way.along, speeds)
    metres = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way.poses[:, :3], axis=0), axis=1)))
    lag_s, spread = 0.5 * sum(rises_s), sum(rise_s**2 for rise_s in rises_s) / 12.0
    slow_m = SLOW_M + arrives * lag_s + BRAKE_M_PER_S2 * spread
    added = np.interp(metres[-1] - slow_m * np.linspace(0.0, SLOWING, LOOKED + 1), metres, way.along)
    places = np.union1d(way.along, added)
    left = np.maximum(metres[-1] - np.interp(places, way.along, metres) - slow_m, 0.0)
    flange = np.sqrt(arrives**2 + 2.0 * BRAKE_M_PER_S2 * left)
    share = np.interp(places, way.along, np.gradient(metres, way.along))  # of the length, that is no turn
    braking = np.minimum(flange / np.maximum(share, arrives), np.interp(places, way.along, speeds))
    return Ceiling(places, braking, float(braking[-1]))


def _timed(app: ProgramStep, way: _Way, t: Array, covered: Array, last_s: float) -> ProgramStep:
    """Return the app with via points along a law; last_s: none so near to its end [s]."""
    assert app.path is not None, "is timed by its path"
    t0, seconds = app.t0, float(t[-1])
    speeds = np.gradient(covered, t)
    times = _via_times(t, np.gradient(speeds, t), last_s)
    along = np.interp(times, t, covered)
    poses, rates = way.geometry(along), way.geometry(along, 1) * np.interp(times, t, speeds)[:, None]
    turning = angular_velocities(unit(poses)[:, 3:], rates[:, 3:]).tolist()
    turns = curve_of(app).values.shape[1] == 7
    via = [
        ViaPoint(
            t=t0 + when,
            position=tuple(pose[:3]),
            orientation=tuple(pose[3:]) if turns else None,
            velocity=tuple(rate[:3]),
            angular_velocity=tuple(turn) if turns else None,
        )
        for when, pose, rate, turn in zip(
            times.tolist(), poses.tolist(), rates.tolist(), turning, strict=True
        )
    ]
    rests = {"end_velocity": None, "end_angular_velocity": None}
    start = app.path.start.model_copy(update={"t": t0, "velocity": None, "angular_velocity": None})
    path = app.path.model_copy(update={"start": start, "via": tuple(via), "tn": t0 + seconds, **rests})
    return app.model_copy(update={"tn": t0 + seconds, "path": path})


def _via_times(t: Array, accelerations: Array, last_s: float) -> Array:
    """Return the times [s] of via points, about `VIA_S` apart, one where the acceleration changes its sign.

    The reproduced path takes the acceleration of a via point from the velocities beside it, and limits it by
    the flatter side. That is exact where the acceleration is 0. A change of sign between two via points would
    have several times the jerk. last_s: no via point so near to the end.
    """
    step = max(VIA_S, t[-1] / MOST_VIA)
    ends = [0.0]
    for when in t[np.flatnonzero(accelerations[1:] * accelerations[:-1] < 0.0)].tolist():
        if min(when - ends[-1], t[-1] - when) > LEAST_LEGS * step:
            ends.append(when)
    step = max(VIA_S, t[-1] / (MOST_VIA - len(ends)))
    legs = [
        np.linspace(begins, stops, max(round((stops - begins) / step), 1), endpoint=False)
        for begins, stops in pairwise((*ends, float(t[-1])))
    ]
    times = np.concatenate(legs)[1:]
    return np.asarray(times[times <= t[-1] - last_s])


def _lasting(app: ProgramStep, seconds: float) -> ProgramStep:
    """Return the app with its times scaled to a duration [s], rounded up to whole ticks."""
    assert app.path is not None, "is timed by its path"
    seconds = math.ceil(TICKS_PER_S * seconds) / TICKS_PER_S
    factor = seconds / (app.tn - app.t0)
    path = moved(app.path, lambda t: app.t0 + factor * (t - app.t0), 1.0 / factor)
    return app.model_copy(update={"tn": app.t0 + seconds, "path": path})

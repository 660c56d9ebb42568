"""Divides an app's path into straight legs, for controllers with lines and blends and without curves.

The reproduced path is a curve between via points (`caesura_protocol.reproduced_path`). It is cut so that
every chord stays within 1 mm and 0.5° of it, or within half of a finer tolerance. A leg has the mean speed of
its part of the curve, reduced to the limits; corners are blended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import App, Vector
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import curve_of, unit

Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Start = tuple[Vector, Quaternion | None]  # position [m] and orientation

CHORD_M = 0.001  # that a leg may be off the curve, and at most half of the path's tolerance
CHORD_RAD = math.radians(0.5)  # likewise
BLEND_M = 0.004  # at most, and twice the path's tolerance: a right angle is cut by 1.7 mm
BLEND_SHARE = 0.45  # of the shorter of two legs: blends must not overlap
PARTS = 16  # of the curve between two via points
SHORT_M = 0.0005  # a leg that is shorter, and turns, only turns
STILL_RAD = 0.002  # a leg that turns less does not turn
SLOWEST_M_PER_S = 0.0001  # of a leg that travels; below it the SDK of the xArm sets this speed
PEAK = 2.0  # speed of a turn that starts and stops, over its mean
LEGS = (
    "A path is followed by straight legs, "
    f"up to {1000 * CHORD_M:g} mm and {math.degrees(CHORD_RAD):g}° off it, "
    f"with blends of up to {1000 * BLEND_M:g} mm. The arm stops at each target."
)


class Closeness(NamedTuple):
    """Largest distances of legs from the curve [m], [rad], and of their blends [m]."""

    chord_m: float
    chord_rad: float
    blend_m: float


class Leg(NamedTuple):
    """A straight movement to a pose of the flange.

    speed_m_per_s: None if it only turns, by turn_rad in `seconds`; seconds: its duration; blend_m: 0 if it
    stops.
    """

    position: Vector
    orientation: Quaternion | None
    speed_m_per_s: float | None
    seconds: float
    blend_m: float
    turn_rad: float


def straight_legs(
    app: App, before: Start | None, safety: Safety, acceleration: float, *, stop_short: Vector | None = None
) -> list[Leg]:
    """Return the legs of an app to its target. Raises ValueError for an app without target.

    before: its start, if it has no path; an unknown orientation is that of the target. acceleration: [m/s²]
    at the start and stop of a single leg.
    stop_short: (3,) [m]; the part beyond the plane at this vector before the target is left out.
    """
    t, poses = _points(app, before)
    if stop_short is not None:
        t, poses = _ended_before(t, poses, np.array(stop_short))
    if len(poses) < 2:
        place, turned = _pose(poses[-1])
        return [Leg(place, turned, safety.contact_speed_m_per_s, 1.0, 0.0, 0.0)]
    close = _closeness(app)
    keep = _corners(poses, close)
    t, poses = t[keep], poses[keep]
    return _legs(t, poses, safety, acceleration, close.blend_m)


def _closeness(app: App) -> Closeness:
    """Return the closeness that the tolerance of an app's path leaves to its legs."""
    path = app.path
    metres, radians = (math.inf, math.inf) if path is None else (path.tolerance_m, path.tolerance_rad)
    return Closeness(min(CHORD_M, 0.5 * metres), min(CHORD_RAD, 0.5 * radians), min(BLEND_M, 2.0 * metres))


def _points(app: App, before: Start | None) -> tuple[Array, Array]:
    """Return times (k,) [s] and poses (k, 3 or 7), close together on the curve; quaternions of length 1."""
    if app.target is None:
        raise ValueError(f"{app.kind} at {fixed(app.t0, 2)} s has no target")
    if app.path is None:
        target = (*app.target, *(app.orientation or ()))
        ends = [target]
        if before is not None:
            place, turned = before
            ends = [(*place, *((turned or app.orientation) if app.orientation else ())), target]
        return np.array([0.0, max(app.tn - app.t0, 0.1)])[-len(ends) :], unit(np.array(ends))
    curve = curve_of(app)
    shares = np.linspace(0.0, 1.0, PARTS, endpoint=False)
    inner = (curve.t[:-1, None] + np.diff(curve.t)[:, None] * shares).ravel()
    return np.append(inner, curve.t[-1]) - curve.t[0], curve.sampled(PARTS)


def _ended_before(t: Array, poses: Array, short: Array) -> tuple[Array, Array]:
    """Return times and poses up to the plane at `short` before the target, with the last one on it."""
    target = poses[-1].copy()
    direction = short / np.linalg.norm(short)
    left = (target[:3] - poses[:, :3]) @ direction
    inside = left > np.linalg.norm(short)
    stand = target.copy()
    stand[:3] -= short
    seconds = t[inside][-1] if inside.any() else 0.0
    end = max(float(t[-1]), float(seconds) + 0.1)
    return np.append(t[inside], end), np.vstack([poses[inside], stand])


def _corners(poses: Array, close: Closeness) -> list[int]:
    """Return the rows between which straight legs stay close to all rows (Douglas and Peucker)."""
    keep, open_ends = {0, len(poses) - 1}, [(0, len(poses) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        if last - first < 2:
            continue
        off = _off_chord(poses[first : last + 1], close)
        worst = 1 + int(np.argmax(off[1:-1]))  # a part that ends where it began would be divided for ever
        if not off[worst] <= 1.0:  # halfway around a whole turn the leg has no orientation
            keep.add(first + worst)
            open_ends += [(first, first + worst), (first + worst, last)]
    return sorted(keep)


def _off_chord(poses: Array, close: Closeness) -> Array:
    """Return the deviation (k,) of poses from the leg between the first and the last one, in tolerances.

    poses: (k, 3) or (k, 7). 1 is the closeness in place or in turn, whichever is reached first.
    """
    chord = poses[-1] - poses[0]
    way, squared = poses[:, :3] - poses[0, :3], float(chord[:3] @ chord[:3])
    least_m = min(SHORT_M, close.chord_m)
    share = np.clip(way @ chord[:3] / squared, 0.0, 1.0) if squared > least_m**2 else None
    off = np.linalg.norm(way - (0.0 if share is None else share[:, None] * chord[:3]), axis=1)
    off /= close.chord_m
    if poses.shape[1] == 7:
        along = _turned_share(poses[:, 3:]) if share is None else share
        turned = poses[0, 3:] + along[:, None] * chord[3:]
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        cosine = np.minimum(np.abs(np.vecdot(turned, poses[:, 3:])), 1.0)
        off = np.maximum(off, 2.0 * np.arccos(cosine) / close.chord_rad)
    return np.asarray(off)


def _turned_share(quaternions: Array) -> Array:
    """Return the share (k,) of the whole turn that has been made at each orientation (k, 4)."""
    cosines = np.minimum(np.abs(np.vecdot(quaternions[1:], quaternions[:-1])), 1.0)
    sums = np.append(0.0, np.cumsum(np.arccos(cosines)))
    return np.asarray(sums / max(sums[-1], 1e-12))


def _legs(t: Array, poses: Array, safety: Safety, acceleration: float, most_m: float) -> list[Leg]:
    lengths = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).tolist()
    legs = []
    for index, (length, seconds) in enumerate(zip(lengths, np.diff(t).tolist(), strict=True)):
        turn = _angle(poses[index], poses[index + 1])
        travels = length >= SHORT_M or turn < STILL_RAD
        slower = safety.slower(length / seconds, (1.0 if travels else PEAK) * turn / seconds)
        seconds *= slower
        speed = None
        if travels:
            speed = length / seconds
            if len(lengths) == 1:
                speed = _cruise(length, seconds, acceleration)
            fastest = min(safety.speed_m_per_s, safety.turn_rad_per_s * length / max(turn, 1e-9))
            speed = max(min(speed, fastest), SLOWEST_M_PER_S)
            seconds = min(seconds, length / speed)
        blend = 0.0
        if index + 1 < len(lengths):
            blend = min(most_m, BLEND_SHARE * min(length, lengths[index + 1]))
        place, turned = _pose(poses[index + 1])
        legs.append(Leg(place, turned, speed, seconds, blend, turn))
    return legs


def _cruise(length: float, seconds: float, acceleration: float) -> float:
    """Return the constant speed [m/s] between the ramps of a leg of this duration from rest to rest."""
    free = (acceleration * seconds) ** 2 - 4.0 * acceleration * length
    return 0.5 * (acceleration * seconds - math.sqrt(max(free, 0.0)))


def _angle(one: Array, other: Array) -> float:
    if len(one) == 3:
        return 0.0
    return 2.0 * math.acos(min(abs(float(one[3:] @ other[3:])), 1.0))


def _pose(row: Array) -> tuple[Vector, Quaternion | None]:
    values: Sequence[float] = row.tolist()
    x, y, z = values[:3]
    if len(values) == 3:
        return (x, y, z), None
    a, b, c, d = values[3:]
    return (x, y, z), (a, b, c, d)

"""Computes the errors of a path with ten poses a second: of their cubic, and of the motion between them.

A program's path has the pose of each observation. The motion between two of them is the cubic
with their velocities, or what the samples show there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from operator import mul
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.coaching.observed_pose import ObservedPose

Array = NDArray[np.float64]

POSES = 4  # the cubic through them is compared with the movement between the middle two
TURNS_BACK = 0.1  # of the way between two poses, that a movement goes back before or after them


class InterpolationErrors(NamedTuple):
    """The greatest errors of four poses against the motion between the middle two."""

    path_m: float = 0.0  # of the cubic with their velocities
    turn_rad: float = 0.0  # likewise, of the turn
    shaken_m: float = 0.0  # of the samples between them
    shaken_rad: float = 0.0  # likewise, of the turn


NO_ERRORS = InterpolationErrors()


def interpolation_errors(
    poses: tuple[ObservedPose, ...], tolerance_m: float, tolerance_rad: float
) -> InterpolationErrors:
    """Return the errors of four poses; 0 for fewer, or if a bound shows that each is within its tolerance."""
    if len(poses) < POSES or _are_within(poses, tolerance_m, tolerance_rad):
        return NO_ERRORS
    return InterpolationErrors(path_error(poses), turn_error(poses), *deviation_between_poses(poses))


def _are_within(poses: tuple[ObservedPose, ...], tolerance_m: float, tolerance_rad: float) -> bool:
    """Return whether a bound on every error of four poses is below its tolerance.

    The bound takes differences of time for errors, and the greatest value of each component for one point.
    """
    _, before, after, _ = poses
    places = [(*one.position, *(one.orientation or ())) for one in poses]
    rates = [(*one.velocity, *(one.turning or ())) for one in (before, after)]
    between, width = after.between, len(places[0])
    widths = {*map(len, places), *map(len, rates), width if between is None else between.shape[1]}
    if widths != {width}:
        return False
    rows = np.array(places)
    if between is not None:
        rows = np.concatenate((rows, between))
    if width > 3 and (rows[:, 3:] @ rows[1, 3:]).min() < 0.0:  # q and -q are the same orientation
        return False
    off = _bounds(len(rows) - POSES) @ rows
    off[:2] -= 0.25 * (after.t - before.t) * np.array(rates)
    most2: list[float] = (off * off).max(axis=0).tolist()
    return sum(most2[:3]) < tolerance_m * tolerance_m and 4.0 * sum(most2[3:]) < tolerance_rad * tolerance_rad


@cache
def _bounds(count: int) -> Array:
    """Return (2 + count, 4 + count): what to take of four places, and of places seen between the middle two.

    First a quarter of the slopes of their cubic at the middle two: s (1 − s) ((1 − s) e − s f) is at most a
    quarter of the greater of e and f. Then how far each place that is seen is off the cubic.
    """
    slopes = np.array([[-2.0, -3.0, 6.0, -1.0], [1.0, -6.0, 3.0, 2.0]]) / 6.0
    below = np.hstack([-_weights(count), np.eye(count)])
    return np.vstack([np.hstack([0.25 * slopes, np.zeros((2, count))]), below])


def path_error(poses: tuple[ObservedPose, ...]) -> float:
    """Return the greatest distance [m] of the path from the cubic through four poses; 0 for fewer poses."""
    if len(poses) < POSES:
        return 0.0
    _, before, after, _ = poses
    return _missed([one.position for one in poses], (before.velocity, after.velocity), after.t - before.t)


def turn_error(poses: tuple[ObservedPose, ...]) -> float:
    """Return the greatest angle [rad] of the turn from the cubic through four poses.

    0 for fewer poses, or without orientations. A unit quaternion changes by half the angle.
    """
    known = [(one.orientation, one.turning) for one in poses if one.orientation and one.turning]
    if len(known) < POSES:
        return 0.0
    turns, rates = [known[0][0]], [known[0][1]]
    for turn, rate in known[1:]:
        sign = math.copysign(1.0, _dot(turn, turns[-1]))  # q and -q are the same orientation
        turns.append([sign * one for one in turn])
        rates.append([sign * one for one in rate])
    return 2.0 * _missed(turns, (rates[1], rates[2]), poses[2].t - poses[1].t)


def deviation_between_poses(poses: tuple[ObservedPose, ...]) -> tuple[float, float]:
    """Return how far the flange was from the cubic through four poses between the middle two, [m] and [rad].

    0 for fewer poses. Shaking passes through ten poses a second with nearly any velocity, so it is seen
    between them.
    """
    between = poses[-2].between if len(poses) == POSES else None
    if between is None:
        return 0.0, 0.0
    metres = _off_cubic(np.array([one.position for one in poses]), between[:, :3])
    turns = [one.orientation for one in poses if one.orientation]
    if len(turns) < POSES or between.shape[1] < 7:
        return metres, 0.0
    both = np.vstack([turns, between[:, 3:]])
    both *= np.where(both @ both[0] < 0.0, -1.0, 1.0)[:, None]  # q and -q are the same orientation
    return metres, 2.0 * _off_cubic(both[:POSES], both[POSES:])


def _off_cubic(places: Array, seen: Array) -> float:
    """Return how far seen places (n, c) are from the cubic through four places (4, c).

    As long as they lie between the middle two, the difference along the chord is one of time.
    """
    off = seen - _weights(len(seen)) @ places
    chord = places[2] - places[1]
    if way2 := float(chord @ chord):
        shares = (seen - places[1]) @ chord / way2
        if shares.min() >= -TURNS_BACK and shares.max() <= 1.0 + TURNS_BACK:
            off -= (off @ chord / way2)[:, None] * chord
    return math.sqrt(float(np.square(off).sum(axis=1).max()))


@cache
def _weights(count: int) -> Array:
    """Return the weights (count, 4) of four places in their cubic, evenly between the middle two."""
    s = np.linspace(0.0, 1.0, count + 2)[1:-1]
    before, after, left = 1.0 - s, 1.0 + s, 2.0 - s
    return np.column_stack(
        [-s * before * left / 6, after * before * left / 2, after * s * left / 2, -after * s * before / 6]
    )


def _missed(
    places: Sequence[Sequence[float]], velocities: tuple[Sequence[float], Sequence[float]], step: float
) -> float:
    """Return how far the cubic through four places (c,) is from the path between the middle two, at most.

    velocities: (c,) at the middle two, in 1/s of the places' unit; step: [s] between two places. The movement
    between them is the cubic with their velocities, whose error midway is nine times smaller. The slopes of
    the two curves differ by e and f there [a step]. So the curves are s (1 − s) ((1 − s) e − s f) apart. The
    farthest of three places is within 3 % of the farthest of all. Of a movement that goes on along the chord
    the difference along it is one of time, and no part of the path: a sudden stop misses nothing.
    """
    first, before, after, last = places
    chord = _less(after, before, 1.0)
    rates = [[step * v for v in velocity] for velocity in velocities]
    e = [v - (6 * c - 3 * b - 2 * a - d) / 6 for a, b, c, d, v in zip(*places, rates[0], strict=True)]
    f = [w - (a - 6 * b + 3 * c + 2 * d) / 6 for a, b, c, d, w in zip(*places, rates[1], strict=True)]
    way2, beside = _dot(chord, chord), (_less(before, first, 1.0), _less(last, after, 1.0), *rates)
    if way2 > 0.0 and min(_dot(one, chord) for one in beside) >= -TURNS_BACK * way2:
        e, f = (_less(one, chord, _dot(one, chord) / way2) for one in (e, f))
    return max(
        s * (1.0 - s) * math.hypot(*((1.0 - s) * g - s * h for g, h in zip(e, f, strict=True)))
        for s in (0.25, 0.5, 0.75)
    )


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    product: float = sum(map(mul, a, b))
    return product


def _less(a: Sequence[float], b: Sequence[float], times: float) -> list[float]:
    return [x - times * y for x, y in zip(a, b, strict=True)]

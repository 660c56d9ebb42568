"""The demonstrated path of an app, reduced to via points.

The demonstrated path is the curve of `caesura_protocol.reproduced_path` through every observation. Via
points are chosen among the observations, greedily (as Ramer, Douglas and Peucker do for polygons): where the
reproduced path is further off than the tolerance, each leg gets the observation at which it is furthest off.
A distance is the larger of position over its tolerance and angle over its own; both paths are followed in
one direction, so going back and forth is not lost. The reproduced path does not leave the demonstrated one
either. Via points use `VIA_SHARE` of a tolerance: the rest is for a program at its fastest, whose path is
smoother. A short path is kept to `OFF_SHARE` of its length, or a turn about a point would lose its point. A
leg turns by at most `MOST_TURN_RAD`, so its sense is never in doubt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import MAX_VIA_POINTS, AppPath, ViaPoint
from caesura_protocol.reproduced_path import TOLERANCE_M, TOLERANCE_RAD, Curve, unit
from caesura_protocol.rotations import align_signs, angles
from caesura_service.program.program_segment import OBSERVED_S

Array = NDArray[np.float64]
PosesBetween = Callable[[float, float], tuple[Array, Array]]

MOST_TURN_RAD = math.radians(100.0)
VIA_SHARE = 0.5
TURN_RAD = math.radians(5.0)  # a turn in a rest from which on it is a movement
OFF_SHARE, OFF_LEAST_M = 0.05, 0.0003  # of a short path it may be off; what a still hand moves
BETWEEN = 3  # compared points from one observation to the next
PARTS = 8  # pieces of a leg, which is compared piece by piece
MOST_KEPT = 256  # paths that are kept for the next look


@dataclass
class Paths:
    """Paths between times of one demonstration.

    poses_between: returns times (n,) [s] and flange poses (n, 3 or 7) between two times, at least one;
    settled_until: time [s]; what ends after it still changes and has no path.
    """

    poses_between: PosesBetween
    tolerance_m: float = TOLERANCE_M
    tolerance_rad: float = TOLERANCE_RAD
    settled_until: float = np.inf
    _kept: dict[tuple[float, float, bool, bool], AppPath] = field(default_factory=dict)
    _speeds: dict[float, tuple[float, float]] = field(default_factory=dict)

    def between(
        self, t0: float, tn: float, *, begins_moving: bool = False, ends_moving: bool = False
    ) -> AppPath | None:
        """Return the path from one time to another [s].

        None if it is not settled yet, and where one observation is the nearest to both times.

        begins_moving, ends_moving: whether it states the hand's velocity at its start and at its end.
        """
        if tn > self.settled_until:
            return None
        key = t0, tn, begins_moving, ends_moving
        if (found := self._kept.get(key)) is None:
            t, poses = self.poses_between(t0, tn)
            if len(t) < 2:
                return None
            passing = np.full((len(t), 6), np.nan)
            if begins_moving:
                passing[0] = self._passing_at(float(t[0]))
            if ends_moving:
                passing[-1] = self._passing_at(float(t[-1]))
            found = self._kept[key] = self._made(t, poses, passing)
            if len(self._kept) > MOST_KEPT:
                del self._kept[next(iter(self._kept))]
        return found

    def off_straight_m(self, t0: float, tn: float) -> float | None:
        """Return the largest distance [m] of the path from the straight line between two times [s].

        None where the path is not settled yet.
        """
        if tn > self.settled_until:
            return None
        places = self.poses_between(t0, tn)[1][:, :3]
        away, line = places - places[0], np.broadcast_to(places[-1] - places[0], places.shape)
        return float(np.linalg.norm(_projected(away, line)[1], axis=1).max())

    def turning(self, t0: float, tn: float) -> tuple[float, float] | None:
        """Return the times [s] between which the flange turns in a rest.

        None for a turn by less than `TURN_RAD`, without orientations, and where the rest is not settled yet.
        """
        if tn > self.settled_until:
            return None
        t, poses = self.poses_between(t0, tn)
        if poses.shape[1] < 7:
            return None
        from_start, to_end = (angles(poses[:, 3:], poses[i, 3:]) for i in (0, -1))
        if from_start.max() < TURN_RAD:
            return None
        begins = int(np.argmax(from_start > self.tolerance_rad)) - 1
        ends = len(t) - int(np.argmax(to_end[::-1] > self.tolerance_rad))
        return float(t[max(begins, 0)]), float(t[min(ends, len(t) - 1)])

    def speeds_at(self, t: float) -> tuple[float, float] | None:
        """Return the speed [m/s] and the rate of turn [rad/s] at the observation nearest to a time [s].

        None without both neighbours of it; the rate is 0 without orientations. Found once for each time.
        """
        if t > self.settled_until:
            return None
        if (known := self._speeds.get(t)) is not None:
            return known
        beside = self._beside(t)
        if beside is None:
            return None
        times, poses = beside
        seconds = float(times[2] - times[0])
        turned = float(angles(poses[:1, 3:], poses[2, 3:])[0]) if poses.shape[1] == 7 else 0.0
        speeds = math.dist(poses[0, :3], poses[2, :3]) / seconds, turned / seconds
        self._speeds[t] = speeds
        if len(self._speeds) > MOST_KEPT:
            del self._speeds[next(iter(self._speeds))]
        return speeds

    def _passing_at(self, t: float) -> Array:
        """Velocity [m/s] and angular velocity [rad/s] (6,) at an observation; nan without both neighbours."""
        passing = np.full(6, np.nan)
        if (beside := self._beside(t)) is not None:
            found = Curve.through(*beside).passing[1]
            passing[: len(found)] = found
        return passing

    def _beside(self, t: float) -> tuple[Array, Array] | None:
        """Return times (3,) [s] and poses of an observation and both neighbours; None without both."""
        times, poses = self.poses_between(t - OBSERVED_S, t + OBSERVED_S)
        return (times, poses) if len(times) == 3 and times[2] - times[0] < 2.5 * OBSERVED_S else None

    def _made(self, t: Array, poses: Array, passing: Array) -> AppPath:
        """The path of observations; passing: (n, 6) as `reduced` takes it."""
        length_m = float(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1).sum())
        kept_m = min(VIA_SHARE * self.tolerance_m, max(OFF_SHARE * length_m, OFF_LEAST_M))
        knots, off_m, off_rad = reduced(t, poses, kept_m, VIA_SHARE * self.tolerance_rad, passing=passing)
        rests = np.isnan(passing[[0, -1], 0])
        passed = Curve.through(t, poses, passing=passing).passing.tolist()
        points = [_point(float(t[i]), poses[i], passed[i]) for i in knots]
        start, end, still = points[0], points[-1], {"velocity": None, "angular_velocity": None}
        return AppPath(
            start=start.model_copy(update=still) if rests[0] else start,
            via=tuple(points[1:-1]),
            tn=end.t,
            end_velocity=None if rests[1] else end.velocity,
            end_angular_velocity=None if rests[1] else end.angular_velocity,
            length_m=length_m,
            deviation_m=off_m,
            deviation_rad=off_rad,
            tolerance_m=self.tolerance_m,
            tolerance_rad=self.tolerance_rad,
        )


def reduced(
    t: Array,
    poses: Array,
    tolerance_m: float,
    tolerance_rad: float,
    most: int = MAX_VIA_POINTS,
    passing: Array | None = None,
) -> tuple[list[int], float, float]:
    """Return the observations (indices) that a path leads through, and its largest deviations [m], [rad].

    t: (n,) [s], rising; poses: (n, 3 or 7). At most `most` via points between the first and the last.
    passing: as `Curve.through` takes it; without it, the path begins and ends at rest.
    """
    poses = unit(np.array(poses, dtype=np.float64))
    n = len(t)
    if n < 3:
        return list(range(n)), 0.0, 0.0
    if poses.shape[1] == 7:
        align_signs(poses[:, 3:])
    demonstrated = Curve.through(t, poses, passing=passing)
    shown = demonstrated.sampled(BETWEEN)
    near = np.minimum((np.arange(len(shown)) + BETWEEN // 2) // BETWEEN, n - 1)  # observation of each point
    knots = _sides(poses)
    while True:
        curve = Curve.through(t[knots], poses[knots], passing=demonstrated.passing[knots])
        leg = np.searchsorted(np.array(knots[1:-1]) * BETWEEN, np.arange(len(shown)), side="right")
        off_m, off_rad = deviations(shown, curve, leg, tolerance_m, tolerance_rad)
        off = np.maximum(off_m / tolerance_m, off_rad / tolerance_rad)
        added = _worst(off, leg, near, knots)
        away_m = 0.0
        if not added:
            away_m, added = _excursions(shown[:, :3], curve, knots, tolerance_m)
        added = added[: most + 2 - len(knots)]
        if not added:
            return knots, max(float(off_m.max()), away_m), float(off_rad.max())
        knots = sorted([*knots, *added])


def _excursions(shown: Array, curve: Curve, knots: list[int], tolerance_m: float) -> tuple[float, list[int]]:
    """Return the largest distance [m] of a curve from shown places (m, 3), and the observations to add.

    One is added in the middle of each leg that is further away than the tolerance, the worst leg first.
    """
    line = curve.sampled(PARTS)[:, :3]
    furthest, found = 0.0, []
    for number, (low, high) in enumerate(pairwise(knots)):
        places = shown[low * BETWEEN : high * BETWEEN + 1]
        step = np.diff(places, axis=0)
        away = line[number * PARTS + 1 : (number + 1) * PARTS, None] - places[:-1]
        _, apart = _projected(away, step)
        far = float(np.sqrt(np.vecdot(apart, apart).min(axis=1).max()))
        furthest = max(furthest, far)
        if far > tolerance_m and high - low > 1:
            found.append((-far, (low + high) // 2))
    return furthest, [middle for _, middle in sorted(found)]


def deviations(
    shown: Array, curve: Curve, leg: NDArray[np.int64], tolerance_m: float, tolerance_rad: float
) -> tuple[Array, Array]:
    """Return distances (m,) [m] and angles (m,) [rad] from poses (m, c) to a curve.

    leg: (m,) the leg of each pose. The nearest point has the least distance with both divided by their
    tolerances; points on the curve never go back from one pose to the next.
    """
    scale = np.array([1.0 / tolerance_m] * 3 + [2.0 / tolerance_rad] * (shown.shape[1] - 3))
    line = curve.sampled(PARTS) * scale
    seen = shown * scale
    first = leg[:, None] * PARTS + np.arange(PARTS)
    start = line[first]
    step = line[first + 1] - start
    away = seen[:, None] - start
    share, apart = _projected(away, step)
    best = np.argmin(np.vecdot(apart, apart), axis=1)
    rows = np.arange(len(seen))
    place = np.maximum.accumulate(first[rows, best] + share[rows, best])
    piece = np.minimum(place.astype(np.int64), len(line) - 2)
    share = (place - piece)[:, None]
    left = seen - (1.0 - share) * line[piece] - share * line[piece + 1]
    square = np.square(left)
    off_m = tolerance_m * np.sqrt(square[:, :3].sum(axis=1))
    half_chord = np.minimum(0.25 * tolerance_rad * np.sqrt(square[:, 3:].sum(axis=1)), 1.0)
    return off_m, 4.0 * np.arcsin(half_chord)


def _projected(away: Array, step: Array) -> tuple[Array, Array]:
    """Return the share (…) of a segment at its place nearest to a point, and the vector (…, c) from there.

    away: (…, c) of the point from the segment's start; step: (…, c) from its start to its end.
    """
    share = np.clip(np.vecdot(away, step) / np.maximum(np.vecdot(step, step), 1e-18), 0.0, 1.0)
    return share, away - share[..., None] * step


def _sides(poses: Array) -> list[int]:
    """Return the first and last observation, and enough between them that no leg turns too far."""
    knots = [0]
    if poses.shape[1] == 7:
        while (far := angles(poses[knots[-1] + 1 :, 3:], poses[knots[-1], 3:]) > MOST_TURN_RAD).any():
            knots.append(knots[-1] + max(int(np.argmax(far)), 1))
    return knots if knots[-1] == len(poses) - 1 else [*knots, len(poses) - 1]


def _worst(off: Array, leg: NDArray[np.int64], near: NDArray[np.int64], knots: list[int]) -> list[int]:
    """Return the observation with the greatest deviation of each leg that exceeds a tolerance, the worst
    first.
    """
    found: list[tuple[float, int]] = []
    starts = np.searchsorted(leg, np.arange(len(knots) - 1))
    worst = np.maximum.reduceat(off, starts)
    for number in np.flatnonzero(worst > 1.0).tolist():
        low, high = knots[number], knots[number + 1]
        if high - low > 1:
            point = int(starts[number]) + int(np.argmax(off[leg == number]))
            found.append((-float(worst[number]), min(max(int(near[point]), low + 1), high - 1)))
    return [index for _, index in sorted(found)]


def _point(t: float, pose: Array, passing: Sequence[float]) -> ViaPoint:
    x, y, z, *quaternion = pose.tolist()
    vx, vy, vz, *turning = passing
    return ViaPoint(
        t=t,
        position=(x, y, z),
        orientation=tuple(quaternion) or None,
        velocity=(vx, vy, vz),
        angular_velocity=tuple(turning) or None,
    )

"""Free movements by published laws of hand motion, with their truth; without robot, teacher and wrench.

No parameter of a model was chosen on them. Kinds of movement, each between rests:

- `stroke`: straight, with minimum jerk (Flash & Hogan 1985).
- `corners`: strokes in other directions that overlap in time (Flash & Henis 1991).
- `hesitation`: the same in one direction: the speed dips, and nothing turns.
- `zigzag`: short strokes to and fro.
- `curve`: a smooth curve at a speed of curvature^(−1/3) (Lacquaniti, Terzuolo & Viviani 1983).
- `tracing`: a wandering line at 8 to 25 mm/s, along which the tool sticks and slips.

Every movement has an unsteady hand and a sensor with noise. A corner by design is major where the speed is
below 0.55 of the lesser neighbouring peak, else optional. By the annotators' rule other places may be corners
by chance: near its limits, 45° and 0.6, they are optional.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, lfilter, sosfiltfilt

from caesura_lab.evaluation.cases.seeded_case import SeededCase
from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, Truth
from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_lab.teacher.speed_dip_truth import angle_deg
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]

RATE_HZ = 500
STEP_S = 1.0 / RATE_HZ
TOLERANCE_S = 0.15  # of an annotator
PEAK_S = 0.7  # to either side of a dip
CHORDS_S = (0.2, 0.3, 0.4)
NEAR_TURN_DEG, NEAR_DIP = 35.0, 0.7  # what may be a corner by the annotators' rule
MAJOR_DIP = 0.55
SLOWEST_M_PER_S = 0.005  # of a peak beside a corner
APART_S = 0.3  # a corner by chance is this far from every other point
LOOK_HZ = 5.0  # low-pass of the speed that is judged
UNSTEADY_M, SWAY_M, NOISE_M = 0.0008, 0.0002, 1e-5  # of a moving hand, of any hand, of the sensor


class _Movement(NamedTuple):
    """A movement that begins at the origin: (n, 3) [m], and its corners by design [s].

    begins_s, ends_s: from its ends to where it can be seen.
    """

    path: Array
    corners: tuple[float, ...] = ()
    begins_s: float = 0.0
    ends_s: float = 0.0


class FreeMovements(SeededCase):
    """A demonstration of a few movements of one kind of `MOVEMENTS`."""

    def load(self) -> tuple[Recording, Truth]:
        """Simulate the recording and its truth."""
        rng = self.rng
        movement, few, many = MOVEMENTS[self.kind]
        path, points, spans = [np.zeros((1, 3))], list[TrueChangepoint](), list[TrueSegment]()
        for _ in range(rng.integers(few, many + 1)):
            _append_rest(path, spans, rng.uniform(0.5, 2.0))
            _append_movement(path, points, spans, movement(rng))
        _append_rest(path, spans, 1.0)
        position = unsteady(np.concatenate(path), rng)
        points += _corners_by_chance(position, points)
        t: Array = STEP_S * np.arange(len(position), dtype=np.float64)
        recording = Recording(t, {"pos": position}, "none", name=self.name, hand_on_robot="yes")
        truth = Truth(
            self.name,
            (0.0, float(t[-1])),
            tuple(sorted(points, key=lambda point: point.t)),
            tuple(spans),
            robot=self.kind,
        )
        return recording, truth


def _append_rest(path: list[Array], spans: list[TrueSegment], seconds: float) -> None:
    begun = _length_s(path)
    path.append(np.repeat(path[-1][-1:], round(seconds * RATE_HZ), axis=0))
    spans.append(TrueSegment(begun, _length_s(path), "steady"))


def _append_movement(
    path: list[Array], points: list[TrueChangepoint], spans: list[TrueSegment], movement: _Movement
) -> None:
    begun = _length_s(path)
    path.append(path[-1][-1] + movement.path - movement.path[0])
    ended = _length_s(path)
    speed = _speed(movement.path)
    points.append(TrueChangepoint(begun + movement.begins_s, TOLERANCE_S, kind="start"))
    for t in movement.corners:
        is_major = _dip(speed, round(t * RATE_HZ)) < MAJOR_DIP
        points.append(TrueChangepoint(begun + t, TOLERANCE_S, not is_major, "corner"))
    points.append(TrueChangepoint(ended - movement.ends_s, TOLERANCE_S, kind="stop"))
    spans.append(TrueSegment(begun, ended, "motion"))


def _length_s(path: list[Array]) -> float:
    return STEP_S * (sum(map(len, path)) - 1)


def _speed(path: Array) -> Array:
    speed: Array = np.linalg.norm(np.gradient(path, STEP_S, axis=0), axis=1)
    return speed


def _dip(speed: Array, i: int) -> float:
    """Return the speed at an index, divided by the lesser of the peaks beside it; 1 where none is higher."""
    reach = round(PEAK_S * RATE_HZ)
    before, after = speed[max(i - reach, 0) : i], speed[i + 1 : i + 1 + reach]
    if not (len(before) and len(after)):
        return 1.0
    return float(speed[i] / max(min(before.max(), after.max()), SLOWEST_M_PER_S))


def unsteady(path: Array, rng: np.random.Generator) -> Array:
    """Return a path as a hand makes it, and a sensor measures it: (n, 3) [m]."""
    effort = UNSTEADY_M * np.minimum(_speed(path) / 0.1, 1.5) ** 0.7
    error = effort[:, None] * wander_3d(len(path), 2.0, rng)
    sway = SWAY_M * wander_3d(len(path), 0.5, rng)
    smooth: Array = gaussian_filter1d(error, 0.05 * RATE_HZ, axis=0)
    return path + smooth + sway + NOISE_M * rng.normal(size=path.shape)


def wander(n: int, cut_hz: float, rng: np.random.Generator) -> Array:
    """Return (n,) values of a second-order low-pass process with a deviation of 1."""
    pole = np.exp(-2.0 * np.pi * cut_hz * STEP_S)
    settled = 4 * RATE_HZ
    values = rng.normal(size=n + settled)
    for _ in range(2):
        values = lfilter([1.0 - pole], [1.0, -pole], values)
    unit: Array = values[settled:] / values[settled:].std()
    return unit


def wander_3d(n: int, cut_hz: float, rng: np.random.Generator) -> Array:
    """Return (n, 3) values of three processes as of `wander`."""
    values: Array = np.column_stack([wander(n, cut_hz, rng) for _ in range(3)])
    return values


def _corners_by_chance(position: Array, points: list[TrueChangepoint]) -> list[TrueChangepoint]:
    """Return optional points where the path turns at a dip of its speed, and no point is near."""
    seen = sosfiltfilt(butter(2, LOOK_HZ, fs=RATE_HZ, output="sos"), position, axis=0)
    speed, near = _speed(seen), round(0.5 * TOLERANCE_S * RATE_HZ)
    found = []
    for i in range(near, len(speed) - near):
        if speed[i] != speed[i - near : i + near + 1].min() or _dip(speed, i) >= NEAR_DIP:
            continue
        t = STEP_S * i
        if _turn_deg(seen, i) > NEAR_TURN_DEG and all(abs(point.t - t) > APART_S for point in points):
            found.append(TrueChangepoint(t, TOLERANCE_S, optional=True, kind="corner"))
    return found


def _turn_deg(path: Array, i: int) -> float:
    """Return the largest turn [degrees] at an index, between chords of the same time on both sides."""
    turns = [0.0]
    for chord in (round(seconds * RATE_HZ) for seconds in CHORDS_S):
        if chord <= i < len(path) - chord:
            turns.append(angle_deg(path[i] - path[i - chord], path[i + chord] - path[i]))
    return max(turns)


def _direction(rng: np.random.Generator) -> Array:
    """Return a unit vector, mostly level."""
    direction = rng.normal(size=3) * (1.0, 1.0, 0.3)
    return direction / np.linalg.norm(direction)


def overlapping(strokes: Array, seconds: Array, begun: Array) -> Array:
    """Return the sum of strokes (k, 3) [m] with these durations and starts (k,) [s]."""
    t = np.arange(0.0, (begun + seconds).max(), STEP_S)
    shares = minimum_jerk(np.clip((t[:, None] - begun) / seconds, 0.0, 1.0))
    path: Array = shares @ strokes
    return path


def seen_s(seconds: float) -> float:
    """Return the time [s] from the end of a minimum jerk stroke to where it can be seen."""
    return 0.06 * seconds


def _stroke(rng: np.random.Generator) -> _Movement:
    size = np.exp(rng.uniform(np.log(0.03), np.log(0.4)))
    seconds = float(np.clip(0.5 + 0.9 * np.sqrt(size / 0.2) * rng.uniform(0.7, 1.5), 0.5, 3.5))
    path = overlapping(size * _direction(rng)[None], np.array([seconds]), np.zeros(1))
    return _Movement(path, (), seen_s(seconds), seen_s(seconds))


def _corners(rng: np.random.Generator) -> _Movement:
    directions = [_direction(rng)]
    for _ in range(rng.integers(1, 5)):
        while (following := _direction(rng)) @ directions[-1] > np.cos(np.radians(65.0)):
            pass
        directions.append(following)
    count = len(directions)
    seconds, overlaps = rng.uniform(0.7, 1.6, count), rng.uniform(0.1, 0.3, count - 1)
    begun = np.concatenate([[0.0], np.cumsum(seconds[:-1] * (1.0 - overlaps))])
    path = overlapping(rng.uniform(0.06, 0.25, count)[:, None] * directions, seconds, begun)
    speed = _speed(path)
    corners = []
    for start, end in zip(begun[1:], (begun + seconds)[:-1], strict=True):
        first, last = (round(t * RATE_HZ) for t in (start - 0.1, end + 0.1))
        corners.append(STEP_S * (first + int(speed[first:last].argmin())))
    return _Movement(path, tuple(corners), seen_s(seconds[0]), seen_s(seconds[-1]))


def _hesitation(rng: np.random.Generator) -> _Movement:
    count = rng.integers(2, 4)
    seconds = rng.uniform(0.7, 1.4, count)
    begun = np.concatenate([[0.0], np.cumsum(seconds[:-1] * rng.uniform(0.6, 0.8, count - 1))])
    path = overlapping(rng.uniform(0.08, 0.2, count)[:, None] * _direction(rng), seconds, begun)
    return _Movement(path, (), seen_s(seconds[0]), seen_s(seconds[-1]))


def _zigzag(rng: np.random.Generator) -> _Movement:
    ahead, count = _direction(rng), rng.integers(4, 9)
    aside = np.cross(ahead, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    seconds = rng.uniform(0.3, 0.7) * rng.uniform(0.85, 1.15, count)
    sizes = rng.uniform(0.02, 0.06) * rng.uniform(0.85, 1.15, count)
    strokes = sizes[:, None] * ((-1.0) ** np.arange(count)[:, None] * aside + 0.2 * ahead)
    ends = np.cumsum(seconds)
    path = overlapping(strokes, seconds, ends - seconds)
    return _Movement(path, tuple(ends[:-1]), seen_s(seconds[0]), seen_s(seconds[-1]))


def _curve(rng: np.random.Generator) -> _Movement:
    along = np.linspace(0.0, 1.0, 4000)
    size = rng.uniform(0.08, 0.2)
    path = np.zeros((len(along), 3))
    for harmonic in (1, 2):
        turns = harmonic * rng.uniform(0.5, 1.0)
        for axis in range(3):
            phase = 2.0 * np.pi * (turns * along + rng.uniform())
            path[:, axis] += size / harmonic * rng.normal() * np.sin(phase)
    first = np.gradient(path, axis=0)
    bend = np.linalg.norm(np.cross(first, np.gradient(first, axis=0)), axis=1)
    curvature = np.clip(bend / np.linalg.norm(first, axis=1) ** 3, 1.0, 60.0)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    ends = np.minimum(way, way[-1] - way)
    speed = rng.uniform(0.12, 0.25) * (curvature / 8.0) ** (-1.0 / 3.0)
    speed *= np.minimum(1.0, np.sqrt(ends / 0.03 + 0.003))
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speed[1:] + speed[:-1]))])
    t = np.arange(0.0, times[-1], STEP_S)
    evenly = np.column_stack([np.interp(t, times, path[:, axis]) for axis in range(3)])
    return _Movement(gaussian_filter1d(evenly, 0.04 * RATE_HZ, axis=0, mode="nearest"))


def _tracing(rng: np.random.Generator) -> _Movement:
    seconds = rng.uniform(2.0, 6.0)
    t = np.arange(0.0, seconds, STEP_S)
    speed = rng.uniform(0.008, 0.025) * np.exp(0.45 * wander(len(t), 1.5, rng))
    speed *= np.clip(np.minimum(t, seconds - t) / 0.25, 0.0, 1.0)
    heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(1.5 * wander(len(t), 0.15, rng)) * STEP_S
    steps = STEP_S * speed[:, None] * np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(t))])
    return _Movement(np.cumsum(steps, axis=0), (), 0.05, 0.05)


#: A kind of movement, and how many a demonstration has: at least, and at most.
MOVEMENTS: Mapping[str, tuple[Callable[[np.random.Generator], _Movement], int, int]] = {
    "stroke": (_stroke, 5, 8),
    "corners": (_corners, 2, 2),
    "hesitation": (_hesitation, 3, 3),
    "zigzag": (_zigzag, 2, 2),
    "curve": (_curve, 2, 3),
    "tracing": (_tracing, 4, 7),
}

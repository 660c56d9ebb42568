"""The observations of a session, stored compactly as rows of numbers, old ones in a file."""

from __future__ import annotations

import math
import struct
from bisect import bisect_left
from functools import lru_cache, partial
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from caesura_service.changepoint.channel_model import ModelInput
from caesura_service.changepoint.constant_models import HoldingStates
from caesura_service.changepoint.turn_resistance import torsion_of
from caesura_service.coaching import ObservedPose
from caesura_service.constants import HANDS_BREADTH_M, JOINTS_MOST, REST_M_PER_S, TARED_BIAS_N, UP
from caesura_service.program import Moment
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.segmentation.load_inertia import Acceleration, without_load_inertia
from caesura_service.segmentation.overflow_file import AppendLog
from caesura_service.segmentation.screw_motion_fit import Course
from caesura_service.signals import Observation

Array = NDArray[np.float64]
Row = tuple[float, ...]

_T, _POSITION, _FORCE = 0, slice(1, 4), slice(4, 7)
_SUMS, _HOLDING, _AFTER_GAP, _GRIPPER = slice(7, 9), 9, 10, 11
_ORIENTATION, _JOINTS = slice(12, 16), slice(16, 16 + JOINTS_MOST)  # nan where unknown, as the gripper
_SCALE, _ROTATION, _TORQUE, _BOUNDARY = 24, slice(25, 28), slice(28, 31), 31
_STATES, _CHANGES = 32, 33  # of the gripper so far: those that are known, and their changes
_ACCELERATION, _COLUMNS = slice(34, 37), 37
_ROW = struct.Struct(f"{_COLUMNS}d")
_NO_ORIENTATION, _NO_JOINTS, _UNTURNED = (np.nan,) * 4, (np.nan,) * JOINTS_MOST, (0.0,) * 3
_NO_TORQUE = (np.nan,) * 3
ROWS_AT_HAND = 64  # that stay decoded: each update of the segments reads them again
SAME_S = 1e-3  # two times this close are the same
TURN_OBSERVATIONS = 200  # at a turn, 20 s
OPENINGS = 6000  # of the fingers, ten minutes: of a longer session some are left out
POSES = 1200  # of a path, two minutes: of a longer one some are left out
PRESS_OBSERVATIONS, PRESSES_AT_HAND = 600, 8
EMPTY_GRIPPER_M = 0.003  # fingers that settle closer than this hold nothing


class ObservationStore:
    """Rows of observations, with cumulative sums of the vertical force for means in constant time.

    All values are in the robot's base frame. upright: (3, 3) the rotation that maps up to +z; the inputs of
    the segment models are rotated by it. None if the base is upright.
    """

    def __init__(self, upright: Array | None = None) -> None:
        self._upright = upright
        self._up = UP if upright is None else tuple(upright[2].tolist())
        self._log, self._count = AppendLog(), 0  # observations
        self._acceleration = Acceleration()
        self._sum = self._sum2 = 0.0  # of the vertical force [N] and its square [N²]
        self._states = self._changes = 0  # of the gripper
        self._state = np.nan  # the last one that is known
        self._row = lru_cache(ROWS_AT_HAND)(partial(_read, self._log))
        self._forces = lru_cache(PRESSES_AT_HAND)(partial(_read_forces, self._log))

    def __len__(self) -> int:
        return self._count

    @property
    def t_last(self) -> float:
        """The time [s] of the last observation; −inf before the first."""
        return self.t(self._count - 1) if self._count else -np.inf

    def append(self, observation: Observation) -> None:
        """Store one more observation."""
        force = observation.force_base.tolist()
        vertical_n = force[2] if self._upright is None else sum(map(mul, self._up, force))
        self._sum += vertical_n
        self._sum2 += vertical_n * vertical_n
        self._count_state(state := holding(observation))
        acceleration = self._acceleration.next(observation.velocity_base, after_gap=observation.after_gap)
        orientation, joints, width = observation.orientation, observation.joints, observation.gripper_width
        self._log.append(
            _ROW.pack(
                observation.t,
                *observation.position_base.tolist(),
                *force,
                self._sum,
                self._sum2,
                state,
                observation.after_gap,
                np.nan if width is None else width,
                *(_NO_ORIENTATION if orientation is None else orientation.tolist()),
                *(_NO_JOINTS if joints is None else (*joints.tolist(), *_NO_JOINTS[len(joints) :])),
                force_scale(observation),
                *(_UNTURNED if observation.rotation is None else observation.rotation.tolist()),
                *(_NO_TORQUE if observation.torque_base is None else observation.torque_base.tolist()),
                np.nan if observation.boundary_before is None else observation.boundary_before,
                self._states,
                self._changes,
                *acceleration.tolist(),
            )
        )
        self._count += 1

    def _count_state(self, state: float) -> None:
        """Count a state of the gripper, and whether it differs from the one known before; nan is no state."""
        if not math.isnan(state):
            self._states += 1
            self._changes += not math.isnan(self._state) and state != self._state
            self._state = state

    def holding_states(self, start: int, end: int) -> HoldingStates | None:
        """Return the known states of the gripper from start to end, not included; None without one."""
        last, before = self._row(end - 1), self._row(start - 1)[_STATES] if start else 0.0
        known = last[_STATES] - before
        if not known:
            return None
        first = bisect_left(range(end), before + 1.0, start, key=lambda index: self._row(index)[_STATES])
        row = self._row(first)
        changes = int(last[_CHANGES] - row[_CHANGES])
        return HoldingStates(row[_HOLDING], int(known) - 1 - changes, changes)

    def observed(self, index: int) -> ModelInput:
        """Return an observation as the input of the segment models."""
        row = self._row(index)
        force, rotation = np.array(row[_FORCE]), np.array(row[_ROTATION])
        torque = None if math.isnan(row[_TORQUE.start]) else np.array(row[_TORQUE])
        torsion, position = torsion_of(force, torque), np.array(row[_POSITION])
        found = ModelInput(position, force / row[_SCALE], row[_HOLDING], rotation, torsion)
        return upright_input(found, np.array(row[_ACCELERATION]), self._upright)

    def after_gap(self, index: int) -> bool:
        """Whether samples are missing before an observation."""
        return bool(self._row(index)[_AFTER_GAP])

    def t(self, index: int) -> float:
        """Return the time [s] of an observation."""
        return self._row(index)[_T]

    def boundary_before(self, index: int) -> float | None:
        """Return the time [s] at which a segment that starts with the observation before begins.

        None if it is unknown.
        """
        found = self._row(index)[_BOUNDARY]
        return None if math.isnan(found) else found

    def position(self, index: int) -> tuple[float, float, float]:
        """Return the flange position (3,) [m]."""
        x, y, z = self._row(index)[_POSITION]
        return x, y, z

    def turned(self, begin: int, last: int) -> tuple[float, float, float]:
        """Return the sum (3,) [rad] of rotation vectors from one observation to another, base frame."""
        before, after = self._row(begin)[_ROTATION], self._row(last)[_ROTATION]
        x, y, z = (b - a for a, b in zip(before, after, strict=True))
        return x, y, z

    def rests(self, index: int) -> bool:
        """Whether the flange has neither moved nor turned since the observation before.

        False for the first observation, and behind a gap.
        """
        if index == 0 or self.after_gap(index):
            return False
        seconds = self.t(index) - self.t(index - 1)
        moved = math.dist(self.position(index - 1), self.position(index))
        turned = HANDS_BREADTH_M * math.hypot(*self.turned(index - 1, index))
        return max(moved, turned) <= REST_M_PER_S * seconds

    def force(self, index: int) -> tuple[float, float, float]:
        """Return the tared force (3,) [N] on the robot."""
        x, y, z = self._row(index)[_FORCE]
        return x, y, z

    def press(self, start: int, end: int) -> tuple[float, float, float]:
        """Return the median of the strong forces (3,) [N] from start to end, which is not included.

        Touch and release are left out (`pressed_from`). At most PRESS_OBSERVATIONS are read, evenly
        spread. The median is taken on each axis, one of which is vertical.
        """
        forces = self._forces(range(start, end, -(-(end - start) // PRESS_OBSERVATIONS)))
        sizes = np.sqrt(np.square(forces) @ np.ones(3))
        strong = forces[sizes >= pressed_from(sizes)]
        strong = np.sort(strong if self._upright is None else strong @ self._upright.T, axis=0)
        median = 0.5 * (strong[(len(strong) - 1) // 2] + strong[len(strong) // 2])
        x, y, z = (median if self._upright is None else median @ self._upright).tolist()
        return x, y, z

    def mean_force(self, start: int, end: int) -> Array:
        """Return the mean force (3,) [N] from start to end, not included; of PRESS_OBSERVATIONS at most."""
        mean: Array = self._forces(range(start, end, -(-(end - start) // PRESS_OBSERVATIONS))).mean(axis=0)
        return mean

    def poses(self, t0: float, tn: float) -> tuple[Array, Array]:
        """Return times (n,) [s] and flange poses (n, 7) between the observations nearest to t0 and to tn.

        So a range starts at the end of the one before it, and after a gap at its own first observation. Poses
        are (n, 3) if an orientation is unknown. More than POSES are decimated evenly.
        """
        start, end = self.nearest(t0), self.nearest(tn)
        if start < end and t0 > self.t(start) + SAME_S and self.after_gap(start + 1):
            start += 1
        rows = self._rows(start, end, POSES)
        turns = rows[:, _ORIENTATION]
        known = not np.isnan(turns).any()
        return rows[:, _T].copy(), np.hstack([rows[:, _POSITION], turns] if known else [rows[:, _POSITION]])

    def all_poses(self) -> tuple[Array, Array]:
        """Return times (n,) [s] and flange poses (n, 7) of all observations, orientations nan if unknown."""
        blocks = [np.empty((0, 8))]
        for start in range(0, self._count, POSES):
            rows = self._rows(start, min(start + POSES, self._count) - 1, POSES)
            blocks.append(np.column_stack([rows[:, _T], rows[:, _POSITION], rows[:, _ORIENTATION]]))
        found = np.vstack(blocks)
        return found[:, 0], found[:, 1:]

    def openings(self) -> tuple[Array, Array]:
        """Return times (n,) [s] and openings of the fingers (n,) [m], nan where unknown.

        More than OPENINGS are decimated evenly.
        """
        if not self._count:
            return np.empty(0), np.empty(0)
        rows = self._rows(0, self._count - 1, OPENINGS)
        return rows[:, _T].copy(), rows[:, _GRIPPER].copy()

    def course(self, begin: int, last: int) -> Course:
        """Return the observations of a turn between two observations, evenly decimated to about
        TURN_OBSERVATIONS.
        """
        rows = self._rows(begin, last, TURN_OBSERVATIONS)
        torques = rows[:, _TORQUE]
        return Course(
            positions=rows[:, _POSITION],
            orientations=rows[:, _ORIENTATION],
            turned=rows[:, _ROTATION] - rows[0, _ROTATION],
            forces=rows[:, _FORCE],
            torques=None if np.isnan(torques).any() else torques,
        )

    def torques(self, t0: float, tn: float) -> Array:
        """Return torques (n, 3) [Nm] about the flange at the observations between two times [s].

        Without a tared torque there are none, (0, 3). More than PRESS_OBSERVATIONS are decimated evenly.
        """
        torques = self._rows(self.nearest(t0), self.nearest(tn), PRESS_OBSERVATIONS)[:, _TORQUE]
        return np.empty((0, 3)) if np.isnan(torques).any() else torques.copy()

    def _rows(self, start: int, end: int, most: int) -> Array:
        """Return rows (n, columns) from one observation to another, evenly thinned to about `most`."""
        indices = np.arange(start, end, -(-max(end - start, 1) // most))
        if len(indices) < end - start:
            return np.array([self._row(int(index)) for index in [*indices, end]])
        return np.frombuffer(self._log.read(start * _ROW.size, (end + 1) * _ROW.size)).reshape(-1, _COLUMNS)

    def vertical_force(self, start: int, end: int) -> tuple[float, float]:
        """Return mean [N] and variance [N²] of the vertical force from start to end, the end not included."""
        before, before2 = self._sums(start)
        until, until2 = self._sums(end)
        mean, mean2 = (until - before) / (end - start), (until2 - before2) / (end - start)
        return mean, max(mean2 - mean * mean, 0.0)

    def _sums(self, end: int) -> tuple[float, float]:
        """Return the sums of the vertical force [N] and of its square [N²] before an observation."""
        total, total2 = self._row(end - 1)[_SUMS] if end else (0.0, 0.0)
        return total, total2

    def moment(self, t: float) -> Moment:
        """Return the robot's state at the observation nearest to a time [s].

        Raises IndexError without one.
        """
        return self.moment_at(self.nearest(t))

    def nearest(self, t: float) -> int:
        """Return the observation nearest to a time [s], the earlier of two. Raises IndexError without one."""
        if not self._count:
            raise IndexError("no observation yet")
        after = min(max(self._first_from(t), 1), self._count - 1)
        return after - 1 if after and t - self.t(after - 1) <= self.t(after) - t + SAME_S else after

    def _first_from(self, t: float) -> int:
        """Return the first observation at or after a time [s], searched from the end."""
        end, reach = self._count, 1
        while reach <= self._count and self.t(self._count - reach) >= t:
            end, reach = self._count - reach, 2 * reach
        return bisect_left(range(end), t, max(self._count - reach, 0), key=self.t)

    def moment_at(self, index: int) -> Moment:
        """Return the robot's state at an observation."""
        row = self._row(index)
        return Moment(
            position=self.position(index),
            orientation=_known(row[_ORIENTATION]),
            joints=tuple(q for q in row[_JOINTS] if not math.isnan(q)) or None,
            gripper_width=None if math.isnan(row[_GRIPPER]) else row[_GRIPPER],
            force=self.force(index),
        )


def _known(part: Row) -> Any:
    """Return a part of a row; None if it is nan."""
    return None if math.isnan(part[0]) else part


def _read(log: AppendLog, index: int) -> Row:
    return _ROW.unpack(log.read(index * _ROW.size, (index + 1) * _ROW.size))


def _read_forces(log: AppendLog, indices: range) -> Array:
    """Return the forces (n, 3) [N] of the observations of a range."""
    if indices.step > 1:
        return np.array([_read(log, index)[_FORCE] for index in indices])
    rows = np.frombuffer(log.read(indices.start * _ROW.size, indices.stop * _ROW.size))
    return rows.reshape(-1, _COLUMNS)[:, _FORCE].copy()


def turned_upright(seen: ModelInput, upright: Array | None) -> ModelInput:
    """Return a model input, rotated so that the direction away from gravity is +z.

    upright: (3, 3) the rotation; None if the input is already upright.
    """
    if upright is None:
        return seen
    position, force, rotation, torsion = upright.dot(
        np.column_stack([seen.position, seen.force, seen.rotation, seen.torsion])
    ).T.copy()
    return ModelInput(position, force, seen.holding, rotation, torsion)


def upright_input(seen: ModelInput, acceleration: Array, upright: Array | None) -> ModelInput:
    """Return a model input as by `turned_upright`, without the inertia of what the fingers hold.

    acceleration: (3,) [m/s²] of the flange in the base frame.
    """
    turned = turned_upright(seen, upright)
    if seen.holding != 1.0:
        return turned
    lifted = acceleration if upright is None else upright.dot(acceleration)
    return turned._replace(force=without_load_inertia(turned.force, lifted))


def force_scale(observation: Observation) -> float:
    """Return the scale of the force in free space, relative to a tared sensor; models see force / scale."""
    return 1.0 if observation.bias_n is None else observation.bias_n / TARED_BIAS_N


def holding(observation: Observation) -> float:
    """Return 1 if the gripper holds something, 0 if it does not, nan if that is unknown."""
    if observation.gripper_closed is None:
        return np.nan
    empty = observation.gripper_width is not None and observation.gripper_width <= EMPTY_GRIPPER_M
    return float(observation.gripper_closed and not empty)


def observed_pose(observation: Observation, upright: Array | None) -> ObservedPose:
    """Return an observation in the form that coaching uses; upright: as in `ObservationStore`."""
    vectors = observation.position_base, observation.velocity_base, observation.force_base
    between = observation.between
    if upright is not None:
        vectors = upright.dot(vectors[0]), upright.dot(vectors[1]), upright.dot(vectors[2])
        between = None if between is None else np.hstack([between[:, :3] @ upright.T, between[:, 3:]])
    (x, y, z), (vx, vy, vz), (fx, fy, fz) = (vector.tolist() for vector in vectors)
    return ObservedPose(
        observation.t,
        (x, y, z),
        (vx, vy, vz),
        (fx, fy, fz),
        holding(observation),
        observation.joints,
        observation.after_gap,
        observation.measured_n,
        None if observation.orientation is None else observation.orientation.tolist(),
        None if observation.turning is None else observation.turning.tolist(),
        between,
    )

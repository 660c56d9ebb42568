"""The meaning of the columns of a sample matrix, and the validation of every push.

Only the columns that the conditioning uses are copied, in the order of `SIGNALS`, with positions converted to
metres. A push with an impossible sample is refused, with the sample's value and the expected one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from caesura_service.constants import JOINTS, JOINTS_MOST, UP
from caesura_service.signals.backend import REFERENCE, Backend
from caesura_service.signals.rotation import lengths
from caesura_service.signals.wrench_capabilities import (
    FORCE_FRAMES,
    WrenchCapabilities,
    assumed_source,
    wrench_capabilities,
)

Array = NDArray[np.float64]
PoseOfJoints = Callable[[Array], tuple[Array, Array]]
WrenchOfJointTorques = Callable[[Array, Array], Array]

#: Columns of each signal. `gripper` comes last: it is held between samples, all others are interpolated.
SIGNALS: Mapping[str, tuple[str, ...]] = {
    "pos": ("px", "py", "pz"),
    "quat": ("qx", "qy", "qz", "qw"),
    "q": tuple(f"q{i}" for i in range(1, JOINTS_MOST + 1)),
    "force": ("fx", "fy", "fz"),
    "torque": ("mx", "my", "mz"),
    "tau": tuple(f"tau{i}" for i in range(1, JOINTS_MOST + 1)),
    "gripper": ("gripper",),
}
_KNOWN = {column: signal for signal, columns in SIGNALS.items() for column in columns}

#: Column → how large its values may be, and what they are.
LIMITS: Mapping[str, tuple[float, str]] = {
    "t": (1e10, "a time [s]"),  # beyond it a double no longer separates samples at 1 kHz
    "gripper": (1.0, "an opening [m] or a closed flag"),  # metres stay below it, a flag reaches it
}
LARGEST = float(np.finfo(np.float64).max)
QUATERNION_NORM_TOLERANCE = 0.1  # a quaternion further from unit length is not a rounding error


@dataclass(frozen=True)
class SampleLayout:
    """The columns of a session's samples and how to read them.

    columns: names as in `SIGNALS`, after a leading `t` [s]. wrench_source: one of `WRENCH_SOURCES`; None: not
    stated. hand_on_robot: whether a person guides this robot: "yes", "no" or "unknown". force_frame: "base"
    or "flange". metres_per_unit: of the position columns (1, 0.01, 0.001). joints: number of the robot's
    joints. up: away from gravity, of length 1, base frame. pose_of_joints: q (n, joints) [rad] → flange
    positions (n, 3) [m] and quaternions (n, 4) x y z w. wrench_of_joint_torques: q, tau (n, joints) [Nm] →
    wrench on the flange (n, 6) [N, Nm]. Both return values in the base frame, for any number of rows; each
    row of the result may depend only on its own row. Raises ValueError for columns or options that cannot be
    segmented.
    """

    columns: tuple[str, ...]
    wrench_source: str | None = None
    force_frame: str = "base"
    metres_per_unit: float = 1.0
    pose_of_joints: PoseOfJoints | None = None
    wrench_of_joint_torques: WrenchOfJointTorques | None = None
    hand_on_robot: str = "unknown"
    joints: int = JOINTS
    up: tuple[float, float, float] = UP

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", tuple(self.columns))
        self._check_options()
        self._check_columns()
        self._check_position()
        self._check_wrench()

    def __deepcopy__(self, memo: object) -> Self:
        return self  # immutable, and its functions may hold a robot, which is not part of the state

    def has(self, signal: str) -> bool:
        """Return whether the signal's columns are among the session's."""
        return set(self._names(signal)) <= set(self.columns)

    @cached_property
    def source_in_use(self) -> str:
        """The stated wrench source, or the conservative one."""
        if self.wrench_source is None:
            return assumed_source(has_force=self.has("force"))
        return self.wrench_source

    @property
    def source(self) -> WrenchCapabilities:
        """The capabilities of the wrench. Raises ValueError for unknown or contradictory statements."""
        stated = self.wrench_source is not None
        return wrench_capabilities(self.source_in_use, self.hand_on_robot, stated=stated)

    @property
    def has_orientation(self) -> bool:
        """Whether the flange's orientation is measured or follows from the joints."""
        return self.has("quat") or (self.has("q") and self.pose_of_joints is not None)

    @property
    def needs_robot(self) -> bool:
        """Whether pose or wrench are computed from the joints."""
        if not self.has("q") or self.pose_of_joints is None:
            return False
        return not (self.has("pos") and self.has("quat")) or "tau" in self.slices

    @property
    def has_torque(self) -> bool:
        """Whether a torque of the environment is measured: beside a force that shows contact."""
        return self.has("torque") and self.has("force") and self.source.contact_models

    @cached_property
    def slices(self) -> dict[str, slice]:
        """The slice of each signal among the values, the columns after the time of `copy_columns`."""
        place, slices = 0, {}
        for signal in self._used():
            width = len(self._names(signal))
            slices[signal] = slice(place, place + width)
            place += width
        return slices

    @property
    def pose_width(self) -> int:
        """The number of first values that are the pose: position and quaternion, or joints."""
        signals = ("pos", "quat") if "pos" in self.slices else ("q",)
        return int(max(self.slices[signal].stop for signal in signals if signal in self.slices))

    @property
    def joints_beside_pose(self) -> int:
        """The number of values after the pose that are joints, read together with it."""
        return self.joints if "pos" in self.slices and "q" in self.slices else 0

    def read(self, samples: Array) -> tuple[Array, Array]:
        """Return times (n,) [s] and values (n, c) from the result of `copy_columns`."""
        taken = self.copy_columns(samples)
        return taken[:, 0], taken[:, 1:]

    def copy_columns(self, samples: Array, arithmetic: Backend = REFERENCE) -> Array:
        """Copy the columns in use: (n, 1 + c), time [s] first, then values, positions in metres.

        samples: (n, columns). Raises ValueError for a wrong shape or an impossible value.
        """
        samples = np.asarray(samples, dtype=np.float64)
        if samples.shape[1:] != (len(self.columns),):
            expected = f"(n, {len(self.columns)}) for {', '.join(self.columns)}"
            raise ValueError(f"samples have shape {samples.shape}, expected {expected}")
        if not samples.flags.carray:
            samples = samples.copy()
        taken = np.empty((len(samples), len(self._picked)))
        if not arithmetic.copy_columns(samples, *self._conditions, taken):
            self._refuse(samples)
        return taken

    @cached_property
    def _conditions(self) -> tuple[Array, int, float]:
        """Arguments of `Backend.copy_columns`: plan, first quaternion column or −1, tolerance of its norm.

        plan: (3, columns) limit, column in the copy (−1: not copied), and factor of each column.
        """
        plan = np.array([self._limits, np.full(len(self.columns), -1), np.ones(len(self.columns))])
        plan[1, self._picked] = np.arange(len(self._picked))
        if "pos" in self.slices:
            plan[2, self._picked[1:][self.slices["pos"]]] = self.metres_per_unit
        quaternion = 1 + self.slices["quat"].start if "quat" in self.slices else -1
        return plan, quaternion, QUATERNION_NORM_TOLERANCE

    @cached_property
    def _picked(self) -> NDArray[np.intp]:
        names = ["t", *(column for signal in self._used() for column in self._names(signal))]
        return np.array([self.columns.index(name) for name in names], dtype=np.intp)

    @property
    def _limits(self) -> Array:
        """(columns,) the limit of each column's absolute value; no infinity and no nan is below any limit."""
        return np.array([LIMITS[column][0] if column in LIMITS else LARGEST for column in self.columns])

    def _names(self, signal: str) -> tuple[str, ...]:
        """Return the columns of a signal; of joint signals those of the session's joints."""
        return SIGNALS[signal][: self.joints] if signal in {"q", "tau"} else SIGNALS[signal]

    def _used(self) -> tuple[str, ...]:
        unused = set() if self.has_torque else {"torque"}
        unused |= {"tau"} if self.has("force") else set()
        if self.source_in_use == "none":
            unused = {"torque", "force", "tau"}
        return tuple(signal for signal in SIGNALS if self.has(signal) and signal not in unused)

    def _refuse(self, samples: Array) -> NoReturn:
        """Raise ValueError for the first value that is not finite, else over its limit, else for an
        invalid quaternion.
        """
        finite = np.isfinite(samples)
        beyond = ~finite if not finite.all() else np.abs(samples) > self._limits
        if not beyond.any():
            _refuse_quaternions(samples[:, self._picked][:, 1:][:, self.slices["quat"]])
        row, place = np.argwhere(beyond)[0]
        column, value = self.columns[place], samples[row, place]
        expected = "a finite number"
        if np.isfinite(value):
            limit, meaning = LIMITS[column]
            expected = f"{meaning} within ±{limit:g}"
        raise ValueError(f"sample {row}: {column} is {value}, expected {expected}")

    def _check_options(self) -> None:
        _ = self.source  # raises where what is stated of the wrench is unknown or contradicts itself
        if self.force_frame not in FORCE_FRAMES:
            raise ValueError(
                f"force_frame is {self.force_frame!r}, expected one of {', '.join(FORCE_FRAMES)}"
            )
        if not (math.isfinite(self.metres_per_unit) and self.metres_per_unit > 0):
            raise ValueError(f"metres_per_unit is {self.metres_per_unit}, expected a length above 0 m")

    def _check_columns(self) -> None:
        if self.columns[:1] != ("t",):
            raise ValueError(f"first column is {self.columns[:1]}, expected t")
        for column in self.columns[1:]:
            if column not in _KNOWN:
                raise ValueError(f"unknown column {column!r}, known: {['t', *_KNOWN]}")
            if column not in self._names(_KNOWN[column]):
                raise ValueError(
                    f"column {column!r} is there, but its robot has {self.joints} joints in a row"
                )
            missing = set(self._names(_KNOWN[column])) - set(self.columns)
            if missing:
                raise ValueError(
                    f"column {column!r} is there but {', '.join(sorted(missing))} of the same signal is not"
                )
        repeated = sorted(name for name in set(self.columns) if self.columns.count(name) > 1)
        if repeated:
            raise ValueError(f"columns {repeated} stand more than once, expected each name once")

    def _check_position(self) -> None:
        if not self.has("pos") and not self.has("q"):
            expected = f"position {', '.join(SIGNALS['pos'])} or joints q1, q2, …"
            raise ValueError(f"columns are {', '.join(self.columns)}, expected {expected}")
        if not self.has("pos") and self.pose_of_joints is None:
            raise ValueError(
                f"columns have {self.joints} joints and no position, expected a robot to be stated (--robot, "
                "or robot in the recording): a pose is computed from joints of a known arm only"
            )

    def _check_wrench(self) -> None:
        source = self.source_in_use
        if source == "none":
            return
        if self.has("force"):
            if self.force_frame == "flange" and not self.has_orientation:
                raise ValueError(
                    f"force_frame is 'flange' without orientation, expected {' '.join(SIGNALS['quat'])}, or "
                    "joints q1, q2, … of a stated robot: send one, or turn the force into the base frame"
                )
        elif source != "joint_torque_estimate":
            raise ValueError(
                f"wrench_source is {source!r} without force, expected {', '.join(SIGNALS['force'])}"
            )
        elif not (self.has("tau") and self.has("q") and self.wrench_of_joint_torques):
            raise ValueError(
                f"wrench_source is {source!r} in columns {', '.join(self.columns)}, expected force "
                f"{', '.join(SIGNALS['force'])}, or tau1..tau7 with q1..q7 and wrench_of_joint_torques"
            )


def _refuse_quaternions(quaternions: Array) -> NoReturn:
    norms = lengths(quaternions)
    row = int((np.abs(norms - 1.0) > QUATERNION_NORM_TOLERANCE).argmax())
    limit = f"1 ± {QUATERNION_NORM_TOLERANCE:g}"
    likely = "is it a rotation vector, or angles?" if norms[row] else "samples without an orientation?"
    raise ValueError(f"sample {row}: quaternion has norm {norms[row]:g}, expected {limit}: {likely}")

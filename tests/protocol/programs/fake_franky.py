"""franky 2.0 without a robot: the calls of its API that a script makes, with their signatures, written down.

Signatures are those of `franky/_franky.pyi` of franky-control 2.0.0. What is called is kept in `calls`.
`test_franky_script` compares them with franky itself where that is installed.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

calls: list[tuple[str, dict[str, Any]]] = []
felt_n = [0.0]  # what the force sensor says along -z
torque_nm = [0.0]  # about z; while there is some, a motion does not end by itself


def _note(name: str, **arguments: Any) -> None:
    calls.append((name, arguments))


class Affine:
    def __init__(self, translation: Any = (0.0, 0.0, 0.0), quaternion: Any = (0.0, 0.0, 0.0, 1.0)) -> None:
        self.translation = np.array(translation, dtype=float).reshape(3)
        self.quaternion = np.array(quaternion, dtype=float).reshape(4)

    @property
    def inverse(self) -> Affine:
        x, y, z, w = self.quaternion.tolist()
        back = (-x, -y, -z, w)
        return Affine([-one for one in _turned(back, self.translation.tolist())], back)

    def __mul__(self, other: Affine) -> Affine:
        quaternion = self.quaternion.tolist()
        turned = _turned(quaternion, other.translation.tolist())
        return Affine(self.translation + turned, _product(quaternion, other.quaternion.tolist()))


# In floats: a script multiplies some fifty thousand, and arrays of one value take ten times as long.
def _product(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Quaternion (x, y, z, w) of `other` and then `one`, of length 1."""
    (a, b, c, d), (x, y, z, w) = one, other
    made = (
        d * x + a * w + b * z - c * y,
        d * y - a * z + b * w + c * x,
        d * z + a * y - b * x + c * w,
        d * w - a * x - b * y - c * z,
    )
    length = math.hypot(*made)
    return [value / length for value in made]


def _turned(quaternion: Sequence[float], vector: Sequence[float]) -> list[float]:
    """The vector (x, y, z) turned by a quaternion of any length."""
    x, y, z, w = quaternion
    twice = 2.0 / (x * x + y * y + z * z + w * w)
    (p, q, r) = vector
    i, j, k = y * r - z * q, z * p - x * r, x * q - y * p
    return [
        p + twice * (w * i + y * k - z * j),
        q + twice * (w * j + z * i - x * k),
        r + twice * (w * k + x * j - y * i),
    ]


class Exception(builtins.Exception):  # noqa: A001  (franky's own name)
    pass


class GripperException(builtins.Exception):
    pass


class ControlException(Exception):  # noqa: N818  (franky's own name)
    pass


class Condition:
    pass


class Measure:
    FORCE_X: Measure
    FORCE_Y: Measure
    FORCE_Z: Measure

    def __sub__(self, other: float) -> Measure:
        return self

    def __add__(self, other: Measure | float) -> Measure:
        return self

    def __pow__(self, other: float) -> Measure:
        return self

    def __gt__(self, other: float) -> Condition:
        return Condition()


Measure.FORCE_X = Measure.FORCE_Y = Measure.FORCE_Z = Measure()


class RelativeDynamicsFactor:
    def __init__(self, velocity: float, acceleration: float, jerk: float) -> None:
        for value in (velocity, acceleration, jerk):
            assert 0.0 < value <= 1.0


class _Motion:
    def __init__(self) -> None:
        self.reactions: list[Reaction] = []

    def add_reaction(self, reaction: Reaction) -> None:
        self.reactions.append(reaction)


class Reaction:
    def __init__(self, condition: Condition, motion: _Motion) -> None:
        assert isinstance(condition, Condition)
        self.motion = motion


class CartesianStopMotion(_Motion):
    pass


class TorqueStopMotion(_Motion):
    pass


class CartesianMotion(_Motion):
    def __init__(self, target: Affine, *, ee_frame: Affine | None = None) -> None:
        super().__init__()
        self.target, self.ee_frame = target, ee_frame


class Twist:
    def __init__(self, linear_velocity: Any = None, angular_velocity: Any = None) -> None:
        self.linear = np.array(linear_velocity, dtype=float).reshape(3)
        self.angular = np.zeros(3) if angular_velocity is None else np.array(angular_velocity, dtype=float)


class CartesianState:
    def __init__(self, pose: Affine, velocity: Twist) -> None:
        self.pose, self.velocity = pose, velocity


class Duration:
    def __init__(self, milliseconds: int) -> None:
        assert isinstance(milliseconds, int)
        self.milliseconds = milliseconds


class CartesianWaypoint:
    def __init__(self, target: CartesianState, *, minimum_time: Duration | None = None) -> None:
        self.target, self.minimum_time = target, minimum_time


class CartesianWaypointMotion(_Motion):
    def __init__(self, waypoints: list[CartesianWaypoint], ee_frame: Affine | None = None) -> None:
        super().__init__()
        self.waypoints, self.ee_frame = waypoints, ee_frame


class CartesianReference:
    def __init__(self, target: Affine) -> None:
        self.target = target


class CartesianImpedanceTrackingMotion(_Motion):
    def __init__(self, translational_stiffness: float = 500) -> None:
        super().__init__()
        self.stiffness = translational_stiffness
        self.references: list[CartesianReference] = []

    def set_reference(self, reference: CartesianReference) -> None:
        self.references.append(reference)


class DoubleDynamicsLimit:
    def __init__(self, name: str, most: float) -> None:
        self._name, self._most = name, most  # what a Panda can

    def set(self, value: float) -> None:
        assert 0.0 < value <= self._most
        _note(self._name, value=value)


class RobotState:
    F_T_EE = Affine(
        (0.0, 0.0, 0.1034), Rotation.from_euler("z", -45.0, degrees=True).as_quat()
    )  # a Franka Hand

    @property
    def O_F_ext_hat_K(self) -> Any:  # noqa: N802  (franky's own name)
        return np.array([0.0, 0.0, felt_n[0], 0.0, 0.0, torque_nm[0]])


class RobotPose:
    def __init__(self, flange: Affine) -> None:
        self.end_effector_pose = flange * RobotState.F_T_EE


class Robot:
    relative_dynamics_factor: Any = None

    def __init__(self, fci_hostname: str) -> None:
        _note("robot", host=fci_hostname)
        self.state = RobotState()
        self.translation_velocity_limit = DoubleDynamicsLimit("limit", 1.7)
        self.rotation_velocity_limit = DoubleDynamicsLimit("turn", 2.5)
        self.flange = Affine((0.3, 0.0, 0.4), (1.0, 0.0, 0.0, 0.0))

    @property
    def current_pose(self) -> RobotPose:
        return RobotPose(self.flange)

    def recover_from_errors(self) -> bool:
        return True

    def set_collision_behavior(self, torque_thresholds: float, force_thresholds: float) -> None:
        _note("collision", torque=torque_thresholds, force=force_thresholds)

    def set_load(self, load_mass: float, F_x_Cload: list[float], load_inertia: list[float]) -> None:  # noqa: N803
        assert len(F_x_Cload) == 3
        assert len(load_inertia) == 9
        _note("load", kg=load_mass, at=F_x_Cload)

    def move(self, motion: _Motion, asynchronous: bool = False) -> None:
        _note("move", motion=motion, asynchronous=asynchronous)
        for target in _targets(motion):
            self.flange = target
        felt_n[0] = 6.0 if motion.reactions else 0.0  # where it may meet something, it does

    def join_motion(self, timeout: float | None = None) -> bool:
        motion = calls[-1][1]["motion"]
        return torque_nm[0] == 0.0 and not isinstance(motion, CartesianImpedanceTrackingMotion)


def _targets(motion: _Motion) -> list[Affine]:
    """Where a motion leads the flange."""
    if isinstance(motion, CartesianMotion):
        return [motion.target]
    return (
        [one.target.pose for one in motion.waypoints] if isinstance(motion, CartesianWaypointMotion) else []
    )


class MovingRobot(Robot):
    """A robot over a surface: motions with a reaction end where it is met.

    surface_m: its height at x and y [m]; surface_n_per_m: its stiffness, by default it gives no way;
    friction: of a stroke along x, as a share of the force along z.
    An impedance leads the flange to its reference within every period.
    """

    surface_m: Callable[[float, float], float]
    surface_n_per_m = math.inf
    friction = 0.0

    def __init__(self, fci_hostname: str) -> None:
        super().__init__(fci_hostname)
        self.state = _FeltState(self)
        self.reference: Affine | None = None

    def move(self, motion: _Motion, asynchronous: bool = False) -> None:
        _note("move", motion=motion, asynchronous=asynchronous)
        self.reference = None
        if isinstance(motion, CartesianImpedanceTrackingMotion):
            self._tracked = motion
        for target in _targets(motion):
            begun, way = self.flange.translation, target.translation - self.flange.translation
            for share in np.linspace(0.0, 1.0, 1000):
                self.flange = Affine(begun + share * way, target.quaternion)
                if motion.reactions and self.felt_n() > 4.0:
                    return

    def join_motion(self, timeout: float | None = None) -> bool:
        self.reference = self._tracked.references[-1].target * RobotState.F_T_EE.inverse
        x, y, z = self.reference.translation
        gives = max(self.surface_m(x, y) - z, 0.0) / (1.0 + self._tracked.stiffness / self.surface_n_per_m)
        self.flange = Affine((x, y, z + gives), self.reference.quaternion)
        return False

    def felt_n(self) -> float:
        x, y, z = self.flange.translation
        if z > self.surface_m(x, y) + 1e-6:
            return 0.0
        return 8.0 if self.reference is None else 500.0 * float(z - self.reference.translation[2])


class _FeltState(RobotState):
    def __init__(self, robot: MovingRobot) -> None:
        self._robot = robot

    @property
    def O_F_ext_hat_K(self) -> Any:  # noqa: N802  (franky's own name)
        newtons = self._robot.felt_n()  # of the surface; libfranka states the robot's force on it
        return np.array([self._robot.friction * newtons, 0.0, -newtons, 0.0, 0.0, 0.0])


class Gripper:
    """A Franka Hand. A grasp has width - epsilon_inner < d < width + epsilon_outer, d between its fingers.

    So libfranka states it. part_m: the width of what lies between them; None: as wide as what is grasped.
    """

    max_width = 0.08
    is_grasped = False
    width = 0.08
    part_m: float | None = None

    def __init__(self, fci_hostname: str) -> None:
        _note("gripper", host=fci_hostname)

    def grasp(
        self,
        width: float,
        speed: float,
        force: float,
        epsilon_inner: float = 0.005,
        epsilon_outer: float = 0.005,
    ) -> bool:
        _note("grasp", width=width, force=force)
        self.width = width if self.part_m is None else self.part_m
        self.is_grasped = width - epsilon_inner < self.width < width + epsilon_outer
        return self.is_grasped

    def move(self, width: float, speed: float) -> bool:
        assert 0.0 <= width <= self.max_width
        _note("fingers", width=width)
        self.is_grasped, self.width = False, width
        return True

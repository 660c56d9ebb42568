"""A simulated Panda under Cartesian impedance, in the world of a scenario, tick by tick at 1 kHz.

The arm, its friction and what it touches are those of the simulated teacher (`guiding`, `contact`). In place
of a hand a controller moves it: stiffness and damping about a setpoint, the inertia at the flange fed forward
(Khatib 1987: Λ = (J M⁻¹ Jᵀ)⁻¹), most of the joints' friction made up for, and a force of its own. Along the
direction in which a force is controlled there is no stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from caesura_lab.execution.cell_simulation import CellSimulation
from caesura_lab.teacher.guided_arm import (
    FALL,
    SimulationTrace,
    at_flange,
    start_posture,
    tip_jacobian,
    tip_motion,
    velocity_change,
)
from caesura_lab.teacher.motion_profiles import Array
from caesura_lab.teacher.plan import DT, TICKS_PER_S
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M
from caesura_lab.teacher.shapes import contact_with
from caesura_protocol.paths import Curve
from caesura_protocol.rotations import cross, turning_of
from caesura_service.constants import GRAVITY
from caesura_service.robot import HandDynamics, Robot

STIFFNESS_N_PER_M, DAMPING_NS_PER_M = 3000.0, 240.0  # as libfranka's examples set a Panda's own controller
TURN_STIFFNESS_NM, TURN_DAMPING_NMS = 300.0, 14.0  # likewise
LEAST_MOBILITY = 5e-3  # [1/kg, 1/(kg m²)] bounds the inertia that is fed forward near a singularity
POSTURE_NM_PER_RAD, POSTURE_NMS_PER_RAD = 5.0, 2.0  # keep the elbow where it was
FRICTION_EASED, EASED_RAD_PER_S = 0.7, 0.02  # share of the joints' friction that the controller makes up for
LOOK_S, LEAST_SINGULAR = 0.02, 0.02  # between two looks at joint speeds; of the largest singular value
PRESS_DAMPING_NS_PER_M = 150.0  # along the direction of a controlled force
_LEAST_MOBILITY = LEAST_MOBILITY * np.eye(6)


@dataclass
class Setpoint:
    """What the controller is asked for; base frame.

    position, velocity, acceleration: (3,) of the flange; rotation: (3, 3); push: (3,) [N] of its own;
    along: (3,) the direction in which force is controlled instead of place, zeros for none; turning: (3,)
    [rad/s]; angular_acceleration: (3,) [rad/s²].
    """

    position: Array
    rotation: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    push: Array = field(default_factory=lambda: np.zeros(3))
    along: Array = field(default_factory=lambda: np.zeros(3))
    turning: Array = field(default_factory=lambda: np.zeros(3))
    angular_acceleration: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def still(self) -> Setpoint:
        """The same place, at rest."""
        return Setpoint(self.position, self.rotation, push=self.push, along=self.along)


@dataclass(frozen=True)
class ArmMeasurement:
    """The arm after a tick: position (3,) [m], rotation (3, 3) and twist (6,) of the flange, force (3,) [N]
    that it feels, without the load that is set; joints and their speeds (n,). torque: (3,) [Nm] that it
    feels about the flange, of the same force and of what resists its turning.
    """

    position: Array
    rotation: Array
    twist: Array
    force: Array
    q: Array
    v: Array
    torque: Array = field(default_factory=lambda: np.zeros(3))


class SimulatedArm:
    """Simulated arm in its cell. `tick` advances one millisecond; `trace` returns all ticks."""

    def __init__(self, robot: Robot, world: CellSimulation, *, friction: float = 1.0) -> None:
        self.world = world
        self._robot, self._contact = robot, contact_with(world.surfaces)
        self._friction_nm = friction * robot.friction_nm
        self._q, rotation = start_posture(robot, world.start)
        self._home = self._q
        self._v = np.zeros(robot.joints)
        self._rows: list[Array] = []
        self.load_kg = 0.0  # that is set in the controller
        self.measured = ArmMeasurement(
            np.array(world.start), rotation, np.zeros(6), np.zeros(3), self._q, self._v
        )
        self.lower, self.upper = robot.lower_limits, robot.upper_limits
        self.joint_speeds = robot.velocity_limits

    @property
    def t(self) -> float:
        """Return the simulated time [s]."""
        return DT * len(self._rows)

    def tick(self, setpoint: Setpoint) -> ArmMeasurement:
        """Simulate one tick under a setpoint; return the measurement."""
        arm = self._robot.hand_dynamics(self._q)
        twist = arm.jacobian @ self._v
        lever = FINGERS_BELOW_FLANGE_M * arm.rotation_base[:, 2]
        held_kg = self.world.held_kg
        spin = float(twist[3:] @ arm.rotation_base[:, 2])
        tip = tip_motion(arm.position_base, twist, lever)
        contact, torque_nm, _ = self._contact(*tip, spin, DT, GRAVITY * held_kg)
        turning = torque_nm * arm.rotation_base[:, 2]
        wrench = self._wrench(setpoint, arm, twist, lever)
        outside = contact + held_kg * FALL
        posture = POSTURE_NM_PER_RAD * (self._home - self._q) - POSTURE_NMS_PER_RAD * self._v
        eased = FRICTION_EASED * self._friction_nm * self._v / (np.abs(self._v) + EASED_RAD_PER_S)
        task = arm.jacobian.T @ np.linalg.solve(arm.jacobian @ arm.jacobian.T, arm.jacobian @ posture)
        given = wrench + at_flange(outside, lever)
        given[3:] += turning
        change = velocity_change(
            arm, self._v, given, self._friction_nm, held_kg, lever, posture - task + eased
        )
        if held_kg > 0.0:
            outside = outside - held_kg / DT * (tip_jacobian(arm.jacobian, lever) @ change)
        environment = at_flange(outside, lever)
        environment[3:] += turning
        row = np.concatenate([self._q, self._v, twist, environment, wrench, contact])
        self._rows.append(np.append(row, (self.world.width_m, held_kg)))
        self._v = self._v + change
        self._q = self._q + DT * self._v
        pressed = outside + np.array([0.0, 0.0, GRAVITY * self.load_kg])
        torque = turning + cross(lever, pressed)
        self.measured = ArmMeasurement(
            arm.position_base, arm.rotation_base, twist, pressed, self._q, self._v, torque
        )
        self.world.tick(arm.position_base, DT)
        return self.measured

    def joint_speed_share(self, path: Curve) -> float:
        """Return the largest share of a joint's speed limit that a path from here needs (q̇ = J⁺ twist)."""
        q, most = self._q, 0.0
        for t in np.arange(0.0, float(path.t[-1]), LOOK_S):
            value, velocity, _ = path.at(t)
            twist = np.zeros(6)
            twist[:3] = velocity[:3]
            if len(value) == 7:
                twist[3:] = turning_of(value[3:], velocity[3:], np.zeros(4))[0]
            v = np.linalg.pinv(self._robot.hand_dynamics(q).jacobian, rcond=LEAST_SINGULAR) @ twist
            most = max(most, float((np.abs(v) / self.joint_speeds).max()))
            q = q + LOOK_S * v
        return most

    def trace(self) -> SimulationTrace:
        """Return the trace of all ticks; the controller's wrench is in place of a hand's."""
        rows = np.array(self._rows)
        joints = self._robot.joints
        q, v, rows = np.split(rows, [joints, 2 * joints], axis=1)
        twist, environment, hand, contact, rest = np.split(rows, [6, 12, 18, 21], axis=1)
        t = np.arange(len(rows)) / TICKS_PER_S
        return SimulationTrace(t, q, v, twist, environment, hand, contact, rest[:, 0], rest[:, 1])

    def _wrench(self, want: Setpoint, arm: HandDynamics, twist: Array, lever: Array) -> Array:
        """Return the controller's wrench on the flange (6,) [N, Nm]."""
        ahead = self._inertia(arm, lever) @ np.concatenate([want.acceleration, want.angular_acceleration])
        force = STIFFNESS_N_PER_M * (want.position - arm.position_base)
        force += DAMPING_NS_PER_M * (want.velocity - twist[:3]) + ahead[:3]
        if want.along.any():
            force -= want.along * (want.along @ force + PRESS_DAMPING_NS_PER_M * (want.along @ twist[:3]))
        force += want.push
        force[2] += GRAVITY * self.load_kg
        turn = want.rotation @ arm.rotation_base.T
        error = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        torque = TURN_STIFFNESS_NM * error + TURN_DAMPING_NMS * (want.turning - twist[3:]) + ahead[3:]
        return np.concatenate([force, torque])

    def _inertia(self, arm: HandDynamics, lever: Array) -> Array:
        """Inertia (6, 6) of the arm at its flange, with the load that is set."""
        mass = arm.mass_matrix
        if self.load_kg > 0.0:
            at_tip = tip_jacobian(arm.jacobian, lever)
            mass = mass + self.load_kg * at_tip.T @ at_tip
        jacobian = arm.jacobian
        mobility = jacobian @ np.linalg.solve(mass, jacobian.T)
        return np.asarray(np.linalg.inv(mobility + _LEAST_MOBILITY))

"""A simulated arm under Cartesian impedance, in the world of a scenario, tick by tick at 1 kHz.

The arm, its friction and the surfaces are those of the simulated teacher (`guided_arm`,
`level_surface_contact`). Instead of a hand a controller moves it: stiffness and damping about a setpoint, and
an additional force. It feeds forward the inertia at the flange (Khatib 1987: Λ (a − J̇ v) with Λ = (J M⁻¹
Jᵀ)⁻¹), and compensates most of the joints' friction and damping. Along the direction in which a force is
controlled there is no stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from caesura_lab.execution.cell_simulation import CellSimulation
from caesura_lab.execution.joint_speeds import JointSpeed, fastest_joint
from caesura_lab.teacher.guided_arm import (
    JOINT_DAMPING,
    SimulationTrace,
    at_flange,
    lever_along,
    loaded_mass,
    start_posture,
    tip_jacobian,
    tip_motion,
    turn_error,
    turned,
    velocity_change,
    with_inertia,
    with_weight,
)
from caesura_lab.teacher.hand_motion_plan import DT, TICKS_PER_S
from caesura_lab.teacher.motion_profiles import Array, Vector
from caesura_lab.teacher.shaped_surface_contact import contact_with
from caesura_lab.teacher.small_matrices import eigh, solve
from caesura_protocol.reproduced_path import Curve
from caesura_service.constants import GRAVITY
from caesura_service.robot import HandDynamics, Robot

STIFFNESS_N_PER_M, DAMPING_NS_PER_M = 3000.0, 240.0  # as libfranka's examples set a Panda's own controller
TURN_STIFFNESS_NM, TURN_DAMPING_NMS = 300.0, 14.0  # likewise
LEAST_MOBILITY = 5e-3  # [1/kg, 1/(kg m²)] bounds the inertia that is fed forward near a singularity
POSTURE_NM_PER_RAD, POSTURE_NMS_PER_RAD = 5.0, 2.0  # keep the elbow where it was
FRICTION_EASED, EASED_RAD_PER_S = 0.85, 0.02  # share of the joints' friction that the controller makes up for
EASED_DAMPING = FRICTION_EASED * JOINT_DAMPING  # [Nms/rad], the same share of what grows with speed
OFF_SETPOINT_M = 0.002  # by which an arm is off it at most, at 0.5 m/s
PRESS_DAMPING_NS_PER_M = 150.0  # along the direction of a controlled force
_NOTHING = np.zeros(3)
_NOTHING.setflags(write=False)


def _nothing() -> Array:
    """Return zeros (3,) that all setpoints share, because one is made at every tick."""
    return _NOTHING


@dataclass
class Setpoint:
    """The command to the controller at one tick; base frame.

    position, velocity, acceleration: (3,) of the flange; rotation: (3, 3); push: (3,) [N] of its own;
    along: (3,) the direction in which force is controlled instead of place, zeros for none; turning: (3,)
    [rad/s]; angular_acceleration: (3,) [rad/s²].
    """

    position: Array
    rotation: Array
    velocity: Array = field(default_factory=_nothing)
    acceleration: Array = field(default_factory=_nothing)
    push: Array = field(default_factory=_nothing)
    along: Array = field(default_factory=_nothing)
    turning: Array = field(default_factory=_nothing)
    angular_acceleration: Array = field(default_factory=_nothing)

    @property
    def still(self) -> Setpoint:
        """Return the setpoint with the same position and force, at rest."""
        return Setpoint(self.position, self.rotation, push=self.push, along=self.along)


class ArmMeasurement(NamedTuple):
    """The measured state of the arm after a tick.

    Position (3,) [m], rotation (3, 3) and twist (6,) of the flange; force (3,) [N] without the stated load;
    joints and their speeds (n,); torque (3,) [Nm] about the flange, of the same force and of the resistance
    to turning.
    """

    position: Array
    rotation: Array
    twist: Array
    force: Array
    q: Array
    v: Array
    torque: Array


class SimulatedArm:
    """Simulated arm in its cell. `tick` advances one millisecond; `trace` returns all ticks."""

    def __init__(self, robot: Robot, world: CellSimulation, *, friction: float = 1.0) -> None:
        self.world = world
        self._robot, self._contact = robot, contact_with(world.surfaces)
        self._friction_nm = friction * robot.friction_nm
        self._q, rotation = start_posture(robot, world.start)
        self._home = self._q
        self._v = np.zeros(robot.joints)
        self._eased_nm = FRICTION_EASED * self._friction_nm
        self._rows: list[list[float]] = []
        self.load_kg = 0.0  # that is set in the controller
        self.measured = ArmMeasurement(
            np.array(world.start), rotation, np.zeros(6), _NOTHING, self._q, self._v, _NOTHING
        )
        self.lower, self.upper = robot.lower_limits, robot.upper_limits
        self.joint_speeds = robot.velocity_limits

    @property
    def t(self) -> float:
        """Return the simulated time [s]."""
        return DT * len(self._rows)

    def tick(self, setpoint: Setpoint) -> ArmMeasurement:
        """Simulate one tick under a setpoint; return the measurement."""
        q, v, held_kg = self._q, self._v, self.world.held_kg
        arm = self._robot.hand_dynamics(q)
        jacobian = arm.jacobian
        flange_twist = jacobian.dot(v)
        twist = flange_twist.tolist()
        axis = arm.rotation_base[:, 2]
        lever = lever_along(axis)
        spin = float(flange_twist[3:].dot(axis))
        tip, tip_velocity = tip_motion(arm.position_base, twist, lever)
        contact, torque_nm, _ = self._contact(tip, tip_velocity, spin, DT, GRAVITY * held_kg)
        turning = (torque_nm * axis).tolist()
        wrench = self._wrench(setpoint, arm, twist, lever)
        outside = with_weight(contact, held_kg)
        posture = POSTURE_NM_PER_RAD * (self._home - q) - POSTURE_NMS_PER_RAD * v
        eased = self._eased_nm * v / (np.abs(v) + EASED_RAD_PER_S) + EASED_DAMPING * v
        task = solve(jacobian.dot(jacobian.T), jacobian.dot(posture)).dot(jacobian)
        given = [own + other for own, other in zip(wrench, at_flange(outside, lever), strict=True)]
        flange_wrench: Array = np.array(turned(given, turning))
        at_tip = tip_jacobian(jacobian, lever) if held_kg > 0.0 else None
        change = velocity_change(
            arm, v, flange_wrench, self._friction_nm, held_kg, at_tip, posture - task + eased
        )
        if at_tip is not None:
            outside = with_inertia(outside, held_kg, at_tip, change)
        environment = turned(at_flange(outside, lever), turning)
        self._rows.append(
            [*q.tolist(), *v.tolist(), *twist, *environment, *wrench, *contact, self.world.width_m, held_kg]
        )
        self._v = v + change
        self._q = q + DT * self._v
        felt = turned(at_flange(with_weight(outside, -self.load_kg), lever), turning)
        self.measured = ArmMeasurement(
            arm.position_base,
            arm.rotation_base,
            flange_twist,
            np.array(felt[:3]),
            self._q,
            self._v,
            np.array(felt[3:]),
        )
        self.world.tick(arm.position_base, DT)
        return self.measured

    def fastest_joint(self, path: Curve) -> JointSpeed:
        """Return the joint with the largest share of its speed limit on a path from the current pose."""
        return fastest_joint(self._robot, path, self._q)

    def mass_along(self, direction: Array) -> float:
        """Return the arm's effective mass [kg] at the flange along a direction (3,), at its current pose."""
        arm = self._robot.hand_dynamics(self._q)
        joints = arm.jacobian[:3].T @ direction
        return float(1.0 / (joints @ solve(arm.mass_matrix, joints)))

    def trace(self) -> SimulationTrace:
        """Return the trace of all ticks; the controller's wrench is in place of a hand's."""
        rows = np.array(self._rows)
        joints = self._robot.joints
        q, v, rows = np.split(rows, [joints, 2 * joints], axis=1)
        twist, environment, hand, contact, rest = np.split(rows, [6, 12, 18, 21], axis=1)
        t = np.arange(len(rows)) / TICKS_PER_S
        return SimulationTrace(t, q, v, twist, environment, hand, contact, rest[:, 0], rest[:, 1])

    def _wrench(self, want: Setpoint, arm: HandDynamics, twist: list[float], lever: Vector) -> list[float]:
        """Return the controller's wrench on the flange (6,) [N, Nm]."""
        ahead = self._feed_forward(want, arm, lever)
        force = np.array(
            [
                STIFFNESS_N_PER_M * (meant - place) + DAMPING_NS_PER_M * (speed - rate)
                for meant, place, speed, rate in zip(
                    want.position.tolist(),
                    arm.position_base.tolist(),
                    want.velocity.tolist(),
                    twist[:3],
                    strict=True,
                )
            ]
        )
        if any(want.along.tolist()):
            speed = want.along.dot(np.array(twist[:3]))
            force -= want.along * (want.along.dot(force) + PRESS_DAMPING_NS_PER_M * speed)
        fx, fy, fz = (force + want.push + ahead[:3]).tolist()
        torque = [
            TURN_STIFFNESS_NM * error + TURN_DAMPING_NMS * (speed - rate) + added
            for error, speed, rate, added in zip(
                turn_error(want.rotation, arm.rotation_base),
                want.turning.tolist(),
                twist[3:],
                ahead[3:],
                strict=True,
            )
        ]
        return [fx, fy, fz + GRAVITY * self.load_kg, *torque]

    def _feed_forward(self, want: Setpoint, arm: HandDynamics, lever: Vector) -> list[float]:
        """Return the wrench (6,) for a setpoint's acceleration of the arm with the stated load.

        Constant joint velocities accelerate the flange by J̇ v; forces must cause the rest. Along the
        direction of a controlled force the setpoint's acceleration is zero.
        """
        if not (any(want.velocity.tolist()) or any(want.turning.tolist())):
            return [0.0] * 6
        at_tip = tip_jacobian(arm.jacobian, lever) if self.load_kg > 0.0 else None
        mass = loaded_mass(arm, self.load_kg, at_tip)
        mobilities, axes = eigh(arm.jacobian.dot(solve(mass, arm.jacobian.T)))
        across = want.acceleration - want.along * want.along.dot(want.acceleration)
        asked = np.concatenate([across, want.angular_acceleration])
        asked -= self._robot.velocity_product_acceleration(self._q, self._v)
        ahead: list[float] = axes.dot(asked.dot(axes) / np.maximum(mobilities, LEAST_MOBILITY)).tolist()
        return ahead

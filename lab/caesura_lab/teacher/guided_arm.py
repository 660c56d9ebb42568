"""The arm in the hand: forward dynamics of a guided robot at 1 kHz.

Gravity and Coriolis torques are compensated by the robot, so what is left of the joint dynamics is mass,
damping and friction under the wrenches at the flange (thesis 2.2 and 3.1):

    M(q) dv/dt = Jᵀ (w_hand + w_environment − D_x v_flange) − D_q v − τ_friction

The hand is the outer loop, K_x (x_d − x) with a damper; the thesis' (3.6) prints the other sign. Joint
damping and friction enter the step implicitly: friction at standstill is far too stiff for an explicit step
of 1 ms, and it is what lets a guided Panda rest within micrometres while a hand trembles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from caesura_lab.teacher.hand_force import HandForceController
from caesura_lab.teacher.hand_motion_plan import DT, TICKS_PER_S, Plan
from caesura_lab.teacher.motion_profiles import Array, Vector
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M
from caesura_lab.teacher.shaped_surface_contact import contact_with
from caesura_lab.teacher.small_matrices import solve
from caesura_service.constants import GRAVITY
from caesura_service.robot import HandDynamics, Robot

DAMPING = np.array([20.0, 20.0, 20.0, 1.5, 1.5, 1.5])  # [Ns/m, Nms/rad] of the guiding controller, D_x
JOINT_DAMPING = 0.8  # [Nms/rad], damps the null space too
STRIBECK_RAD_PER_S = 0.01  # joint speed over which stiction falls to sliding friction
STICK_RAD_PER_S = 2e-4  # below it friction acts like a very stiff damper
HAND_TURN_STIFFNESS = 25.0  # [Nm/rad]
HAND_TURN_DAMPING = 3.0  # [Nms/rad]
FIRM_TURN_STIFFNESS, FIRM_TURN_DAMPING = 60.0, 5.0  # of a hand that means to turn the tool
WEIGHT_FELT_S = 0.15  # in which a hand takes a load over
TORQUE_FELT_S = 0.15  # in which it takes over a torque that resists its turning
PRESS_FELT_S = 0.3  # in which it corrects a force that it feels to be wrong
PRESS_CORRECTION_N = 8.0
LEAST_PRESS_N = 0.5
YAW_DIGITS = 6  # of a first posture, which is stated with as many


@dataclass(frozen=True)
class SimulationTrace:
    """The trace of a simulation, tick by tick; base frame.

    t (n,) [s]; q (n, joints) [rad]; v (n, joints) [rad/s]; twist (n, 6) of the flange [m/s, rad/s];
    environment (n, 6) and hand (n, 6), wrenches on the flange [N, Nm]; contact (n, 3) [N] at the fingertips;
    width (n,) [m]; load_kg (n,) held by the fingers; tip_velocity (n, 3) [m/s] of the fingertips; normal (n,)
    [N] force of a surface. The last two are empty if the executor runs a program.
    """

    t: Array
    q: Array
    v: Array
    twist: Array
    environment: Array
    hand: Array
    contact: Array
    width: Array
    load_kg: Array
    tip_velocity: Array = field(default_factory=lambda: np.zeros((0, 3)))
    normal: Array = field(default_factory=lambda: np.zeros(0))


class GuidedArmSimulation:
    """Simulation of one demonstration; `run` simulates a number of ticks."""

    def __init__(self, robot: Robot, plan: Plan) -> None:
        self._robot, self._plan = robot, plan
        self._contact = contact_with(plan.scenario.surfaces)
        rate_per_s = plan.person.force_rate_per_s
        self._hand_force = None if rate_per_s is None else HandForceController(plan.aims, rate_per_s, DT)
        self._friction_nm = plan.person.joint_friction * robot.friction_nm
        self._damping = (plan.person.guiding_damping * DAMPING).tolist()
        self._stiction = plan.person.stiction
        start = plan.scenario.start
        self._q, self._orientation = start_posture(robot, start)
        self._v = np.zeros(robot.joints)
        self._weight_n = 0.0
        self._press_n = 0.0
        self._torque_nm = 0.0  # that the hand adds about the tool's axis
        self._tick = 0

    @property
    def done(self) -> bool:
        """Whether the demonstration is over."""
        return self._tick >= self._plan.ticks

    def run(self, ticks: int) -> SimulationTrace:
        """Simulate the next ticks, or the remaining ones."""
        first, last = self._tick, min(self._tick + ticks, self._plan.ticks)
        rows = np.empty((last - first, 2 * self._robot.joints + 25))
        for row, tick in zip(rows, range(first, last), strict=True):
            self._step(tick, row)
        self._tick = last
        joints = self._robot.joints
        q, v, rest = np.split(rows, [joints, 2 * joints], axis=1)
        twist, environment, hand, contact, tip_velocity, normal = np.split(rest, [6, 12, 18, 21, 24], axis=1)
        t = np.arange(first, last) / TICKS_PER_S
        width, load_kg = self._plan.width[first:last], self._plan.load_kg[first:last]
        return SimulationTrace(
            t, q, v, twist, environment, hand, contact, width, load_kg, tip_velocity, normal[:, 0]
        )

    def _step(self, tick: int, row: Array) -> None:
        """Write the state and its wrenches into the row, then advance one tick."""
        arm = self._robot.hand_dynamics(self._q)
        flange_twist = arm.jacobian.dot(self._v)
        twist = flange_twist.tolist()
        axis = arm.rotation_base[:, 2]
        lever = lever_along(axis)
        hand = self._hand_wrench(tick, arm, twist)
        load_kg = float(self._plan.load_kg[tick])
        tip, tip_velocity = tip_motion(arm.position_base, twist, lever)
        spin = float(flange_twist[3:].dot(axis))
        contact, torque_nm, normal_n = self._contact(tip, tip_velocity, spin, DT, GRAVITY * load_kg)
        self._adapt_hand(tick, load_kg, normal_n, torque_nm)
        outside = with_weight(contact, load_kg)
        environment = at_flange(outside, lever)
        wrenches = zip(hand, environment, self._damping, twist, strict=True)
        flange_wrench = np.array([h + e - damping * rate for h, e, damping, rate in wrenches])
        if torque_nm:
            flange_wrench[3:] += torque_nm * axis
        friction_nm = self._friction_nm
        if self._stiction != 1.0:
            friction_nm = joint_friction(self._v, friction_nm, self._stiction)
        at_tip = tip_jacobian(arm.jacobian, lever) if load_kg > 0.0 else None
        change = velocity_change(arm, self._v, flange_wrench, friction_nm, load_kg, at_tip)
        if at_tip is not None:
            environment = at_flange(with_inertia(outside, load_kg, at_tip, change), lever)
        if torque_nm:
            environment = turned(environment, (torque_nm * axis).tolist())
        state = *self._q.tolist(), *self._v.tolist(), *twist
        row[:] = *state, *environment, *hand, *contact, *tip_velocity, normal_n
        self._v = self._v + change
        self._q = self._q + DT * self._v

    def _hand_wrench(self, tick: int, arm: HandDynamics, twist: list[float]) -> list[float]:
        """Return the hand's wrench on the flange (6,): stiffness about its set place, and added forces."""
        plan, person, hand_force = self._plan, self._plan.person, self._hand_force
        share = hand_force.position_share if hand_force else 1.0
        stiffness, damping = person.stiffness_n_per_m, person.damping_ns_per_m
        fx, fy, fz = [
            stiffness * (share * (meant - place)) + (damping * (share * (speed - rate)) + added)
            for meant, place, speed, rate, added in zip(
                plan.position[tick].tolist(),
                arm.position_base.tolist(),
                plan.velocity[tick].tolist(),
                twist[:3],
                plan.force[tick].tolist(),
                strict=True,
            )
        ]
        rotation, rates = self._orientation, twist[3:]
        stiffness, damping = HAND_TURN_STIFFNESS, HAND_TURN_DAMPING
        if plan.turns is None:
            fz += self._weight_n - self._press_n
        else:
            toward = plan.turns.rotation[tick]
            rotation = toward.dot(rotation)
            rates = [rate - meant for rate, meant in zip(rates, plan.turns.rate[tick].tolist(), strict=True)]
            stiffness, damping = FIRM_TURN_STIFFNESS, FIRM_TURN_DAMPING
            px, py, pz = (self._press_n * toward[:, 2]).tolist()
            fx, fy, fz = fx - px, fy - py, fz + self._weight_n - pz
        if hand_force:
            ax, ay, az = hand_force.force_at(tick)
            lx, ly, lz = plan.feed_forward[tick].tolist()
            left = 1.0 - share
            fx, fy, fz = fx + (ax - left * lx), fy + (ay - left * ly), fz + (az - left * lz)
        errors = turn_error(rotation, arm.rotation_base)
        moments = [
            stiffness * error - damping * rate + added
            for error, rate, added in zip(errors, rates, plan.torque[tick].tolist(), strict=True)
        ]
        if self._torque_nm:
            axis = arm.rotation_base[:, 2].tolist()
            moments = [moment + self._torque_nm * part for moment, part in zip(moments, axis, strict=True)]
        return [fx, fy, fz, *moments]

    def _adapt_hand(self, tick: int, load_kg: float, normal_n: float, torque_nm: float) -> None:
        """Adapt the hand to the load, the normal force and the torque of this tick.

        A hand keeps its effort constant, so a load that it has gripped rests on the surface, not on the hand.
        """
        self._torque_nm -= DT / TORQUE_FELT_S * (torque_nm + self._torque_nm)
        weight = GRAVITY * load_kg if normal_n == 0.0 else 0.0
        self._weight_n += DT / WEIGHT_FELT_S * (weight - self._weight_n)
        if self._hand_force:
            self._hand_force.update(tick, normal_n)
        intended_n, effort_n = float(self._plan.press[tick]), normal_n - GRAVITY * load_kg
        error_n = intended_n - effort_n if normal_n > 0.0 and intended_n > LEAST_PRESS_N else -self._press_n
        corrected = self._press_n + DT / PRESS_FELT_S * error_n
        self._press_n = min(max(corrected, -PRESS_CORRECTION_N), PRESS_CORRECTION_N)


def joint_friction(v: Array, sliding_nm: Array, stiction: float) -> Array:
    """Return the Coulomb friction (n,) [Nm] at joint velocities v (n,): higher near standstill (Stribeck)."""
    slow = np.exp(-np.abs(v) / STRIBECK_RAD_PER_S)
    return np.asarray(sliding_nm * (1.0 + (stiction - 1.0) * slow))


def start_posture(robot: Robot, position: tuple[float, float, float]) -> tuple[Array, Array]:
    """Joint positions (n,) with the flange at a position, and its rotation (3, 3): fingers down.

    About the vertical the flange is turned as in the robot's first posture. Raises ReachError where the arm
    does not get there.
    """
    turn = float(np.arctan2(position[1], position[0]))
    home = robot.postures[0].copy()
    at_home = robot.hand_dynamics(home).rotation_base
    yaw = turn + round(float(np.arctan2(at_home[1, 0], at_home[0, 0])), YAW_DIGITS)
    home[0] += turn
    down = np.array([np.cos(yaw / 2), np.sin(yaw / 2), 0.0, 0.0])
    q = robot.inverse_kinematics(position, down, home)
    return q, robot.hand_dynamics(q).rotation_base


def velocity_change(
    arm: HandDynamics,
    v: Array,
    flange_wrench: Array,
    friction_nm: Array,
    load_kg: float,
    at_tip: Array | None,
    torques: Array | None = None,
) -> Array:
    """Return the change of the joint velocity v (n,) [rad/s] in one tick.

    flange_wrench: (6,) [N, Nm]; torques: (n,) [Nm] on the joints; friction_nm: (n,) Coulomb friction of the
    joints; at_tip: (3, n) Jacobian of the point at which a load adds its mass, None without a load.
    """
    resistance: Array = friction_nm / (np.abs(v) + STICK_RAD_PER_S) + JOINT_DAMPING
    driving = flange_wrench.dot(arm.jacobian)
    if torques is not None:
        driving += torques
    damped = loaded_mass(arm, load_kg, at_tip)
    damped.ravel()[:: len(v) + 1] += DT * resistance  # its diagonal, in a third of the time of np.diag
    return solve(damped, DT * (driving - resistance * v))


def loaded_mass(arm: HandDynamics, load_kg: float, at_tip: Array | None) -> Array:
    """Mass matrix (n, n) with a load, if any, at the end of the Jacobian at_tip (3, n); a new array."""
    if at_tip is None:
        return arm.mass_matrix.copy()
    return np.asarray(arm.mass_matrix + (load_kg * at_tip.T).dot(at_tip))


def lever_along(axis: Array) -> Vector:
    """Return the lever [m] from the flange to the fingertips, along the tool's axis (3,)."""
    x, y, z = axis.tolist()
    return FINGERS_BELOW_FLANGE_M * x, FINGERS_BELOW_FLANGE_M * y, FINGERS_BELOW_FLANGE_M * z


def tip_motion(position: Array, twist: Sequence[float], lever: Vector) -> tuple[Vector, Vector]:
    """Return position and velocity of the fingertips, as plain numbers, which is faster than arrays."""
    x, y, z = position.tolist()
    vx, vy, vz, wx, wy, wz = twist
    lx, ly, lz = lever
    velocity = (vx + wy * lz - wz * ly, vy + wz * lx - wx * lz, vz + wx * ly - wy * lx)
    return (x + lx, y + ly, z + lz), velocity


def with_weight(force: Vector, kg: float) -> Vector:
    """Return a force [N] plus the weight of a mass."""
    x, y, z = force
    return x, y, z - kg * GRAVITY


def with_inertia(force: Vector, kg: float, jacobian: Array, change: Array) -> Vector:
    """Return a force [N] less the inertial force of a mass.

    jacobian: (3, n) of the mass; change: of the joint velocity in a tick.
    """
    fx, fy, fz = force
    dx, dy, dz = jacobian.dot(change).tolist()
    rate = kg / DT
    return fx - rate * dx, fy - rate * dy, fz - rate * dz


def at_flange(force: Vector, lever: Vector) -> tuple[float, ...]:
    """Return the wrench (6,) at the flange of a force (3,) at the end of a lever (3,)."""
    fx, fy, fz = force
    lx, ly, lz = lever
    return fx, fy, fz, ly * fz - lz * fy, lz * fx - lx * fz, lx * fy - ly * fx


def turned(wrench: Sequence[float], turning: Sequence[float]) -> tuple[float, ...]:
    """Return a wrench (6,) plus a moment (3,) [Nm]."""
    fx, fy, fz, mx, my, mz = wrench
    tx, ty, tz = turning
    return fx, fy, fz, mx + tx, my + ty, mz + tz


def turn_error(meant: Array, rotation: Array) -> Vector:
    """Return the rotation vector [rad] from one rotation (3, 3) to another, for small angles."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = meant.dot(rotation.T).tolist()
    return 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)


def tip_jacobian(jacobian: Array, lever: Vector) -> Array:
    """Return the velocity of the fingertips per joint velocity, (3, n)."""
    x, y, z = lever
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    at_tip: Array = jacobian[:3] - cross.dot(jacobian[3:])
    return at_tip

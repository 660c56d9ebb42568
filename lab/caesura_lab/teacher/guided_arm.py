"""The arm in the hand: forward dynamics of a guided robot at 1 kHz.

Gravity and Coriolis torques are compensated by the robot, so what is left of the joint dynamics is mass,
damping and friction under the wrenches at the flange (thesis 2.2 and 3.1):

    M(q) dv/dt = Jᵀ (w_hand + w_environment − D_x v_flange) − D_q v − τ_friction

The hand is the outer loop, K_x (x_d − x) with a damper; the thesis' (3.6) prints the other sign. Joint
damping and friction enter the step implicitly: friction at standstill is far too stiff for an explicit step
of 1 ms, and it is what lets a guided Panda rest within micrometres while a hand trembles.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from caesura_lab.teacher.hand_force import HandForceController
from caesura_lab.teacher.motion_profiles import Array, Vector
from caesura_lab.teacher.plan import DT, TICKS_PER_S, Plan
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M
from caesura_lab.teacher.shapes import contact_with
from caesura_service.constants import GRAVITY
from caesura_service.robot import HandDynamics, Robot

FALL = np.array([0.0, 0.0, -GRAVITY])
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
    """What happened, tick by tick; base frame.

    t (n,) [s]; q (n, joints) [rad]; v (n, joints) [rad/s]; twist (n, 6) of the flange [m/s, rad/s];
    environment (n, 6) and hand (n, 6), wrenches on the flange [N, Nm]; contact (n, 3) [N] at the fingertips;
    width (n,) [m]; load_kg (n,) held by the fingers; tip_velocity (n, 3) [m/s] of the fingertips; normal
    (n,) [N] with which a surface pushes. The last two are empty where the executor runs a program.
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
    """Simulation of one demonstration; `run` advances it by some ticks."""

    def __init__(self, robot: Robot, plan: Plan) -> None:
        self._robot, self._plan = robot, plan
        self._contact = contact_with(plan.scenario.surfaces)
        rate_per_s = plan.person.force_rate_per_s
        self._hand_force = None if rate_per_s is None else HandForceController(plan.aims, rate_per_s, DT)
        self._friction_nm = plan.person.joint_friction * robot.friction_nm
        self._damping = plan.person.guiding_damping * DAMPING
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
        """Simulate the next ticks, or what is left."""
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
        twist = arm.jacobian @ self._v
        lever = FINGERS_BELOW_FLANGE_M * arm.rotation_base[:, 2]
        hand = self._hand_wrench(tick, arm, twist)
        load_kg = float(self._plan.load_kg[tick])
        tip = tip_motion(arm.position_base, twist, lever)
        spin = float(twist[3:] @ arm.rotation_base[:, 2])
        contact, torque_nm, normal_n = self._contact(*tip, spin, DT, GRAVITY * load_kg)
        self._adapt_hand(tick, load_kg, normal_n, torque_nm)
        outside = contact + load_kg * FALL
        turning = torque_nm * arm.rotation_base[:, 2]
        environment = at_flange(outside, lever)
        flange_wrench = hand + environment - self._damping * twist
        flange_wrench[3:] += turning
        friction_nm = self._friction_nm
        if self._stiction != 1.0:
            friction_nm = joint_friction(self._v, friction_nm, self._stiction)
        change = velocity_change(arm, self._v, flange_wrench, friction_nm, load_kg, lever)
        if load_kg > 0.0:
            outside = outside - load_kg / DT * (tip_jacobian(arm.jacobian, lever) @ change)
            environment = at_flange(outside, lever)
        joints = self._robot.joints
        row[:joints], row[joints : 2 * joints], rest = self._q, self._v, row[2 * joints :]
        rest[:6], rest[6:12], rest[12:18] = twist, environment, hand
        rest[9:12] += turning
        rest[18:21], rest[21:24], rest[24] = contact, tip[1], normal_n
        self._v = self._v + change
        self._q = self._q + DT * self._v

    def _hand_wrench(self, tick: int, arm: HandDynamics, twist: Array) -> Array:
        """Return the hand's wrench on the flange (6,): stiffness about its set place, and added forces."""
        plan, person, hand_force = self._plan, self._plan.person, self._hand_force
        place = hand_force.position_share if hand_force else 1.0
        wrench = np.empty(6)
        wrench[:3] = person.stiffness_n_per_m * (place * (plan.position[tick] - arm.position_base))
        wrench[:3] += person.damping_ns_per_m * (place * (plan.velocity[tick] - twist[:3])) + plan.force[tick]
        rotation = self._orientation
        rate = twist[3:]
        stiffness, damping = HAND_TURN_STIFFNESS, HAND_TURN_DAMPING
        if plan.turns is None:
            wrench[2] += self._weight_n - self._press_n
        else:
            toward = plan.turns.rotation[tick]
            rotation, rate = toward @ rotation, rate - plan.turns.rate[tick]
            stiffness, damping = FIRM_TURN_STIFFNESS, FIRM_TURN_DAMPING
            wrench[2] += self._weight_n
            wrench[:3] -= self._press_n * toward[:, 2]
        if hand_force:
            wrench[:3] += hand_force.force_at(tick) - (1.0 - place) * plan.feed_forward[tick]
        turn = rotation @ arm.rotation_base.T
        error = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        wrench[3:] = stiffness * error - damping * rate + plan.torque[tick]
        if self._torque_nm:
            wrench[3:] += self._torque_nm * arm.rotation_base[:, 2]
        return wrench

    def _adapt_hand(self, tick: int, load_kg: float, normal_n: float, torque_nm: float) -> None:
        """Adapt the hand to the load, the normal force and the torque of this tick.

        A hand holds its own effort, so a load that it has gripped rests on the surface, not on the hand.
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
    """Coulomb friction (7,) [Nm] at joint velocities v (7,): higher near standstill (Stribeck)."""
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
    lever: Array,
    torques: Array | float = 0.0,
) -> Array:
    """Change of joint velocity v (n,) in one tick under a wrench (6,) at the flange and torques (n,) [Nm].

    friction_nm: (n,) Coulomb friction of the joints; a load at the end of the lever (3,) adds its mass.
    """
    mass = arm.mass_matrix
    if load_kg > 0.0:
        at_tip = tip_jacobian(arm.jacobian, lever)
        mass = mass + load_kg * at_tip.T @ at_tip
    resistance: Array = friction_nm / (np.abs(v) + STICK_RAD_PER_S) + JOINT_DAMPING
    impulse: Array = DT * (arm.jacobian.T @ flange_wrench + torques - resistance * v)
    damped = np.array(mass, order="C")
    damped.ravel()[:: len(mass) + 1] += DT * resistance  # its diagonal, in a third of the time of np.diag
    return np.asarray(np.linalg.solve(damped, impulse), dtype=np.float64)


def tip_motion(position: Array, twist: Array, lever: Array) -> tuple[list[float], Vector]:
    """Position and velocity of the fingertips, as plain numbers: faster than arrays of three."""
    vx, vy, vz, wx, wy, wz = twist.tolist()
    lx, ly, lz = lever.tolist()
    velocity = (vx + wy * lz - wz * ly, vy + wz * lx - wx * lz, vz + wx * ly - wy * lx)
    return (position + lever).tolist(), velocity


def at_flange(force: Array, lever: Array) -> Array:
    """Wrench (6,) at the flange of a force (3,) at the end of a lever (3,)."""
    fx, fy, fz = force.tolist()
    lx, ly, lz = lever.tolist()
    return np.array([fx, fy, fz, ly * fz - lz * fy, lz * fx - lx * fz, lx * fy - ly * fx])


def tip_jacobian(jacobian: Array, lever: Array) -> Array:
    """Velocity of the fingertips per joint velocity, (3, n)."""
    x, y, z = lever.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    at_tip: Array = jacobian[:3] - cross @ jacobian[3:]
    return at_tip

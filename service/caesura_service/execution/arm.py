"""A simulated Panda under Cartesian impedance, in the world of a scenario, tick by tick at 1 kHz.

The arm, its friction and what it touches are those of the simulated teacher (`guiding`, `contact`). In place
of a hand a controller moves it: stiffness and damping about a setpoint, the mass that is felt at the flange
fed forward, most of the joints' friction made up for, and a force of its own. Along the direction in which a
force is controlled there is no stiffness.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from caesura_clients.bridge.teacher.contact import Touch
from caesura_clients.bridge.teacher.guiding import (
    FALL,
    FRICTION_NM,
    GRAVITY,
    Trace,
    at_flange,
    start_posture,
    tip_jacobian,
    tip_motion,
    velocity_change,
)
from caesura_clients.bridge.teacher.intentions import Array
from caesura_clients.bridge.teacher.plan import DT, TICKS_PER_S
from caesura_clients.bridge.teacher.scenarios import FINGERS_BELOW_FLANGE_M
from caesura_clients.bridge.teacher.shapes import SHAPED, ShapedTouch
from caesura_service.execution.world import World
from caesura_service.robot import HandDynamics, Robot

STIFFNESS_N_PER_M, DAMPING_NS_PER_M = 2000.0, 220.0
TURN_STIFFNESS_NM, TURN_DAMPING_NMS = 60.0, 6.0
FELT_MASS_KG = 7.0  # that is fed forward: what the arm weighs at its flange, roughly
POSTURE_NM_PER_RAD, POSTURE_NMS_PER_RAD = 5.0, 2.0  # keep the elbow where it was
FRICTION_EASED, EASED_RAD_PER_S = 0.7, 0.02  # share of the joints' friction that the controller makes up for
PRESS_DAMPING_NS_PER_M = 150.0  # along the direction of a controlled force


@dataclass
class Setpoint:
    """What the controller is asked for; base frame.

    position, velocity, acceleration: (3,) of the flange; rotation: (3, 3); push: (3,) [N] of its own;
    along: (3,) the direction in which force is controlled instead of place, zeros for none; turning: (3,)
    [rad/s].
    """

    position: Array
    rotation: Array
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    push: Array = field(default_factory=lambda: np.zeros(3))
    along: Array = field(default_factory=lambda: np.zeros(3))
    turning: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Felt:
    """The arm after a tick: position (3,) [m], rotation (3, 3) and twist (6,) of the flange, force (3,) [N]
    that it feels, without the load that it knows of; joints and their speeds (7,). torque: (3,) [Nm] that it
    feels about the flange, of the same force and of what resists its turning.
    """

    position: Array
    rotation: Array
    twist: Array
    force: Array
    q: Array
    v: Array
    torque: Array = field(default_factory=lambda: np.zeros(3))


class Arm:
    """The arm in its world. `tick` goes one millisecond on; `trace` is everything that happened."""

    def __init__(self, robot: Robot, world: World, *, friction: float = 1.0) -> None:
        self.world = world
        self._robot, self._touch = robot, Touch(world.surfaces)
        shaped = any(isinstance(surface, SHAPED) for surface in world.surfaces)
        self._shaped = ShapedTouch(world.surfaces) if shaped else None
        self._friction_nm = friction * FRICTION_NM
        self._q, rotation = start_posture(robot, world.start)
        self._home = self._q
        self._v = np.zeros(7)
        self._rows: list[Array] = []
        self.load_kg = 0.0  # that the controller knows of
        self.felt = Felt(np.array(world.start), rotation, np.zeros(6), np.zeros(3), self._q, self._v)
        self.lower, self.upper = robot.lower_limits, robot.upper_limits
        self.joint_speeds = robot.velocity_limits

    @property
    def t(self) -> float:
        """[s] since it began."""
        return DT * len(self._rows)

    def tick(self, setpoint: Setpoint) -> Felt:
        """Go one tick on under a setpoint."""
        arm = self._robot.hand_dynamics(self._q)
        twist = arm.jacobian @ self._v
        lever = FINGERS_BELOW_FLANGE_M * arm.rotation_base[:, 2]
        held_kg = self.world.held_kg
        contact, resisting = self._contact(arm, twist, lever)
        wrench = self._wrench(setpoint, arm.position_base, arm.rotation_base, twist)
        outside = contact + held_kg * FALL
        posture = POSTURE_NM_PER_RAD * (self._home - self._q) - POSTURE_NMS_PER_RAD * self._v
        eased = FRICTION_EASED * self._friction_nm * self._v / (np.abs(self._v) + EASED_RAD_PER_S)
        task = arm.jacobian.T @ np.linalg.solve(arm.jacobian @ arm.jacobian.T, arm.jacobian @ posture)
        given = wrench + at_flange(outside, lever)
        given[3:] += resisting
        change = velocity_change(
            arm, self._v, given, self._friction_nm, held_kg, lever, posture - task + eased
        )
        if held_kg > 0.0:
            outside = outside - held_kg / DT * (tip_jacobian(arm.jacobian, lever) @ change)
        environment = at_flange(outside, lever)
        environment[3:] += resisting
        row = np.concatenate([self._q, self._v, twist, environment, wrench, contact])
        self._rows.append(np.append(row, (self.world.width_m, held_kg)))
        self._v = self._v + change
        self._q = self._q + DT * self._v
        pressed = outside + np.array([0.0, 0.0, GRAVITY * self.load_kg])
        torque = resisting + np.cross(lever, pressed)
        self.felt = Felt(arm.position_base, arm.rotation_base, twist, pressed, self._q, self._v, torque)
        self.world.tick(arm.position_base, DT)
        return self.felt

    def trace(self) -> Trace:
        """Everything so far; the controller's wrench stands where a hand's would."""
        rows = np.array(self._rows)
        parts = np.split(rows, [7, 14, 20, 26, 32, 35], axis=1)
        q, v, twist, environment, hand, contact, rest = parts
        t = np.arange(len(rows)) / TICKS_PER_S
        return Trace(t, q, v, twist, environment, hand, contact, rest[:, 0], rest[:, 1])

    def _contact(self, arm: HandDynamics, twist: Array, lever: Array) -> tuple[Array, Array]:
        """Force (3,) [N] at the fingertips; torque (3,) [Nm] that resists a turn about the tool's axis."""
        tip, weight_n = tip_motion(arm.position_base, twist, lever), GRAVITY * self.world.held_kg
        if self._shaped is None:
            return np.array(self._touch.force(*tip, DT, weight_n)), np.zeros(3)
        along = arm.rotation_base[:, 2]
        felt = self._shaped.touch(*tip, float(twist[3:] @ along), DT, weight_n)
        return felt.force, felt.torque_nm * along

    def _wrench(self, want: Setpoint, position: Array, rotation: Array, twist: Array) -> Array:
        force = STIFFNESS_N_PER_M * (want.position - position)
        force += DAMPING_NS_PER_M * (want.velocity - twist[:3]) + FELT_MASS_KG * want.acceleration
        if want.along.any():
            force -= want.along * (want.along @ force + PRESS_DAMPING_NS_PER_M * (want.along @ twist[:3]))
        force += want.push
        force[2] += GRAVITY * self.load_kg
        turn = want.rotation @ rotation.T
        error = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate(
            [force, TURN_STIFFNESS_NM * error + TURN_DAMPING_NMS * (want.turning - twist[3:])]
        )

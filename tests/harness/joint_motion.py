"""Joint velocities, accelerations and jerks of a movement, by finite differences of its joints at 1 kHz.

It shares nothing with the code that times programs: its own inverse kinematics on what the executor follows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_lab.execution.trajectories import app_path, arrival_speed, press_direction
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.programs.safety import DEFAULT
from caesura_protocol.reproduced_path import Curve
from caesura_protocol.rotations import matrix_of
from caesura_service.robot import Robot

Array = NDArray[np.float64]
DT = 1e-3
# Franka's FCI documentation, "Limits for Panda": rad/s, rad/s², rad/s³.
PANDA = (
    (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
)


def followed(app: App, following: App | None) -> Curve:
    """What the executor follows for an app whose movement begins where it was taught."""
    assert app.path is not None
    assert app.path.start.orientation is not None
    start = np.array(app.path.start.position)
    meets = APP_KINDS[app.kind].carries and following is not None and APP_KINDS[following.kind].in_contact
    arriving = None
    if meets or app.kind == "move_to_contact":
        force = following.force if following is not None and following.kind == "apply_force" else None
        assert app.orientation is not None
        until = press_direction(matrix_of(app.orientation), None if force is None else np.array(force))
        arriving = arrival_speed(app, until, start, DEFAULT) * until
    return app_path(app, start, matrix_of(app.path.start.orientation), app.tn - app.t0, arriving)


def joints_followed(robot: Robot, curve: Curve, near: Array) -> Array:
    """Joints (n, 7) [rad] at every millisecond, by the least motion from one to the next; near: (7,)."""
    found, q = [], near
    for t in np.arange(0.0, curve.t[-1] + 0.5 * DT, DT):
        value = curve.at(float(t))[0]
        goal = matrix_of(value[3:])
        for _ in range(30):
            arm = robot.hand_dynamics(q)
            error = np.concatenate([value[:3] - arm.position_base, small_turn(goal @ arm.rotation_base.T)])
            if np.abs(error).max() < 1e-12:
                break
            jacobian = arm.jacobian
            q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T, error)
        found.append(q)
    return np.array(found)


def small_turn(rotation: Array) -> Array:
    """Rotation vector (3,) [rad] of a rotation (3, 3), where it is small."""
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = rotation.tolist()
    return np.array([0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)])


def shares(joints: Array, *, at_rest: bool = True) -> tuple[float, float, float]:
    """Largest share of a Panda's limits of velocity, acceleration and jerk; at_rest: before the movement."""
    moved = np.vstack([joints[:1]] * 3 + [joints]) if at_rest else joints
    rates = (np.diff(moved, order, axis=0) / DT**order for order in (1, 2, 3))
    first, second, third = (
        float((np.abs(r) / limit).max()) for r, limit in zip(rates, np.array(PANDA), strict=True)
    )
    return first, second, third

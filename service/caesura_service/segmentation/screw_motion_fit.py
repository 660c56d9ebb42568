"""The screw motion of a turn, from its observations: axis, a point of it, advance, and torque held.

Nothing here changes where a segment begins or ends. In base coordinates the pose of a turn about an axis is

    p_i = b + E_i x + θ_i d + κ f_i a,    E_i = R_i R_0⁻¹ − I,    d = k a + s

with the axis a, the angle θ_i about it, and the lever x from the axis to the flange at the start. d is the
displacement per radian: the advance k along the axis, and the slip s of the tool across it. The pressed
object yields: κ is its compliance, and f_i the change of the force along the axis. Without that term a force
that grows during a turn would appear as advance. b, x, d and κ together are one linear least-squares problem.

The advance has two uncertainties. Errors of successive observations are correlated, so n of them count as n
(1 − ρ) / (1 + ρ), with their correlation ρ (Bartlett 1946). And the axis is only as accurate as the tool
follows it: if the tool leans by λ and slips by s, λ s of the slip appears as advance.

The axis is the direction that the turn leaves unchanged on average: with M the mean of R_i R_0⁻¹, the left
singular vector of M of the largest singular value. It does not depend on the orientation of the flange's
frame in the tool, and it rotates with the base. The rotation from the first to the last pose alone would
depend on how the tool leans at these two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import ScrewMotion
from caesura_protocol.rotations import matrices_of
from caesura_service.signals.tared_torque import about

Array = NDArray[np.float64]

AXES = 3
LEAST_ANGLE_RAD = 0.1  # a turn by less has no axis to speak of
LEAST_POSES = 5  # poses, below which there are fewer equations than make an error bar
NOISE_M = 1e-4  # by which a pose leaves a turn, beside which the prior scales count
LEVER_M = 0.12  # prior scale of the lever along the axis: the length of a tool
COMPLIANCE_M_PER_N = 1e-4  # prior scale of the compliance of what is pressed: a soft hand on a stiff screw
SLIP_M_PER_RAD = 1e-3  # prior scale of the slip, which a small turn does not separate from a lever
MOST_CORRELATED = 0.95
PRESSED_SHARE = 0.5  # of the force of a tenth of the time, from which on a turn in contact is pressed
HELD_SHARE = 0.7  # of the torque of a tenth of the time, from which on a torque is held
UPPER = 0.9
TURNING_RAD = 0.01  # by which an observation turns beyond the one before, at 0.1 rad/s
POINT, LEVER, WAY, COMPLIANCE, UNKNOWNS = slice(0, 3), slice(3, 6), slice(6, 9), 9, 10


class Course(NamedTuple):
    """The observations of a turn, base frame.

    positions: (n, 3) [m] of the flange; orientations: (n, 4) x y z w; turned: (n, 3) [rad] sum of the
    rotation vectors since the first; forces: (n, 3) [N]; torques: (n, 3) [Nm] about the flange, None without.
    """

    positions: Array
    orientations: Array
    turned: Array
    forces: Array
    torques: Array | None


class Fit(NamedTuple):
    """Least squares of a turn: a point of its axis [m], and the advance with its deviation [m/rad]."""

    point: Array
    advance: float
    sd: float


def screw_of(course: Course, *, pressed: bool) -> ScrewMotion | None:
    """Return the screw motion of a turn; None if it is too small or too short to have an axis.

    pressed: whether it is in contact: then only observations with a strong force count, and the object has a
    compliance.
    """
    angle = math.sqrt(course.turned[-1] @ course.turned[-1])
    if angle < LEAST_ANGLE_RAD or len(course.positions) < LEAST_POSES:
        return None
    turns = rotations_since(course.orientations)
    axis = axis_of(turns, course.turned[-1])
    counts = _strong(course.forces, PRESSED_SHARE) if pressed else np.ones(len(turns), bool)
    if np.count_nonzero(counts) < LEAST_POSES or np.ptp(course.turned[counts] @ axis) < LEAST_ANGLE_RAD:
        counts = np.ones(len(turns), bool)
    fit = fit_turn(course, turns, axis, counts, pressed=pressed)
    point = fit.point + axis * (axis @ (course.positions[0] - fit.point))
    return ScrewMotion(
        axis=tuple(axis.tolist()),
        point=tuple(point.tolist()),
        angle=float(course.turned[-1] @ axis),
        pitch_m=2.0 * math.pi * fit.advance,
        pitch_sd_m=2.0 * math.pi * fit.sd,
        torque=None if course.torques is None else tuple(held_torque(course, axis, point).tolist()),
    )


def axis_of(turns: Array, total: Array) -> Array:
    """Axis (3,) of unit length of turns (n, 3, 3), about which the whole turn, (3,) [rad], is positive."""
    axis: Array = np.linalg.svd(turns.mean(axis=0))[0][:, 0]
    return axis if axis @ total >= 0.0 else -axis


def fit_turn(course: Course, turns: Array, axis: Array, counts: NDArray[np.bool_], *, pressed: bool) -> Fit:
    """Solve the module's equation over the observations that count, (n,) bool.

    turns: (n, 3, 3) since the first. The lever along the axis, which a turn about one axis does not
    determine, the slip and the compliance have a normal prior about 0. There is no compliance without a
    press.
    """
    places, angles = course.positions[counts] - course.positions[0], course.turned[counts] @ axis
    felt = (course.forces[counts] - course.forces[counts][0]) @ axis if pressed else np.zeros(len(places))
    n = len(places)
    design = np.zeros((n, AXES, UNKNOWNS))
    design[:, :, POINT] = np.eye(AXES)
    design[:, :, LEVER] = turns[counts] - np.eye(AXES)
    design[:, :, WAY] = angles[:, None, None] * np.eye(AXES)
    design[:, :, COMPLIANCE] = np.outer(felt, axis)
    prior = np.zeros((2 + AXES, UNKNOWNS))
    prior[0, LEVER], prior[1, COMPLIANCE] = NOISE_M / LEVER_M * axis, NOISE_M / COMPLIANCE_M_PER_N
    prior[2:, WAY] = NOISE_M / SLIP_M_PER_RAD * (np.eye(AXES) - np.outer(axis, axis))
    stacked = np.vstack([design.reshape(-1, UNKNOWNS), prior])
    found = np.linalg.lstsq(stacked, np.append(places.ravel(), np.zeros(len(prior))), rcond=None)[0]
    left = (places - design @ found) @ axis
    spread = repeats(left) * float(left @ left) / max(n - 2, 1)
    noise = spread * float(axis @ np.linalg.pinv(stacked.T @ stacked)[WAY, WAY] @ axis)
    advance, way = float(found[WAY] @ axis), found[WAY]
    slip = float(np.linalg.norm(way - advance * axis))
    lean = math.sqrt(float(np.square(turns[counts] @ axis - axis).sum(axis=1).mean()) / 2.0)
    return Fit(
        course.positions[0] + found[POINT] - found[LEVER], advance, math.hypot(math.sqrt(noise), lean * slip)
    )


def repeats(errors: Array) -> float:
    """Return the number of successive errors that count as one independent error, at least 1.

    It follows from the correlation of errors (n,) from each to the next.
    """
    size = float(errors @ errors)
    correlation = float(errors[1:] @ errors[:-1]) / size if size > 0.0 else 0.0
    correlation = min(max(correlation, 0.0), MOST_CORRELATED)
    return (1.0 + correlation) / (1.0 - correlation)


def held_torque(course: Course, axis: Array, point: Array) -> Array:
    """Return the mean torque (3,) [Nm] about a point while the tool turns and the axis torque is strong.

    The moment r × F of the flange's lever from the point is subtracted. A torque before the tool begins to
    turn, or after it has turned, is not the torque of the turn.
    """
    assert course.torques is not None, "asked where there are torques"
    steps = np.linalg.norm(np.diff(course.turned, axis=0, prepend=course.turned[:1]), axis=1)
    turns = steps >= TURNING_RAD
    turns = turns if turns.any() else ~turns
    torques = about(point, course.positions, course.forces, course.torques)[turns]
    held: Array = torques[_strong(torques @ axis[:, None], HELD_SHARE)].mean(axis=0)
    return held


def rotations_since(orientations: Array) -> Array:
    """Return rotation matrices (n, 3, 3) in the base frame since the first of quaternions (n, 4) x y z w."""
    frames = matrices_of(orientations)
    turns: Array = frames @ frames[0].T
    return turns


def _strong(values: Array, share: float) -> NDArray[np.bool_]:
    """Return a mask (n,) of values (n, c) whose size is a share of the size that a tenth of them exceeds."""
    sizes = np.linalg.norm(values, axis=1)
    return np.asarray(sizes >= share * np.quantile(sizes, UPPER))

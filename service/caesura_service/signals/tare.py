"""Tare: estimates the bias of the force at the start of a demonstration, from a window without a contact.

The window must be at rest. With a sensor below the hand it may also be in free motion: the sensor measures no
hand, and a touch shows as scatter of the force.

Later, rest in free space and rest in contact cannot be distinguished by the force, so a later tare could
subtract a contact. For the same reason a constant press on the robot during the window counts as bias: a
demonstration must begin free. One that begins in motion, with more force than a bias and a weight, was cut
from a longer one and begins in contact: it has no tare. One that begins at rest with so much force has a tare
until a fast free movement shows that it was a contact. If the tared force is small in a fast movement, the
tare was a bias and stays: a load that opposes a bias looks like free space.

The bias of the force is subtracted in the base frame, where the weight of a tool is constant. Its later
change with the pose is left to the segment models. The bias of the torque is subtracted in the flange's axes
(`tared_torque`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.constants import FREE_M_PER_S, GRAVITY, LOAD_KG, REST_M_PER_S, TARED_BIAS_N, UP

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

UNTARED = (
    "The sensor's bias, often 1 to 5 N, stays in every force and load, and hides light contacts: to have it "
    "subtracted, begin the recording at rest in free space."
)
UNTARED_BIAS_N = 5.0  # scale of what free space reads without a tare: real sensors read 1–5 N
# What neither a bias nor the weight of a tool explains, and a hand can press: steady presses have up to 35 N.
TOUCHED_N, PRESSED_N = 2.0 * UNTARED_BIAS_N, 50.0
# For so many observations a fast movement has a force that a bias explains: it is free space without a tare.
FREE_OBSERVATIONS = 4
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class RestCriterion:
    """The limits within which the force at the start of a demonstration counts as bias alone."""

    speed_limit_m_per_s: float
    scatter_limit_n: float  # standard deviation in the direction in which it is greatest


@dataclass(frozen=True)
class Tare:
    """The bias that is subtracted from every force: (fx, fy, fz) [N] base frame; None: nothing is subtracted.

    torque_bias: (3,) [Nm] that is subtracted from every torque, in the axes of `tared_torque.in_flange`; None
    without a tare or a torque. doubt: why the force may have been a contact, "" without a reason; up: away
    from gravity.
    """

    bias: Vector | None
    note: str
    torque_bias: Vector | None = None
    doubt: str = ""
    up: Vector = UP

    @property
    def may_be_contact(self) -> bool:
        """Whether the bias, less any weight, is too large for a sensor and may be a hand's press."""
        return self.bias is not None and _is_press(_without_weight(self.bias, self.up))

    def withdrawn(self, after_s: float) -> Tare:
        """Return a tare of zero with the doubt that this one was a contact. after_s: [s] since the start."""
        doubt = (
            f"The tare of {math.hypot(*(self.bias or ORIGIN)):.1f} N was no bias: "
            f"{after_s:.1f} s after the start the arm moves with a force near zero. From then on nothing is "
            "subtracted. If it was a contact, contact and free space are exchanged before that: begin in "
            "free space. If it was a tool's weight, let the robot compensate it in every pose."
        )
        torque_bias = None if self.torque_bias is None else ORIGIN
        return Tare(ORIGIN, "The tare at the start was no bias, and is withdrawn.", torque_bias, doubt)


def baseline(forces: Array) -> tuple[Array, Array]:
    """Return the mean force (3,) and the standard deviation on each axis (3,) of forces (n, 3) [N], n >= 1.

    The difference of two baselines at rest, one before and one after a grasp, is the weight of the grasped
    object. Raises ValueError without a row.
    """
    if len(forces) == 0:
        raise ValueError("no force to take a baseline from, expected at least one row")
    return forces.mean(axis=0), forces.std(axis=0)


def greatest_scatter(forces: Array) -> float:
    """Return the standard deviation [N] of forces (n, 3), n >= 1, in the direction in which it is greatest.

    So the result does not depend on the axes of the base, nor on its mounting.
    """
    aside = forces - forces.mean(axis=0)
    variance = float(np.linalg.eigvalsh(aside.T @ aside / len(forces))[-1])
    return math.sqrt(max(variance, 0.0))


def tare_of(
    forces: Array,
    speeds: Array,
    criterion: RestCriterion,
    torques: Array | None = None,
    up: Vector = UP,
) -> Tare:
    """Return the tare of a window at the start: its mean force and torque if it is at rest, else none.

    forces: (n, 3) [N] base frame; speeds: (n,) [m/s]; torques: (n, 3) [Nm], or none with n = 0; up: away from
    gravity, of length 1, base frame.
    """
    mean, fastest, worst = baseline(forces)[0], float(speeds.max()), greatest_scatter(forces)
    if fastest > criterion.speed_limit_m_per_s:
        limit = f"limit {criterion.speed_limit_m_per_s:g} m/s"
        return _untared(f"the robot moved at {fastest:.4g} m/s at the start ({limit})")
    if worst > criterion.scatter_limit_n:
        limit = f"limit {criterion.scatter_limit_n:g} N"
        return _untared(f"the force varied by {worst:.2f} N at the start ({limit})")
    x, y, z = mean.tolist()
    if float(np.median(speeds)) > REST_M_PER_S and _is_press(_without_weight((x, y, z), up)):
        return _untared(
            f"the robot moved at the start with a force of {_rounded(mean)} N, which no bias below "
            f"{TOUCHED_N:g} N and no weight explains: it touched something"
        )
    taken, torque_bias = f"{_rounded(mean)} N", None
    if torques is not None and len(torques):
        a, b, c = torques.mean(axis=0).tolist()
        taken, torque_bias = f"{taken} and {_rounded(torques.mean(axis=0))} Nm", (a, b, c)
    return Tare((x, y, z), f"Tared at the start: {taken} are subtracted.", torque_bias, _doubt(mean), up)


def _doubt(mean: Array) -> str:
    """Return the reason why a force (3,) [N] that counts as bias may be a contact; "" without one."""
    size = math.hypot(*mean.tolist())
    if not _is_press(size):
        return ""
    return (
        f"Force at the start: {size:.1f} N, taken for the bias of the sensor, which is 1 to 5 N on most "
        "robots. If the tool touched something, contact and free space are exchanged: begin in free space."
    )


def _is_press(force_n: float) -> bool:
    """Whether a force [N] is larger than any bias, and within the range of a hand's press."""
    return TOUCHED_N < force_n < PRESSED_N


def _without_weight(force: Vector, up: Vector) -> float:
    """Return the least length [N] of a force less a weight of up to LOAD_KG, which pulls against up."""
    (x, y, z), (ux, uy, uz) = force, up
    weight_n = min(max(-(x * ux + y * uy + z * uz), 0.0), LOAD_KG * GRAVITY)
    return math.hypot(x + weight_n * ux, y + weight_n * uy, z + weight_n * uz)


def _untared(why: str) -> Tare:
    """Return an empty tare whose note has the reason, its consequence and the remedy."""
    return Tare(None, f"Not tared: {why}. {UNTARED}")


def _rounded(vector: Array) -> str:
    """Return "(x, y, z)" with two digits; a component that rounds to zero has no sign."""
    return f"({', '.join(f'{round(value, 2) + 0.0:.2f}' for value in vector.tolist())})"


class TareState(NamedTuple):
    """The window so far. Once the tare is known, the window is not needed any more.

    If it may be a contact, `free` and `biased` count the latest successive observations that are free space
    without and with this tare.
    """

    tare: Tare | None = None
    forces: Array = np.empty((0, 3))
    speeds: Array = np.empty(0)
    torques: Array = np.empty((0, 3))  # none where there is no torque
    free: int = 0
    biased: int = 0

    def checked(
        self, measured_n: float | None, force: Array, speed_m_per_s: float, after_s: float
    ) -> TareState:
        """Return the state after an observation: a tare that was a contact is withdrawn, but no proven bias.

        measured_n: length of its force, not tared [N], None without a wrench; force: (3,) [N] base frame,
        filtered and not tared; after_s: since the start [s].
        """
        if self.tare is None or measured_n is None or self.biased >= FREE_OBSERVATIONS:
            return self
        if not self.tare.may_be_contact:
            return self
        is_fast = speed_m_per_s > FREE_M_PER_S
        free = self.free + 1 if is_fast and measured_n < UNTARED_BIAS_N else 0
        # A press that slides has friction, which it did not have at rest: 3 N of 16 N and more.
        left_n = math.dist(force.tolist(), self.tare.bias or ORIGIN)
        biased = self.biased + 1 if is_fast and left_n < TARED_BIAS_N else 0
        if free < FREE_OBSERVATIONS:
            return self._replace(free=free, biased=biased)
        return TareState(self.tare.withdrawn(after_s))


@dataclass(frozen=True)
class TareEstimator:
    """Collects the filtered grid rows up to last_row, and then decides on the tare once."""

    last_row: int
    criterion: RestCriterion
    up: Vector = UP  # away from gravity, of length 1, base frame

    def advance(
        self, state: TareState, first: int, forces: Array, speeds: Array, torques: Array | None = None
    ) -> TareState:
        """Process rows first, first + 1, …: forces (n, 3) [N] base frame, speeds (n,) [m/s], torques (n,
        3).
        """
        if state.tare is not None:
            return state
        n = max(0, self.last_row + 1 - first)
        forces = np.concatenate([state.forces, forces[:n]])
        speeds = np.concatenate([state.speeds, speeds[:n]])
        if torques is not None:
            torques = np.concatenate([state.torques, torques[:n]])
        if first + len(speeds) - len(state.speeds) <= self.last_row:
            return TareState(None, forces, speeds, state.torques if torques is None else torques)
        return TareState(tare_of(forces, speeds, self.criterion, torques, self.up))

    def interrupted(self, state: TareState, why: str) -> TareState:
        """End the estimation because its window will not be complete: nothing is subtracted."""
        return state if state.tare is not None else TareState(_untared(why))

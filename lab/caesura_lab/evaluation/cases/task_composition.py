"""The parts of a demonstration in contact: rests, movements, slides, presses and turns, with their truth.

Every movement and turn has minimum jerk (Flash & Hogan 1985). A surface is level and stiff, and has Coulomb
friction; its force varies about a mean. Gravity points along −z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from caesura_lab.evaluation.cases.free_movements import (
    RATE_HZ,
    STEP_S,
    TOLERANCE_S,
    seen_s,
    unsteady,
    wander,
    wander_3d,
)
from caesura_lab.ground_truth import TrueChangepoint, TrueSegment, Truth
from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
ROUNDED_S = 0.02  # by which a hand rounds the joins of its movements
TOUCHED_S = 0.05  # within which a surface takes up the unsteadiness of a hand, or leaves it
SETTLED_S = 4.0  # of a force, before it is used: its deviation is that of more than a brief press
TURN_UP_S = 0.15  # of a torque
SWAY_RAD, SWAY_HZ = 0.0025, 0.5  # of a hand's orientation
TOOL_KG = 0.3  # whose inertia the sensor feels
# Of a gripper: the width of what it holds [m], how much further it opens [m], and how fast [s].
CLOSED_M, OPENED_M, GRIP_S = 0.02, 0.03, 0.05
BIAS_N, BIAS_NM, BIAS_HZ = 0.4, 0.02, 0.2  # wandering, beside what the tare removes


class TaskComposition:
    """A demonstration of a task while it is composed, part by part."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.points: list[TrueChangepoint] = []
        self.spans: list[TrueSegment] = []
        self.phases: list[TrueSegment] = []
        self._positions, self._turns = [np.zeros((1, 3))], [Rotation.identity(1)]
        self._pushes, self._torques = [np.zeros(1)], [np.zeros((1, 3))]
        self._grips: list[tuple[float, bool]] = []  # when the gripper moved [s], and whether it opened

    @property
    def t(self) -> float:
        """Time [s] at which the last part ends."""
        return STEP_S * (sum(map(len, self._positions)) - 1)

    def between(self, low: float, high: float) -> float:
        """Return a random value."""
        return float(self.rng.uniform(low, high))

    def level(self) -> Array:
        """Return a random level direction (3,)."""
        angle = self.between(0.0, 2.0 * np.pi)
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    def mark(self, kind: str, t: float | None = None) -> None:
        """Add a true changepoint; t [s]: None for the end of the last part."""
        self.points.append(TrueChangepoint(self.t if t is None else t, TOLERANCE_S, kind=kind))

    def add(
        self,
        kind: str,
        path: Array,
        push: ArrayLike = 0.0,
        turns: Rotation | None = None,
        torque: ArrayLike = 0.0,
    ) -> float:
        """Add a part, and return when it begins [s].

        path (n, 3) [m] and turns (n,): from the end of the last part. push (n,) [N]: of the surface, upwards.
        torque (n, 3) [Nm]: of the environment.
        """
        begun, n, last = self.t, len(path), self._turns[-1][-1]
        self._positions.append(self._positions[-1][-1] + path)
        self._turns.append(
            Rotation.from_quat(np.tile(last.as_quat(), (n, 1))) if turns is None else turns * last
        )
        self._pushes.append(np.broadcast_to(push, n))
        self._torques.append(np.broadcast_to(torque, (n, 3)))
        self.spans.append(TrueSegment(begun, self.t, kind))
        return begun

    def rest(self, low: float, high: float) -> None:
        """Rest in free space for a time [s] between these."""
        self.add("steady", np.zeros((round(self.between(low, high) * RATE_HZ), 3)))

    def move(self, way: Array, seconds: float, edges: tuple[str, ...] = ("start", "stop")) -> None:
        """Move in free space by way (3,) [m], on a path that is bowed by up to 8 % of its length."""
        share = minimum_jerk(shares(seconds))[:, None]
        aside = np.cross(way, self.rng.normal(size=3))
        bow = self.between(0.0, 0.08) * np.linalg.norm(way) * aside / np.linalg.norm(aside)
        begun = self.add("motion", share * way + 4.0 * share * (1.0 - share) * bow)
        self.edges(begun, seconds, edges)

    def edges(self, begun: float, seconds: float, edges: tuple[str, ...]) -> None:
        """Mark where a movement of minimum jerk begins and ends to be seen, as far as `edges` names it."""
        for kind, t in (("start", begun + seen_s(seconds)), ("stop", begun + seconds - seen_s(seconds))):
            if kind in edges:
                self.mark(kind, t)

    def grip(self, *, opened: bool) -> None:
        """Open or close the gripper. It is closed before, and without a call the recording has no gripper."""
        self._grips.append((self.t, opened))

    def push(self, n: int, mean_n: float, on_s: float, off_s: float) -> Array:
        """Return (n,) forces [N] that vary about a mean, and set in and cease within on_s and off_s [s]."""
        t, settled = STEP_S * np.arange(n), round(SETTLED_S * RATE_HZ)
        varied = mean_n * np.exp(0.2 * wander(n + settled, 1.0, self.rng)[settled:])
        for edge_s, since in ((on_s, t), (off_s, t[::-1])):
            varied *= minimum_jerk(np.clip(since / edge_s, 0.0, 1.0)) if edge_s else 1.0
        return varied

    def slide(self, path: Array, mean_n: float) -> float:
        """Touch, slide along path (n, 3) [m], and leave the surface; return when it is touched [s]."""
        self.mark("contact_on")
        push = self.push(len(path), mean_n, self.between(0.05, 0.2), self.between(0.1, 0.25))
        begun = self.add("sliding", path, push)
        self.mark("contact_off")
        return begun

    def hold(self, seconds: float, mean_n: float, on_s: float = 0.0, off_s: float = 0.0) -> None:
        """Press at rest for a time [s]."""
        n = round(seconds * RATE_HZ)
        self.add("contact", np.zeros((n, 3)), self.push(n, mean_n, on_s, off_s))

    def turn(
        self, axis: Array, angle: float, seconds: float, arm: Array | None = None, **contact: float
    ) -> None:
        """Turn by an angle [rad] about an axis (3,) through a point that is `arm` (3,) [m] away.

        contact: push_n [N], torque_nm [Nm] against the turn, and advance_m [m] along the axis.
        """
        share = minimum_jerk(shares(seconds))
        turns = Rotation.from_rotvec(angle * share[:, None] * axis)
        centre = np.zeros(3) if arm is None else arm
        path = centre - turns.apply(centre) + contact.get("advance_m", 0.0) * share[:, None] * axis
        t = seconds * shares(seconds)
        shape = minimum_jerk(np.clip(np.minimum(t, seconds - t) / TURN_UP_S, 0.0, 1.0))
        torque = -np.sign(angle) * contact.get("torque_nm", 0.0) * shape[:, None] * axis
        begun = self.add("turning", path, contact.get("push_n", 0.0), turns, torque)
        self.edges(begun, seconds, ("start", "stop"))

    def reach(self) -> None:
        """Rest, move above the surface, rest there, and descend until the surface is touched."""
        self.rest(0.8, 1.5)
        self.move(self.between(0.15, 0.3) * self.level() + 0.04 * UP, self.between(1.0, 1.8))
        self.rest(0.3, 0.8)
        self.descend(self.between(0.04, 0.12), self.between(0.7, 1.3))
        self.phases.append(TrueSegment(0.0, self.t, "reach"))

    def descend(self, height_m: float, seconds: float) -> None:
        """Move down to the surface, and a little aside."""
        aside = 0.02 * self.between(-1.0, 1.0) * self.level()
        self.move(aside - height_m * UP, seconds, ("start",))

    def retract(self, phase: str) -> None:
        """End a phase in contact, move up, and rest."""
        begun = self.t
        self.phases.append(TrueSegment(self.phases[-1].t1, begun, phase))
        self.move(0.12 * UP + 0.05 * self.level(), self.between(0.9, 1.5), ("stop",))
        self.rest(1.0, 1.0)
        self.phases.append(TrueSegment(begun, self.t, "retract"))

    def finished(self, name: str, kind: str) -> tuple[Recording, Truth]:
        """Return what a sensor below the guiding hand measures, and the truth."""
        path = gaussian_filter1d(np.concatenate(self._positions), ROUNDED_S * RATE_HZ, axis=0, mode="nearest")
        push = gaussian_filter1d(np.concatenate(self._pushes), ROUNDED_S * RATE_HZ)
        torque = gaussian_filter1d(np.concatenate(self._torques), ROUNDED_S * RATE_HZ, axis=0)
        free = 1.0 - gaussian_filter1d((push > 0.0).astype(float), TOUCHED_S * RATE_HZ)
        error = unsteady(path, self.rng) - path
        error[:, 2] *= free
        given = push[:, None] * UP / self.between(3e3, 2e4)  # of the surface, by its stiffness [N/m]
        sway = Rotation.from_rotvec(SWAY_RAD * free[:, None] * wander_3d(len(path), SWAY_HZ, self.rng))
        turned = sway * Rotation.concatenate(self._turns)
        force = self._force(path, push) + BIAS_N * wander_3d(len(path), BIAS_HZ, self.rng)
        torque += BIAS_NM * wander_3d(len(path), BIAS_HZ, self.rng)
        noise_n = self.between(0.05, 0.2)
        signals = {
            "pos": path + error - given,
            "quat": turned.as_quat(),
            "force": force + noise_n * self.rng.normal(size=force.shape),
            "torque": torque + 0.1 * noise_n * self.rng.normal(size=force.shape),
        }
        t: Array = STEP_S * np.arange(len(path), dtype=np.float64)
        if self._grips:
            signals["gripper"] = self._opening(t)
        points = tuple(sorted(self.points, key=lambda point: point.t))
        recording = Recording(t, signals, "flange_sensor", name=name, hand_on_robot="yes", force_frame="base")
        window = (0.0, float(t[-1]))
        return recording, Truth(
            name, window, points, tuple(self.spans), robot=kind, phases=tuple(self.phases)
        )

    def _force(self, path: Array, push: Array) -> Array:
        """Return (n, 3) forces [N] of the surface and of the tool's inertia."""
        velocity = np.gradient(path, STEP_S, axis=0)
        along = velocity * (1.0, 1.0, 0.0)
        speed = np.maximum(np.linalg.norm(along, axis=1), 0.005)
        friction = -self.between(0.15, 0.5) * (push / speed)[:, None] * along
        inertia = -TOOL_KG * np.gradient(velocity, STEP_S, axis=0)
        force: Array = push[:, None] * UP + friction + inertia
        return force

    def _opening(self, t: Array) -> Array:
        """Return the opening of the gripper (n, 1) [m] at times (n,)."""
        opened = np.zeros(len(t))
        for at, is_open in self._grips:
            opened[t >= at] = is_open
        width_m = CLOSED_M + OPENED_M * gaussian_filter1d(opened, GRIP_S * RATE_HZ)
        return np.asarray(width_m)[:, None]


def shares(seconds: float) -> Array:
    """Return the share of a duration that has passed after each sample of it."""
    n = round(seconds * RATE_HZ)
    share: Array = np.arange(1, n + 1) / n
    return share

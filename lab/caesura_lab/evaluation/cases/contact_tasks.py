"""Tasks in contact and turns, by published laws of hand motion, with their truth; without robot and teacher.

No parameter of a model was chosen on them. Every movement and turn has minimum jerk (Flash & Hogan 1985). A
surface is level and stiff, and has Coulomb friction; its force varies about a mean. Kinds of task:

- `press`: presses after a stop above the surface.
- `probe`: light presses after a slow approach.
- `wipe`: strokes to and fro on a surface, with no stop between them.
- `peel`: strokes on a surface in one direction, and returns through the air.
- `circle`: circles on a surface.
- `contour`: strokes on a surface that turn by 90°, one into the next.
- `land`: the hand descends while it goes on, and slides along the surface.
- `press_and_slide`: a press, a stroke and a press, without a release.
- `screw`: turns against a torque and turns back, with rests between them, all in contact.
- `key`: a press, a quarter turn and a press, without a release.
- `pour`: a turn about a point of the tool, a rest, and the turn back.
- `aim`: a movement that turns the tool, a rest, and a turn about the flange.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from caesura_lab.evaluation.cases.free_movements import (
    RATE_HZ,
    STEP_S,
    TOLERANCE_S,
    overlapping,
    seen_s,
    unsteady,
    wander,
    wander_3d,
)
from caesura_lab.evaluation.cases.seeded_case import SeededCase
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
BIAS_N, BIAS_NM, BIAS_HZ = 0.4, 0.02, 0.2  # wandering, beside what the tare removes


class _Task:
    """A demonstration while it is composed, part by part."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.points: list[TrueChangepoint] = []
        self.spans: list[TrueSegment] = []
        self.phases: list[TrueSegment] = []
        self._positions, self._turns = [np.zeros((1, 3))], [Rotation.identity(1)]
        self._pushes, self._torques = [np.zeros(1)], [np.zeros((1, 3))]

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
        share = minimum_jerk(_share(seconds))[:, None]
        aside = np.cross(way, self.rng.normal(size=3))
        bow = self.between(0.0, 0.08) * np.linalg.norm(way) * aside / np.linalg.norm(aside)
        begun = self.add("motion", share * way + 4.0 * share * (1.0 - share) * bow)
        self.edges(begun, seconds, edges)

    def edges(self, begun: float, seconds: float, edges: tuple[str, ...]) -> None:
        """Mark where a movement of minimum jerk begins and ends to be seen, as far as `edges` names it."""
        for kind, t in (("start", begun + seen_s(seconds)), ("stop", begun + seconds - seen_s(seconds))):
            if kind in edges:
                self.mark(kind, t)

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
        share = minimum_jerk(_share(seconds))
        turns = Rotation.from_rotvec(angle * share[:, None] * axis)
        centre = np.zeros(3) if arm is None else arm
        path = centre - turns.apply(centre) + contact.get("advance_m", 0.0) * share[:, None] * axis
        t = seconds * _share(seconds)
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


def _share(seconds: float) -> Array:
    """Return the share of a duration that has passed after each sample of it."""
    n = round(seconds * RATE_HZ)
    share: Array = np.arange(1, n + 1) / n
    return share


def _press(task: _Task) -> None:
    task.rest(0.8, 1.5)
    for _ in range(task.rng.integers(2, 5)):
        task.move(task.between(0.08, 0.25) * task.level(), task.between(0.8, 1.6))
        task.rest(0.3, 0.8)
        height_m = task.between(0.03, 0.08)
        task.descend(height_m, task.between(0.6, 1.1))
        _press_and_leave(task, task.between(5.0, 25.0), height_m)


def _probe(task: _Task) -> None:
    task.rest(0.8, 1.5)
    for _ in range(task.rng.integers(2, 4)):
        task.move(task.between(0.05, 0.15) * task.level(), task.between(0.8, 1.6))
        task.rest(0.4, 0.8)
        speed, height_m = task.between(0.015, 0.04), task.between(0.02, 0.04)
        t = np.arange(STEP_S, height_m / speed + 0.1, STEP_S)
        down = speed * np.where(t < 0.2, 2.5 * t**2, t - 0.1)  # it speeds up for 0.2 s
        begun = task.add("motion", -down[:, None] * UP)
        task.mark("start", begun + 0.05)
        _press_and_leave(task, task.between(4.0, 8.0), float(down[-1]))


def _press_and_leave(task: _Task, mean_n: float, height_m: float) -> None:
    """Press, move up again, and rest."""
    task.mark("contact_on")
    task.hold(task.between(0.4, 1.5), mean_n, task.between(0.06, 0.25), task.between(0.08, 0.25))
    task.mark("contact_off")
    task.move(height_m * UP, task.between(0.5, 1.0), ("stop",))
    task.rest(0.4, 1.0)


def _wipe(task: _Task) -> None:
    task.reach()
    count = task.rng.integers(5, 11)
    ahead, sizes = task.level(), task.between(0.06, 0.18) * task.rng.uniform(0.9, 1.1, count)
    seconds = task.between(0.5, 1.0) * task.rng.uniform(0.85, 1.15, count)
    to_and_fro = (-1.0) ** np.arange(count)[:, None] * ahead + 0.12 * np.cross(ahead, UP)
    ends = np.cumsum(seconds)
    path = overlapping(sizes[:, None] * to_and_fro, seconds, ends - seconds)
    begun = task.slide(path, task.between(6.0, 25.0))
    for end in ends[:-1]:
        task.mark("corner", begun + float(end))
    task.retract("wipe")


def _peel(task: _Task) -> None:
    task.reach()
    ahead, size, mean_n = task.level(), task.between(0.07, 0.16), task.between(6.0, 14.0)
    for stroke in range(task.rng.integers(3, 7)):
        if stroke:
            share = minimum_jerk(_share(task.between(0.7, 1.2)))[:, None]
            back = 0.01 * np.cross(ahead, UP) - size * ahead
            task.add("motion", share * back + 0.05 * np.sin(np.pi * share) * UP)
        seconds = np.array([task.between(0.8, 1.6)])
        task.slide(overlapping(size * task.between(0.9, 1.1) * ahead[None], seconds, np.zeros(1)), mean_n)
    task.retract("peel")


def _circle(task: _Task) -> None:
    task.reach()
    turns, period_s = task.between(2.0, 4.0), task.between(1.2, 2.5)
    share = _share(turns * period_s)
    phase = np.cumsum(np.clip(2.0 * turns * period_s * np.minimum(share, 1.0 - share), 0.0, 1.0))
    phase *= 2.0 * np.pi * turns / phase[-1]
    circles = np.column_stack([np.cos(phase) - 1.0, np.sin(phase), np.zeros(len(phase))])
    task.slide(task.between(0.03, 0.08) * circles, task.between(6.0, 20.0))
    task.retract("circle")


def _contour(task: _Task) -> None:
    task.reach()
    count = task.rng.integers(2, 5)
    directions = [task.level()]
    while len(directions) < count:
        directions.append(np.cross(UP, directions[-1]) * task.rng.choice([-1.0, 1.0]))
    seconds = task.rng.uniform(0.8, 1.8, count)
    begun = np.concatenate([[0.0], np.cumsum(0.88 * seconds[:-1])])
    sizes = task.rng.uniform(0.06, 0.15, count)
    path = overlapping(sizes[:, None] * np.array(directions), seconds, begun)
    touched = task.slide(path, task.between(6.0, 20.0))
    for start, before in zip(begun[1:], seconds[:-1], strict=True):
        task.mark("corner", touched + float(start + 0.06 * before))
    task.retract("contour")


def _land(task: _Task) -> None:
    task.rest(0.8, 1.5)
    for _ in range(task.rng.integers(1, 3)):
        way, height_m = task.between(0.15, 0.3) * task.level(), task.between(0.03, 0.06)
        seconds, falls = task.between(1.4, 2.6), task.between(0.25, 0.4)
        share = _share(seconds)
        down = minimum_jerk(np.clip(share / falls, 0.0, 1.0))
        path = minimum_jerk(share)[:, None] * way - height_m * down[:, None] * UP
        touch = round(0.95 * falls * len(path))
        begun = task.add("motion", path[:touch])
        task.edges(begun, seconds, ("start",))
        task.slide(path[touch:] - path[touch - 1], task.between(6.0, 20.0))
        task.move(height_m * UP - 0.9 * way, task.between(1.0, 1.6), ("stop",))
        task.rest(0.5, 1.0)


def _press_and_slide(task: _Task) -> None:
    task.reach()
    mean_n, seconds = task.between(6.0, 20.0), task.between(1.0, 2.0)
    task.mark("contact_on")
    task.hold(task.between(0.6, 1.2), mean_n, on_s=task.between(0.08, 0.25))
    path = task.between(0.06, 0.2) * minimum_jerk(_share(seconds))[:, None] * task.level()
    begun = task.add("sliding", path, task.push(len(path), mean_n, 0.0, 0.0))
    task.edges(begun, seconds, ("start", "stop"))
    task.hold(task.between(0.6, 1.2), mean_n, off_s=task.between(0.1, 0.2))
    task.mark("contact_off")
    task.retract("press and slide")


def _screw(task: _Task) -> None:
    task.reach()
    task.mark("contact_on")
    push_n, angle = task.between(5.0, 15.0), task.between(1.0, 1.9)
    torque_nm = task.between(0.4, 2.0)
    task.hold(task.between(0.4, 0.8), push_n, on_s=task.between(0.08, 0.2))
    for stroke in range(task.rng.integers(3, 6)):
        if stroke:
            task.turn(-UP, -angle, task.between(0.7, 1.2), push_n=0.6 * push_n)
            task.hold(task.between(0.3, 0.6), push_n)
        seconds = task.between(0.9, 1.6)
        task.turn(-UP, angle, seconds, push_n=push_n, torque_nm=torque_nm, advance_m=0.0015)
        task.hold(task.between(0.3, 0.6), push_n)
    task.mark("contact_off")
    task.retract("screw")


def _key(task: _Task) -> None:
    task.reach()
    task.mark("contact_on")
    push_n = task.between(8.0, 20.0)
    task.hold(task.between(0.5, 0.9), push_n, on_s=task.between(0.08, 0.2))
    quarter = float(task.rng.choice([-0.5, 0.5])) * np.pi
    task.turn(UP, quarter, task.between(0.8, 1.5), push_n=push_n, torque_nm=task.between(0.5, 2.0))
    task.hold(task.between(0.5, 0.9), push_n, off_s=0.15)
    task.mark("contact_off")
    task.retract("key")


def _pour(task: _Task) -> None:
    task.rest(0.8, 1.5)
    task.move(task.between(0.15, 0.3) * task.level(), task.between(1.0, 1.8))
    task.rest(0.4, 0.9)
    axis, angle, arm = task.level(), task.between(1.0, 1.9), -task.between(0.03, 0.1) * UP
    task.turn(axis, angle, task.between(1.2, 2.5), arm)
    task.rest(0.6, 1.5)
    task.turn(axis, -angle, task.between(1.0, 2.0), Rotation.from_rotvec(angle * axis).apply(arm))
    task.rest(0.4, 0.9)
    task.move(task.between(0.15, 0.3) * task.level(), task.between(1.0, 1.8))
    task.rest(1.0, 1.0)


def _aim(task: _Task) -> None:
    task.rest(0.8, 1.5)
    seconds, way = task.between(1.2, 1.8), task.between(0.15, 0.3) * task.level()
    share = minimum_jerk(_share(seconds))[:, None]
    begun = task.add(
        "motion", share * way, turns=Rotation.from_rotvec(task.between(0.4, 1.0) * share * task.level())
    )
    task.edges(begun, seconds, ("start", "stop"))
    task.rest(0.4, 0.9)
    axis = task.rng.normal(size=3)
    task.turn(axis / np.linalg.norm(axis), task.between(0.5, 1.7), task.between(0.8, 1.6))
    task.rest(0.4, 0.9)
    task.move(task.between(0.15, 0.3) * task.level(), task.between(1.0, 1.8))
    task.rest(1.0, 1.0)


TASKS: Mapping[str, Callable[[_Task], None]] = {
    "press": _press,
    "probe": _probe,
    "wipe": _wipe,
    "peel": _peel,
    "circle": _circle,
    "contour": _contour,
    "land": _land,
    "press_and_slide": _press_and_slide,
    "screw": _screw,
    "key": _key,
    "pour": _pour,
    "aim": _aim,
}


class ContactTask(SeededCase):
    """A demonstration of one task of `TASKS`."""

    def load(self) -> tuple[Recording, Truth]:
        """Simulate the recording and its truth."""
        task = _Task(self.rng)
        TASKS[self.kind](task)
        return task.finished(self.name, self.kind)

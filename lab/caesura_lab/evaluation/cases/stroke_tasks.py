"""Tasks of many strokes, by the laws of `contact_tasks.py`, on which the phases are evaluated.

The tasks differ in what is repeated, and how. Each has three phases, of which the second has 3 to 10 strokes.
No parameter of a model was chosen on them.
Kinds of task:

- `wipe_growing`: strokes to and fro, each longer than the one before.
- `wipe_zigzag`: oblique strokes, which lead sideways as far as forwards.
- `wipe_arc`: strokes to and fro along an arc, as a forearm makes them.
- `wipe_spiral`: circles that grow, and drift.
- `wipe_paused`: strokes with rests on the surface.
- `wipe_eased`: the hand presses less where it turns back.
- `wipe_lifted`: the tool lifts off for a moment after each stroke.
- `wipe_one_way`: strokes in one direction, and returns through the air.
- `peel_aside`: the same, each stroke beside the one before.
- `peel_two_lengths`: short and long strokes in turn.
- `peel_dragged`: the returns drag over the surface.
- `peel_inspected`: the hand moves away after a stroke, and rests there.
- `screw_regripped`: the gripper opens for each turn back.
- `screw_lifted`: the tool lifts off, turns back, and is put on again.
- `screw_light`: turns at a push of 3 to 5 N.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.cases.free_movements import STEP_S, overlapping
from caesura_lab.evaluation.cases.seeded_case import SeededCase
from caesura_lab.evaluation.cases.task_composition import UP, TaskComposition, shares
from caesura_lab.ground_truth import Truth
from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]

FEWEST, MOST = 3, 10  # strokes
EASED = 0.25  # of the force, where a hand turns back


class _Strokes:
    """The strokes of a wipe: (n, 3) ways [m], and durations [s]."""

    def __init__(self, task: TaskComposition, *, aside: float, growing: bool = False) -> None:
        """aside: of its length, the share of a stroke's way sideways, beside one forwards of up to 1."""
        self.count = int(task.rng.integers(FEWEST, MOST + 1))
        self.ahead = task.level()
        self.seconds: Array = task.between(0.5, 1.1) * task.rng.uniform(0.85, 1.15, self.count)
        self.sizes: Array = task.between(0.06, 0.2) * task.rng.uniform(0.9, 1.1, self.count)
        if growing:
            self.sizes = np.linspace(0.3, 1.0, self.count) * task.between(0.12, 0.22)
        to_and_fro = (-1.0) ** np.arange(self.count)[:, None]
        forwards = np.sqrt(1.0 - aside**2) * to_and_fro * self.ahead
        self.ways: Array = self.sizes[:, None] * (forwards + aside * np.cross(self.ahead, UP))

    @property
    def ends_s(self) -> Array:
        """Times (n,) at which the strokes end, after the start of the first [s]."""
        ends: Array = np.cumsum(self.seconds)
        return ends

    @property
    def path(self) -> Array:
        """The strokes one after the other, (n, 3) [m]."""
        return overlapping(self.ways, self.seconds, self.ends_s - self.seconds)

    def mark_corners(self, task: TaskComposition, begun: float) -> None:
        """Mark where the strokes turn back. begun: when the first one begins [s]."""
        for end in self.ends_s[:-1]:
            task.mark("corner", begun + float(end))


def _stroke(way: Array, seconds: float) -> Array:
    path: Array = minimum_jerk(shares(seconds))[:, None] * way
    return path


def _wipe(task: TaskComposition, *, aside: float = 0.1, growing: bool = False) -> None:
    task.reach()
    strokes = _Strokes(task, aside=aside, growing=growing)
    strokes.mark_corners(task, task.slide(strokes.path, task.between(5.0, 25.0)))
    task.retract("wipe")


def _wipe_arc(task: TaskComposition) -> None:
    task.reach()
    strokes, radius_m = _Strokes(task, aside=0.0), task.between(0.2, 0.4)
    along = strokes.path @ strokes.ahead
    angle = along / radius_m
    drift = np.linspace(0.0, 0.02 * strokes.count, len(along))
    across = radius_m * (1.0 - np.cos(angle)) + drift
    path = radius_m * np.sin(angle)[:, None] * strokes.ahead + across[:, None] * np.cross(strokes.ahead, UP)
    strokes.mark_corners(task, task.slide(path, task.between(5.0, 25.0)))
    task.retract("wipe")


def _wipe_spiral(task: TaskComposition) -> None:
    task.reach()
    seconds = task.between(4.0, 10.0)
    share = shares(seconds)
    share = share**2 * (3.0 - 2.0 * share)
    radius_m = task.between(0.03, 0.09) * (0.2 + 0.8 * share)
    angle = 2.0 * np.pi * seconds / task.between(0.9, 1.8) * share
    path = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0 * angle])
    path += task.between(0.0, 0.15) * share[:, None] * task.level()
    task.slide(path - path[0], task.between(5.0, 25.0))
    task.retract("wipe")


def _wipe_paused(task: TaskComposition) -> None:
    task.reach()
    strokes, mean_n = _Strokes(task, aside=0.1), task.between(5.0, 25.0)
    task.mark("contact_on")
    task.hold(task.between(0.2, 0.7), mean_n, on_s=task.between(0.08, 0.2))
    for i, (way, seconds) in enumerate(zip(strokes.ways, strokes.seconds.tolist(), strict=True)):
        path = _stroke(way, seconds)
        begun = task.add("sliding", path, task.push(len(path), mean_n, 0.0, 0.0))
        task.edges(begun, seconds, ("start", "stop"))
        off_s = 0.15 if i == strokes.count - 1 else 0.0
        task.hold(task.between(0.3, 0.7), mean_n, off_s=off_s)
    task.mark("contact_off")
    task.retract("wipe")


def _wipe_eased(task: TaskComposition) -> None:
    task.reach()
    strokes = _Strokes(task, aside=0.1)
    path = strokes.path
    speed = np.linalg.norm(np.gradient(path, STEP_S, axis=0), axis=1)
    task.mark("contact_on")
    push = task.push(len(path), task.between(8.0, 25.0), 0.1, 0.1)
    begun = task.add("sliding", path, push * np.clip(2.0 * speed / speed.max(), EASED, 1.0))
    task.mark("contact_off")
    strokes.mark_corners(task, begun)
    task.retract("wipe")


def _wipe_lifted(task: TaskComposition) -> None:
    task.reach()
    strokes, mean_n = _Strokes(task, aside=0.1), task.between(5.0, 25.0)
    for i, (way, seconds) in enumerate(zip(strokes.ways, strokes.seconds.tolist(), strict=True)):
        if i:
            aside = 0.03 * np.cross(strokes.ahead, UP)
            _return(task, aside, task.between(0.5, 0.9), task.between(0.02, 0.05))
        task.slide(_stroke(way, seconds), mean_n)
    task.retract("wipe")


def _return(task: TaskComposition, way: Array, seconds: float, height_m: float) -> None:
    """Move by way (3,) [m] through the air."""
    path = _stroke(way, seconds)
    task.add("motion", path + height_m * np.sin(np.pi * minimum_jerk(shares(seconds)))[:, None] * UP)


def _one_way(
    task: TaskComposition,
    phase: str,
    *,
    aside_m: tuple[float, float] = (0.005, 0.02),
    shares_of_length: tuple[float, ...] = (1.0,),
    back: str = "air",
) -> None:
    """Make strokes in one direction. back: how the hand returns, `air`, `dragged` or `inspected`."""
    task.reach()
    ahead, size, mean_n = task.level(), task.between(0.06, 0.16), task.between(5.0, 14.0)
    count, aside = int(task.rng.integers(FEWEST, MOST + 1)), task.between(*aside_m) * np.cross(ahead, UP)
    for i in range(count):
        way = size * shares_of_length[i % len(shares_of_length)] * task.between(0.9, 1.1) * ahead
        path, last = _stroke(way, task.between(0.7, 1.6)), i == count - 1
        if back == "dragged":
            _drag(task, path, aside - way, mean_n, (i == 0, last))
            continue
        task.slide(path, mean_n)
        if last:
            break
        if back == "inspected":
            away = task.between(0.06, 0.15) * UP - 0.3 * way
            task.move(away, task.between(0.6, 1.0), ("stop",))
            task.rest(0.4, 1.2)
            task.move(aside - way - away, task.between(0.6, 1.0), ("start",))
        else:
            _return(task, aside - way, task.between(0.7, 1.4), task.between(0.03, 0.1))
    task.retract(phase)


def _drag(task: TaskComposition, path: Array, back: Array, mean_n: float, ends: tuple[bool, bool]) -> None:
    """Slide along path (n, 3) [m], and back by a way (3,) [m]. ends: whether it is the first, or the last."""
    first, last = ends
    task.mark("contact_on" if first else "corner")
    task.add("sliding", path, task.push(len(path), mean_n, 0.1 if first else 0.0, 0.1 if last else 0.0))
    task.mark("contact_off" if last else "corner")
    if not last:
        way = _stroke(back, task.between(0.7, 1.4))
        task.add("sliding", way, 0.35 * task.push(len(way), mean_n, 0.0, 0.0))


def _screw(task: TaskComposition, *, push_n: tuple[float, float] = (5.0, 15.0), back: str = "held") -> None:
    """Turn and turn back. back: `held`, with the fingers `regripped`, or with the tool `lifted`."""
    task.reach()
    task.mark("contact_on")
    push, angle, torque_nm = task.between(*push_n), task.between(1.0, 1.9), task.between(0.4, 2.0)
    task.hold(task.between(0.4, 0.8), push, on_s=task.between(0.08, 0.2))
    for i in range(int(task.rng.integers(FEWEST, MOST + 1))):
        if i:
            _turn_back(task, back, -angle, push)
            task.hold(task.between(0.3, 0.6), push, on_s=0.0 if back == "held" else 0.1)
        task.turn(-UP, angle, task.between(0.9, 1.6), push_n=push, torque_nm=torque_nm, advance_m=0.0015)
        task.hold(task.between(0.3, 0.6), push)
    task.mark("contact_off")
    task.retract("screw")


def _turn_back(task: TaskComposition, back: str, angle: float, push_n: float) -> None:
    seconds = task.between(0.7, 1.2)
    if back == "held":
        task.turn(-UP, angle, seconds, push_n=0.6 * push_n)
        return
    task.mark("contact_off")
    if back == "regripped":
        task.grip(opened=True)
        task.rest(0.3, 0.5)
        task.turn(-UP, angle, seconds)
        task.grip(opened=False)
    else:
        task.move(0.02 * UP, task.between(0.4, 0.7), ("stop",))
        task.turn(-UP, angle, seconds)
        task.move(-0.02 * UP, task.between(0.4, 0.7), ("start",))
    task.mark("contact_on")


STROKE_TASKS: Mapping[str, Callable[[TaskComposition], None]] = {
    "wipe_growing": partial(_wipe, growing=True),
    "wipe_zigzag": partial(_wipe, aside=0.6),
    "wipe_arc": _wipe_arc,
    "wipe_spiral": _wipe_spiral,
    "wipe_paused": _wipe_paused,
    "wipe_eased": _wipe_eased,
    "wipe_lifted": _wipe_lifted,
    "wipe_one_way": partial(_one_way, phase="wipe"),
    "peel_aside": partial(_one_way, phase="peel", aside_m=(0.02, 0.04)),
    "peel_two_lengths": partial(_one_way, phase="peel", shares_of_length=(0.45, 1.0)),
    "peel_dragged": partial(_one_way, phase="peel", back="dragged"),
    "peel_inspected": partial(_one_way, phase="peel", back="inspected"),
    "screw_regripped": partial(_screw, back="regripped"),
    "screw_lifted": partial(_screw, back="lifted"),
    "screw_light": partial(_screw, push_n=(3.0, 5.0)),
}


class StrokeTask(SeededCase):
    """A demonstration of one task of `STROKE_TASKS`."""

    def load(self) -> tuple[Recording, Truth]:
        """Simulate the recording and its truth."""
        task = TaskComposition(self.rng)
        STROKE_TASKS[self.kind](task)
        return task.finished(self.name, self.kind)

"""Tasks in contact and turns, by published laws of hand motion, with their truth; without robot and teacher.

No parameter of a model was chosen on them. Their parts are in `task_composition.py`. Kinds of task:

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
from scipy.spatial.transform import Rotation

from caesura_lab.evaluation.cases.free_movements import STEP_S, overlapping
from caesura_lab.evaluation.cases.seeded_case import SeededCase
from caesura_lab.evaluation.cases.task_composition import UP, TaskComposition, shares
from caesura_lab.ground_truth import Truth
from caesura_lab.teacher.motion_profiles import minimum_jerk
from caesura_protocol.recording import Recording


def _press(task: TaskComposition) -> None:
    task.rest(0.8, 1.5)
    for _ in range(task.rng.integers(2, 5)):
        task.move(task.between(0.08, 0.25) * task.level(), task.between(0.8, 1.6))
        task.rest(0.3, 0.8)
        height_m = task.between(0.03, 0.08)
        task.descend(height_m, task.between(0.6, 1.1))
        _press_and_leave(task, task.between(5.0, 25.0), height_m)


def _probe(task: TaskComposition) -> None:
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


def _press_and_leave(task: TaskComposition, mean_n: float, height_m: float) -> None:
    """Press, move up again, and rest."""
    task.mark("contact_on")
    task.hold(task.between(0.4, 1.5), mean_n, task.between(0.06, 0.25), task.between(0.08, 0.25))
    task.mark("contact_off")
    task.move(height_m * UP, task.between(0.5, 1.0), ("stop",))
    task.rest(0.4, 1.0)


def _wipe(task: TaskComposition) -> None:
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


def _peel(task: TaskComposition) -> None:
    task.reach()
    ahead, size, mean_n = task.level(), task.between(0.07, 0.16), task.between(6.0, 14.0)
    for stroke in range(task.rng.integers(3, 7)):
        if stroke:
            share = minimum_jerk(shares(task.between(0.7, 1.2)))[:, None]
            back = 0.01 * np.cross(ahead, UP) - size * ahead
            task.add("motion", share * back + 0.05 * np.sin(np.pi * share) * UP)
        seconds = np.array([task.between(0.8, 1.6)])
        task.slide(overlapping(size * task.between(0.9, 1.1) * ahead[None], seconds, np.zeros(1)), mean_n)
    task.retract("peel")


def _circle(task: TaskComposition) -> None:
    task.reach()
    turns, period_s = task.between(2.0, 4.0), task.between(1.2, 2.5)
    share = shares(turns * period_s)
    phase = np.cumsum(np.clip(2.0 * turns * period_s * np.minimum(share, 1.0 - share), 0.0, 1.0))
    phase *= 2.0 * np.pi * turns / phase[-1]
    circles = np.column_stack([np.cos(phase) - 1.0, np.sin(phase), np.zeros(len(phase))])
    task.slide(task.between(0.03, 0.08) * circles, task.between(6.0, 20.0))
    task.retract("circle")


def _contour(task: TaskComposition) -> None:
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


def _land(task: TaskComposition) -> None:
    task.rest(0.8, 1.5)
    for _ in range(task.rng.integers(1, 3)):
        way, height_m = task.between(0.15, 0.3) * task.level(), task.between(0.03, 0.06)
        seconds, falls = task.between(1.4, 2.6), task.between(0.25, 0.4)
        share = shares(seconds)
        down = minimum_jerk(np.clip(share / falls, 0.0, 1.0))
        path = minimum_jerk(share)[:, None] * way - height_m * down[:, None] * UP
        touch = round(0.95 * falls * len(path))
        begun = task.add("motion", path[:touch])
        task.edges(begun, seconds, ("start",))
        task.slide(path[touch:] - path[touch - 1], task.between(6.0, 20.0))
        task.move(height_m * UP - 0.9 * way, task.between(1.0, 1.6), ("stop",))
        task.rest(0.5, 1.0)


def _press_and_slide(task: TaskComposition) -> None:
    task.reach()
    mean_n, seconds = task.between(6.0, 20.0), task.between(1.0, 2.0)
    task.mark("contact_on")
    task.hold(task.between(0.6, 1.2), mean_n, on_s=task.between(0.08, 0.25))
    path = task.between(0.06, 0.2) * minimum_jerk(shares(seconds))[:, None] * task.level()
    begun = task.add("sliding", path, task.push(len(path), mean_n, 0.0, 0.0))
    task.edges(begun, seconds, ("start", "stop"))
    task.hold(task.between(0.6, 1.2), mean_n, off_s=task.between(0.1, 0.2))
    task.mark("contact_off")
    task.retract("press and slide")


def _screw(task: TaskComposition) -> None:
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


def _key(task: TaskComposition) -> None:
    task.reach()
    task.mark("contact_on")
    push_n = task.between(8.0, 20.0)
    task.hold(task.between(0.5, 0.9), push_n, on_s=task.between(0.08, 0.2))
    quarter = float(task.rng.choice([-0.5, 0.5])) * np.pi
    task.turn(UP, quarter, task.between(0.8, 1.5), push_n=push_n, torque_nm=task.between(0.5, 2.0))
    task.hold(task.between(0.5, 0.9), push_n, off_s=0.15)
    task.mark("contact_off")
    task.retract("key")


def _pour(task: TaskComposition) -> None:
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


def _aim(task: TaskComposition) -> None:
    task.rest(0.8, 1.5)
    seconds, way = task.between(1.2, 1.8), task.between(0.15, 0.3) * task.level()
    share = minimum_jerk(shares(seconds))[:, None]
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


TASKS: Mapping[str, Callable[[TaskComposition], None]] = {
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
        task = TaskComposition(self.rng)
        TASKS[self.kind](task)
        return task.finished(self.name, self.kind)

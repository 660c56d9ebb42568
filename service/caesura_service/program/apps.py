"""From segments and gripper events to apps. Rules: thesis 4.2.5.

- A motion becomes Cartesian Motion, or Move To Contact where contact follows.
- A contact becomes Apply Force, its vector scaled to the limit; where the gripper grasps or lets go
  during it, Grasp or Gripper Move takes its place. Sliding applies its force on the way to a target.
- A transport becomes Transport with the average load of the whole carry, weighted by time; Hold likewise.
- Rests, force decays, and segments below the minimum time are left out. A gripper event outside any
  contact is an app of its own.
- What was not observed makes an app less sure (`gaps`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np

from caesura_protocol.messages import App, AppKind, Gap, Joints, Quaternion, Segment, Vector
from caesura_service.program.gaps import observed_share

FORCE_LIMIT_N = 10.0
LEAST_CONTACT_N = 1.0  # the thesis' threshold between contact and free space
GRIP_SLACK_S = 0.3  # a grip this close to a contact belongs to it
GRAVITY = 9.81
HANGING_N, HANGING_ASIDE, HANGING_SD_N = 1.5, 0.6, 1.0  # a load's weight, what is aside of it, its error
ARRIVES_M = 0.05  # nothing is pressed in so far: a movement that ends in a press without a pause
ACROSS_M, ACROSS_SHARE = 0.015, 1.0  # a stroke along a surface is longer than this, and pushes nothing in
OBSERVED_S, TOUCHED_S = 0.1, 0.05  # from one observation to the next; from a boundary, which lies midway
PUSHES_BACK_N = 3.0  # what is touched; below it is what a sensor makes up
STILL_PRESSED = 0.7  # of a force: who presses less is letting go
DECAY_REACH_M = 0.02  # a movement shorter than this, out of a contact, is the contact letting go

GRIP_APPS: dict[str, AppKind] = {
    "grasp": "grasp",
    "release": "gripper_move",
    "open": "gripper_move",
    "close": "gripper_move",
}


@dataclass(frozen=True)
class Moment:
    """The robot at one time, base frame."""

    position: Vector  # [m]
    orientation: Quaternion | None  # x y z w
    joints: Joints | None  # [rad]
    gripper_width: float | None  # [m]
    force: Vector | None = None  # [N] on the robot


@dataclass(frozen=True)
class Grip:
    """A gripper event."""

    t: float  # [s]
    kind: Literal["grasp", "release", "open", "close"]
    width: float | None  # [m] where the fingers settled


@dataclass(frozen=True, slots=True)
class Step:
    """A segment as the program sees it."""

    index: int
    segment: Segment
    confidence: float

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return self.segment.tn - self.segment.t0


MomentAt = Callable[[float], Moment]


def task_program(
    steps: Sequence[Step],
    grips: Sequence[Grip],
    moment_at: MomentAt,
    *,
    least_s: float = 0.3,
    force_limit_n: float = FORCE_LIMIT_N,
    gaps: Sequence[Gap] = (),
) -> tuple[App, ...]:
    """The apps of a demonstration, in time order.

    least_s: minimum time filter [s]; moment_at: the robot at a time [s]; forces are scaled to
    force_limit_n [N]; gaps: in time order.
    """
    kept = [step for step in steps if step.seconds >= least_s]
    kept = [step for before, step in zip([None, *kept], kept, strict=False) if not _lets_go(before, step)]
    kept = [_leaving(_hanging(step)) for step in kept]
    groups = [list(group) for _, group in groupby(kept, key=_group_key)]
    rest = list(grips)
    apps: list[App] = []
    for number, group in enumerate(groups):
        following = groups[number + 1][0].segment if number + 1 < len(groups) else None
        build = _BUILDERS.get(_group_key(group[0]))
        if build is not None:
            apps += build(_Group(group, following, rest, moment_at, force_limit_n))
    apps += [_grip_app(grip, grip.t, grip.t, moment_at, 1.0, ()) for grip in rest]
    return tuple(_as_observed(app, gaps) for app in sorted(apps, key=lambda app: app.t0))


def _as_observed(app: App, gaps: Sequence[Gap]) -> App:
    """As sure as it can be with what is missing of it."""
    share = observed_share(app.t0, app.tn, gaps)
    return app if share == 1.0 else app.model_copy(update={"confidence": app.confidence * share})


@dataclass(frozen=True)
class _Group:
    """Consecutive segments that make up one thing, and what is needed to build its apps."""

    steps: list[Step]
    following: Segment | None
    grips: list[Grip]  # not yet used; those that belong to a contact are taken out
    moment_at: MomentAt
    force_limit_n: float

    def app(self, kind: AppKind, steps: Sequence[Step], **changes: object) -> App:
        """An app over some of the steps that ends where they end."""
        first, last = steps[0].segment, steps[-1].segment
        moment = self.moment_at(last.tn)
        fields: dict[str, object] = {
            "kind": kind,
            "t0": first.t0,
            "tn": last.tn,
            "target": last.position_end,
            "orientation": moment.orientation,
            "joints": moment.joints,
            "force": None,
            "force_taught": None,
            "load_kg": None,
            "load_sd_kg": None,
            "gripper_width": None,
            "confidence": min(step.confidence for step in steps),
            "segments": tuple(step.index for step in steps),
        }
        return App.model_validate(fields | changes)

    def touch(self) -> dict[str, object]:
        """Where the contact that follows was made."""
        begin, following = self.steps[-1].segment.tn, self.following
        return {} if following is None else self.touched(begin, following.tn, following.force)

    def touched(self, begin: float, end: float, force: Vector) -> dict[str, object]:
        """Where what pushes back with a force [N] in the end did so first between two boundaries [s].

        What a sensor drifts by before does not count; where nothing pushes back, at the first observation.
        """
        least = _along(self.moment_at(begin - TOUCHED_S).force, force) + PUSHES_BACK_N
        times = _observed(begin, end)
        pushing = (m for m in map(self.moment_at, times) if _along(m.force, force) >= least)
        return _where(next(pushing, None) or self.moment_at(times[0]))

    def pressed(self, force: Vector) -> dict[str, object]:
        """Where it was pressed last with most of a force [N]: the segment's end may lie in the letting go."""
        times = _observed(self.steps[0].segment.t0, self.steps[-1].segment.tn)
        least = STILL_PRESSED * _length(force)
        moments = map(self.moment_at, reversed(times))
        held = (m for m in moments if m.force is not None and _along(m.force, force) >= least)
        moment = next(held, None)
        return {} if moment is None else _where(moment)


def _motions(group: _Group) -> Iterable[App]:
    """One app a movement; the last one is stopped by the contact that follows."""
    touches = group.following is not None and group.following.contact == "contact"
    for step in group.steps:
        if touches and step is group.steps[-1]:
            yield group.app("move_to_contact", [step], **group.touch())
        else:
            yield group.app("cartesian_motion", [step])


def _contacts(group: _Group) -> Iterable[App]:
    """What the gripper does during the contact, or else the force."""
    t0, tn = group.steps[0].segment.t0, group.steps[-1].segment.tn
    mine = [grip for grip in group.grips if t0 - GRIP_SLACK_S <= grip.t <= tn + GRIP_SLACK_S]
    for grip in mine:
        group.grips.remove(grip)
        confidence = min(step.confidence for step in group.steps)
        yield _grip_app(grip, t0, tn, group.moment_at, confidence, [step.index for step in group.steps])
    first = group.steps[0]
    if first.segment.kind == "sliding" and _pushed_in(first.segment) > ARRIVES_M and not mine:
        where = group.touched(first.segment.t0, first.segment.tn, first.segment.force)
        yield group.app("move_to_contact", [first], **where)
    held = [step for step in group.steps if step.segment.kind == "contact"] or group.steps
    taught = max((step.segment.force for step in held), key=_length)
    if not mine and _length(taught) >= LEAST_CONTACT_N:
        forces = _forces(taught, group.force_limit_n)
        yield group.app("apply_force", group.steps, **forces, **group.pressed(taught))


def _slides(group: _Group) -> Iterable[App]:
    """One app a stroke, with its own target."""
    for step in group.steps:
        yield group.app("apply_force", [step], **_forces(step.segment.force, group.force_limit_n))


def _carries(group: _Group) -> Iterable[App]:
    """One app a stretch, all with the average load of the whole carry."""
    weighed = [step for step in group.steps if step.segment.load_kg is not None]
    load: dict[str, object] = {}
    if weighed:
        load = {
            "load_kg": _average(weighed, lambda segment: segment.load_kg or 0.0),
            "load_sd_kg": _average(weighed, lambda segment: segment.load_sd_kg or 0.0),
        }
    sets_down = group.following is not None and group.following.contact == "contact"
    for step in group.steps:
        where = group.touch() if sets_down and step is group.steps[-1] else {}
        yield group.app("transport" if step.segment.kind == "transport" else "hold", [step], **load, **where)


_BUILDERS: dict[str, Callable[[_Group], Iterable[App]]] = {
    "motion": _motions,
    "contact": _contacts,
    "sliding": _slides,
    "transport": _carries,
    "hold": _carries,
}


def _average(steps: Sequence[Step], value: Callable[[Segment], float]) -> float:
    """Of a number of segments, weighted by time."""
    return sum(step.seconds * value(step.segment) for step in steps) / sum(step.seconds for step in steps)


def _group_key(step: Step) -> str:
    """Transport and hold are one carry; pushing in what gives way is part of the press."""
    kind = step.segment.kind
    if kind == "sliding" and _gives_way(step.segment):
        return "contact"
    return "transport" if kind == "hold" else kind


def _observed(begin: float, end: float) -> list[float]:
    """[s] Every observation between two boundaries, one at least."""
    count = max(round((end - begin) / OBSERVED_S), 1)
    return [begin + TOUCHED_S + k * OBSERVED_S for k in range(count)]


def _where(moment: Moment) -> dict[str, object]:
    return {"target": moment.position, "orientation": moment.orientation, "joints": moment.joints}


def _along(force: Vector | None, direction: Vector) -> float:
    """[N] of a force in a direction; 0 where it is not known."""
    if force is None:
        return 0.0
    return sum(a * b for a, b in zip(force, direction, strict=True)) / max(_length(direction), 1e-12)


def _pushed_in(segment: Segment) -> float:
    """[m] by which it goes against the force that acts on the robot."""
    moved = np.subtract(segment.position_end, segment.position_start)
    return -float(moved @ np.asarray(segment.force)) / max(_length(segment.force), 1e-12)


def _gives_way(segment: Segment) -> bool:
    """Does what is touched move with the force, a pump or a button, rather than the hand along a surface?"""
    moved = np.subtract(segment.position_end, segment.position_start)
    along = np.asarray(segment.force) / max(_length(segment.force), 1e-12)
    across = _length(moved - along * float(along @ moved))
    return across < max(ACROSS_M, ACROSS_SHARE * abs(_pushed_in(segment)))


def _hanging(step: Step) -> Step:
    """A movement under a force that hangs on the robot is a carry, whatever it was taken for.

    What a hand slides along pushes back; only a load pulls straight down.
    """
    segment = step.segment
    down, aside = -segment.force[2], _length(segment.force[:2])
    if segment.kind != "sliding" or down < HANGING_N or aside > HANGING_ASIDE * down:
        return step
    load = {"load_kg": down / GRAVITY, "load_sd_kg": HANGING_SD_N / GRAVITY}
    carried = {"kind": "transport", "contact": "transport", **load}
    return replace(step, segment=segment.model_copy(update=carried))


def _leaving(step: Step) -> Step:
    """A movement far out of what was pressed goes on in the air: it is no press."""
    segment = step.segment
    if segment.kind != "sliding" or not _gives_way(segment) or -_pushed_in(segment) < ARRIVES_M:
        return step
    return replace(step, segment=segment.model_copy(update={"kind": "motion", "contact": "free"}))


def _lets_go(before: Step | None, step: Step) -> bool:
    """Is this the force of the contact before it, decaying? The arm hardly moves, the force falls off."""
    if before is None or before.segment.kind != "contact" or step.segment.kind != "motion":
        return False
    segment = step.segment
    moved = _length(np.subtract(segment.position_end, segment.position_start))
    return moved < DECAY_REACH_M and _length(segment.force_end) < _length(segment.force_start)


def _grip_app(
    grip: Grip, t0: float, tn: float, moment_at: MomentAt, confidence: float, segments: Sequence[int]
) -> App:
    moment = moment_at(grip.t)
    return App(
        kind=GRIP_APPS[grip.kind],
        t0=t0,
        tn=tn,
        target=moment.position,
        orientation=moment.orientation,
        joints=moment.joints,
        force=None,
        force_taught=None,
        load_kg=None,
        load_sd_kg=None,
        gripper_width=moment.gripper_width if grip.width is None else grip.width,
        confidence=confidence,
        segments=tuple(segments),
    )


def _forces(on_robot: Vector, limit_n: float) -> dict[str, object]:
    """What the robot exerts: the opposite of what acts on it, scaled to the limit."""
    taught = -np.asarray(on_robot)
    scale = min(1.0, limit_n / max(_length(taught), 1e-12))
    return {"force": tuple((scale * taught).tolist()), "force_taught": tuple(taught.tolist())}


def _length(vector: Sequence[float] | np.ndarray) -> float:
    return math.hypot(*vector)

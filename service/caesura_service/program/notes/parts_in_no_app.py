"""Parts of a demonstration that are in no app: motion at both of its ends, detours, and touches.

Motion from one app to the next is found from their paths (`caesura_protocol.programs.checks.fidelity`).
Motion before the first app and after the last one, a way out and back between two paths, and a contact that
is too short for an app, are not. So a note of the program states them, and whether the demonstration began or
ended while the flange moved.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_contacts import ends_in_contact, is_resisted
from caesura_protocol.app_force_limit import exerted_forces
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Segment, Vector
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.programs.checks.fidelity import (
    STEPPED_M,
    STRAYED_M,
    STRAYED_RAD,
    UNEVEN_SHARE,
    has_turned,
)
from caesura_protocol.programs.program_gripper import GRIPS
from caesura_protocol.rotations import align_signs, angle_between
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY, REST_M_PER_S
from caesura_service.program.interpretation.carried_loads import hangs
from caesura_service.program.notes.largest_parts import largest_parts
from caesura_service.program.program_segment import OBSERVED_S, PUSHES_BACK_N, Moment, MomentAt, length

WIGGLED = 10  # steps between observations, one second
NAMED = 5  # touches in a note, the strongest ones, and detours, the widest ones
Array = NDArray[np.float64]

IN_NO_APP = "Taught and in no app: "
BEGINS_MOVING = "The recording begins in motion: the way to the start of the program was not recorded."
ENDS_MOVING = "The recording ends in motion: the program stops at the last recorded pose."


def parts_in_no_app_note(
    segments: Sequence[Segment],
    apps: Sequence[App],
    moment_at: MomentAt,
    up: Vector = UP,
    others: Iterable[str] = (),
) -> str | None:
    """Return a note on the parts of a finished demonstration in no app.

    None if there are none, or none are known. apps: as they were inferred, in time order; up: away from
    gravity, base frame; others: texts on other parts, as of `detours`.
    """
    if not segments or not apps:
        return None
    said = [*_at_the_ends(segments, apps, moment_at), *_touches(segments, apps, up), *others]
    return f"{IN_NO_APP}{'; '.join(said)}. Teach it again where the robot is to do it." if said else None


def _at_the_ends(segments: Sequence[Segment], apps: Sequence[App], moment_at: MomentAt) -> Iterator[str]:
    first, last = apps[0], apps[-1]
    began, begins = segments[0].t0, first.t0 if first.path is None else first.path.start.t
    if moved := _moved(moment_at(began), moment_at(begins)):
        path = "" if first.path is None else "the path of "
        yield f"{moved} at {interval(began, begins, 1)} s, before {path}the first app"
    until = last.tn if last.path is None else last.path.tn
    ended, there = segments[-1].tn, moment_at(until)
    reached = there if last.target is None else Moment(last.target, last.orientation, None, None)
    if moved := _moved(reached, moment_at(ended)):
        path = "" if last.path is None else "the path of "
        yield f"{moved} at {interval(min(until, ended), ended, 1)} s, after {path}the last app"


def _moved(one: Moment, other: Moment) -> str:
    """Return how far a flange moves and turns, as text; empty below the drift of a hand at rest."""
    metres, turned = math.dist(one.position, other.position), 0.0
    if one.orientation is not None and other.orientation is not None:
        turned = angle_between(one.orientation, other.orientation)
    parts = [f"{fixed(1000 * metres, 0)} mm"] if metres > STEPPED_M else []
    parts += [f"{_degrees(turned)}°"] if has_turned(turned) else []
    return " and ".join(parts)


def _degrees(radians: float) -> str:
    return fixed(math.degrees(radians), 1)


class _Detour(NamedTuple):
    """Observations off the straight way between two poses, furthest off by so much."""

    began: float  # [s]
    ended: float  # [s]
    off_m: float
    off_rad: float
    wiggles: bool = False  # so often to and fro that it counts, however small it is

    @property
    def size(self) -> float:
        return max(self.off_m / STRAYED_M, self.off_rad / STRAYED_RAD)

    @property
    def text(self) -> str:
        if self.wiggles:
            return f"{fixed(1000 * self.off_m, 1)} mm to and fro at {interval(self.began, self.ended, 1)} s"
        parts = [f"{fixed(1000 * self.off_m, 1)} mm"] if self.off_m > STRAYED_M else []
        parts += [f"{_degrees(self.off_rad)}°"] if self.off_rad > STRAYED_RAD else []
        return (
            f"{' and '.join(parts)} off the straight line and back at {interval(self.began, self.ended, 1)} s"
        )


def detours(apps: Iterable[App], times: Array, poses: Array) -> Iterator[str]:
    """Yield text on where the hand left the straight way and came back, while no app has a path.

    There the robot stands, goes straight to the next path, or pushes straight to its target.

    apps: as they were inferred, in time order; times: (n,) [s] of all observations; poses: (n, 7) of the
    flange, orientations nan where unknown.
    """
    found: list[_Detour] = []
    for t0, tn, pushes in _parts_without_path(apps, float(times[0]), float(times[-1])):
        part = _between(t0, tn, times, poses)
        found += [*_detours_in(*part, turns_only=pushes)] or _wiggle_in(*part)
    yield from largest_parts(found, lambda one: one.size, lambda one: one.text, NAMED, "lesser detours")


def _parts_without_path(
    apps: Iterable[App], began: float, ended: float
) -> Iterator[tuple[float, float, bool]]:
    """Yield the times [s] between which no app has a path, and whether an app pushes straight meanwhile."""
    t = began
    for app in apps:
        pushes = app.off_straight_m is not None
        if app.path is not None or pushes:
            begins, ends = (app.t0, app.tn) if app.path is None else (app.path.start.t, app.path.tn)
            yield t, begins, False
            if pushes:
                yield begins, ends, True
            t = max(t, ends)
    yield t, ended, False


def _between(t0: float, tn: float, times: Array, poses: Array) -> tuple[Array, Array]:
    """Return the times and poses of the observations from one time [s] to another."""
    half = 0.5 * OBSERVED_S
    part = slice(np.searchsorted(times, t0 - half), np.searchsorted(times, tn + half))
    return times[part], poses[part]


def _detours_in(times: Array, poses: Array, *, turns_only: bool) -> Iterator[_Detour]:
    """Yield the detours from the straight way between the first and the last pose.

    turns_only: without those of the position.
    """
    if len(times) < 3:
        return
    off_rad = np.nan_to_num(_off_turn(poses[:, 3:]))
    off_m = np.linalg.norm(off_line(poses[:, :3]), axis=1) * (not turns_only)
    away = np.round(off_m, 4) > STRAYED_M
    away |= np.round(np.degrees(off_rad), 1) > math.degrees(STRAYED_RAD)
    edges = np.flatnonzero(np.diff(away.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    for low, high in edges.tolist():
        off = float(off_m[low:high].max()), float(off_rad[low:high].max())
        yield _Detour(float(times[low]), float(times[high - 1]), *off)


def _wiggle_in(times: Array, poses: Array) -> list[_Detour]:
    """Return the movement to and fro about the straight way, in a list; an empty one without it.

    It is within `STRAYED_M` of the way, and no rest: for `WIGGLED` steps in all it is faster than one.
    """
    if len(times) <= WIGGLED:
        return []
    off = off_line(poses[:, :3])
    off_m = float(np.linalg.norm(off, axis=1).max())
    fast = np.linalg.norm(np.diff(off, axis=0), axis=1) > REST_M_PER_S * np.diff(times)
    if off_m > STRAYED_M or np.count_nonzero(fast) < WIGGLED:
        return []
    seen = times[np.flatnonzero(fast)]
    return [_Detour(float(seen[0]), float(seen[-1]), off_m, 0.0, wiggles=True)]


def off_line(points: Array) -> Array:
    """Return the vectors (n, c) to points (n, c) from their nearest places between the first and the last."""
    away, step = points - points[0], points[-1] - points[0]
    share = np.clip(away @ step / max(float(step @ step), 1e-18), 0.0, 1.0)
    off: Array = away - share[:, None] * step
    return off


def _off_turn(quaternions: Array) -> Array:
    """Return the angles (n,) [rad] of quaternions (n, 4) from the turn between the first and the last one."""
    turned = quaternions.copy()
    align_signs(turned)
    nearest = turned - off_line(turned)
    cosine = np.vecdot(turned, nearest) / np.linalg.norm(nearest, axis=1)
    angles: Array = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    return angles


def _touches(segments: Sequence[Segment], apps: Sequence[App], up: Vector) -> Iterator[str]:
    """Yield contacts in no app.

    Those that continue an app in contact or lie in one are left out, and so are bounces before it, unless
    they are stronger. The weight of what was grasped and is carried meanwhile, directly before or after is
    left out, too.
    """
    segments = tuple(segments)  # stored ones are decoded once
    pressed = [_pressed_n(app, segments) for app in apps]
    inside: dict[int, float] = {}
    for app, newton in zip(apps, pressed, strict=True):
        inside |= {index: max(newton, inside.get(index, 0.0)) for index in app.segments}
    touching = [app for app in apps if APP_KINDS[app.kind].in_contact or is_resisted(app)]
    in_contact = {index for app in touching for index in app.segments}
    weights, carries = _weights(apps), [app for app in apps if APP_KINDS[app.kind].carries]
    met = [
        (one.t0, two.t0, newton)
        for (one, two), newton in zip(pairwise(apps), pressed[1:], strict=True)
        if ends_in_contact(one, two)
    ]
    lost: list[list[Segment]] = []
    place = 0
    for touches, run in groupby(segments, key=lambda one: one.contact == "contact"):
        numbered = list(enumerate(run, place))
        steps = [step for index, step in numbered if index not in inside]
        end = place + len(numbered)
        if touches and steps:
            t0, tn = steps[0].t0, steps[-1].tn
            beside = [inside[index] for index in {place - 1, end} & in_contact]
            beside += [inside[index] for index, _ in numbered if index in inside]
            beside += [newton for begins, ends, newton in met if begins < t0 and tn <= ends]
            carried = (app for app in carries if app.t0 <= t0 and tn <= app.tn)
            around = {place - 1, end, *(index for app in carried for index in app.segments)}
            weight_n = max(weights.get(index, 0.0) for index in around)
            if _is_other(_newtons(steps), max(beside, default=0.0)) and not _is_weight(steps, weight_n, up):
                lost.append(steps)
        place = end
    yield from largest_parts(lost, _newtons, _contact_in_words, NAMED, "weaker contacts")


def _contact_in_words(steps: Sequence[Segment]) -> str:
    """Return text on the consecutive segments of a contact."""
    when = interval(steps[0].t0, steps[-1].tn, 1)
    return f"a contact of {fixed(_newtons(steps), 1)} N at {when} s"


def _pressed_n(app: App, segments: Sequence[Segment]) -> float:
    """Return the largest force [N] with which an app was taught to press; infinite for one without a force.

    The forces of its segments have the bias of the sensor, as those of other contacts have.
    """
    if app.force is None and not is_resisted(app):
        return math.inf
    felt = [length(segments[index].force) for index in app.segments]
    return max([*(one.newton_taught for one in exerted_forces(app)), *felt])


def _is_other(newton: float, pressed_n: float) -> bool:
    """Whether a force [N] is another one than that of the app that it continues; 0: of none."""
    return newton > max((1.0 + UNEVEN_SHARE) * pressed_n, pressed_n + PUSHES_BACK_N if pressed_n else 0.0)


def _weights(apps: Sequence[App]) -> dict[int, float]:
    """Return the weights [N] of what was grasped and is carried, by the indices of the segments."""
    weights: dict[int, float] = {}
    grasped = False
    for app in apps:
        grasped = app.kind == "grasp" if app.kind in GRIPS else grasped
        if grasped and APP_KINDS[app.kind].carries and app.load_kg is not None:
            weights |= dict.fromkeys(app.segments, app.load_kg * GRAVITY)
    return weights


def _is_weight(steps: Sequence[Segment], weight_n: float, up: Vector) -> bool:
    """Whether a contact is only the weight [N] of what is carried beside it, as it is lifted or let go."""
    most_n = weight_n + PUSHES_BACK_N
    return weight_n > 0.0 and _newtons(steps) < most_n and all(hangs(step.force, up) for step in steps)


def _newtons(steps: Sequence[Segment]) -> float:
    return max(length(step.force) for step in steps)

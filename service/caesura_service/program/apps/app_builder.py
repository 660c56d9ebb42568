"""Builds apps from segments and gripper events. Rules: thesis 4.2.5.

- A motion becomes Cartesian Motion, or Move To Contact where contact follows, at once or after a rest.
- A contact becomes Apply Force, its vector scaled to the limit; where the gripper grasps or lets go
  during it, Grasp or Gripper Move takes its place. Sliding applies its force on the way to a target.
- A transport becomes Transport with the average load of the whole carry, weighted by time; Hold likewise.
  Where the load changes, each part has its own.
- A turn in place is a motion, a sliding or a transport, by what the tool touches. Its app carries the axis,
  the advance and the torque that the robot exerts.
- Rests are left out, and what `segment_interpretation` leaves out; but a turn in a rest is a Cartesian
  Motion. A gripper event outside any contact is an app of its own.
- An app that moves has the path from its start to its target (`paths`).
- A gap lowers the confidence of an app (`gaps`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, pairwise, takewhile
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_force_limit import LEAST_PRESS_N
from caesura_protocol.app_kinds import AppKind
from caesura_protocol.messages import App, Gap, RestForce, Vector
from caesura_protocol.programs.checks.fidelity import SWAYED_M
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY
from caesura_service.program.apps.app_group import AppEnd, AppGroup, group_key, pose_fields
from caesura_service.program.apps.end_velocities import with_end_velocities
from caesura_service.program.apps.paths import Paths
from caesura_service.program.forces.held_forces import (
    force_aside,
    force_aslant,
    forces_felt,
    impact,
    last_pressed,
    other_force_n,
    slackened_force,
    stronger_force,
    weaker_force,
)
from caesura_service.program.forces.held_levels import divided_at_levels
from caesura_service.program.forces.stroke_forces import rest_force_n, stroke_aslant, stroke_force
from caesura_service.program.gaps import observed_share
from caesura_service.program.interpretation.carried_loads import has_other_load, weighed_steps
from caesura_service.program.interpretation.joined_strokes import (
    INSERTED_M,
    NOWHERE_M,
)
from caesura_service.program.interpretation.segment_interpretation import kept_steps
from caesura_service.program.program_segment import (
    GRIP_SLACK_S,
    OBSERVED_S,
    PUSHES_BACK_N,
    TOUCHED_S,
    GripperAction,
    MomentAt,
    ProgramSegment,
    average,
    direction,
    divided_at,
    length,
    observed,
)

LEAST_CONTACT_N = 1.0  # the thesis' threshold between contact and free space
MOST_ACTING = 15  # observations in which fingers act: a Panda's close within six
FINGERS_MOVE_M = 0.001  # from one observation to the next
AT_REST: Mapping[str, float] = MappingProxyType(  # a hand that grips at rest sways by less
    {"moved_m_per_s": 0.03, "turned_rad_per_s": math.radians(10.0)}
)

GRIP_APPS: dict[str, AppKind] = {
    "grasp": "grasp",
    "release": "gripper_move",
    "open": "gripper_move",
    "close": "gripper_move",
}


def task_program(
    steps: Sequence[ProgramSegment],
    grips: Sequence[GripperAction],
    moment_at: MomentAt,
    *,
    least_s: float = 0.3,
    force_limit_n: float | None = None,
    paths: Paths | None = None,
    gaps: Sequence[Gap] = (),
    known: Sequence[GripperAction] | None = None,
    app_before: App | None = None,
    up: Vector = UP,
) -> tuple[App, ...]:
    """Return the apps of a demonstration, in time order.

    least_s: minimum time filter [s]; moment_at: returns the robot's state at a time [s]; force_limit_n: limit
    [N] to which forces are scaled, or None; paths: of the demonstration, or None for apps without paths;
    gaps: in time order; known: every gripper action, if `grips` are only those of these steps; app_before:
    the last app of earlier steps; up: away from gravity, base frame.
    """
    kept = kept_steps(steps, grips if known is None else known, moment_at, least_s, up)
    groups = [list(group) for _, group in groupby(kept, key=group_key)]
    rest = list(grips)
    apps: list[App] = []
    for number, group in enumerate(groups):
        build = _BUILDERS.get(group_key(group[0]))
        if build is not None:
            before = groups[number - 1][-1] if number else None
            after = groups[number + 1 : number + 3]
            apps += build(AppGroup(group, before, after, rest, moment_at, force_limit_n, paths))
    times = [_acts_at(grip.t, apps) for grip in rest]
    apps += [_grip_app(grip, t, t, moment_at, paths, 1.0, ()) for grip, t in zip(rest, times, strict=True)]
    apps = [_as_observed(app, gaps) for app in sorted(apps, key=_when)]
    return tuple(apps) if paths is None else with_end_velocities(apps, paths, app_before)


def _acts_at(t: float, apps: Iterable[App]) -> float:
    """Return the time [s] of fingers that act at `t`: in the first `GRIP_SLACK_S` of a movement, its start.

    A robot would make the whole movement first, and let go of an object at its end. It lets go after a hold.
    """
    moves = (app for app in apps if app.kind != "hold")
    return next((app.t0 for app in moves if app.t0 < t < min(app.t0 + GRIP_SLACK_S, app.tn)), t)


def _when(app: App) -> tuple[float, float]:
    """Return the sort key of an app: a grasp goes before the hold that begins with it."""
    return app.t0, app.tn


def _as_observed(app: App, gaps: Sequence[Gap]) -> App:
    """Return an app with its confidence times the share of its time that was observed."""
    share = observed_share(app.t0, app.tn, gaps)
    return app if share == 1.0 else app.model_copy(update={"confidence": app.confidence * share})


def _motions(group: AppGroup) -> Iterable[App]:
    """Yield one app per movement; the last one ends at the contact that follows.

    One against a resistance has the force that was taught, which it does not exert.
    """
    touches = _meets(group)
    for step in group.steps:
        if step.is_resisted:
            yield group.moving("cartesian_motion", step, changes=_taught(step))
        elif touches and step is group.steps[-1]:
            yield group.moving("move_to_contact", step, group.touch())
        elif step.segment.kind == "turning" and (end := group.rest(step)) is not None:
            yield group.moving("cartesian_motion", step, end, {"tn": end.t})
        else:
            yield group.moving("cartesian_motion", step)


def _turns(group: AppGroup) -> Iterable[App]:
    """Yield the apps of rests: a turn in a rest, and the way to a press after the fingers moved.

    Every other rest has no app.
    """
    for step in group.steps:
        turning = group.paths and group.paths.turning(step.segment.t0, step.segment.tn)
        if group.paths and turning:
            t0, tn = turning
            where = pose_fields(group.moment_at(tn))
            path = group.paths.between(t0, tn)
            yield group.app("cartesian_motion", [step], t0=t0, tn=tn, path=path, **where)
    if (moved := group.fingers_moved()) is not None:
        rest, end = group.steps[-1], group.touched(group.after[0][0])
        path = None if group.paths is None else group.paths.between(moved, end.t)
        yield group.app("move_to_contact", [rest], t0=moved, tn=rest.segment.tn, path=path, **end.where)


def _contacts(group: AppGroup) -> Iterable[App]:
    """Yield one app per grip in a contact, or else a press of at least `LEAST_CONTACT_N`.

    What pushes a peg in before the first grip is a press of its own. Without a grip, the approach in
    a first step is a Move To Contact; no press follows it where a stroke goes on at once.
    """
    inserted, rest = _inserted(group)
    if inserted:
        yield _press(replace(group, steps=inserted), inserted[0].t0)
        if not rest:
            return
        group = replace(group, steps=rest)
    t0, tn = group.steps[0].segment.t0, group.steps[-1].segment.tn
    hardest = _hardest(group.steps)
    mine = [grip for grip in group.grips if grip.is_near(t0, tn)]
    for grip, (begun, ended) in zip(mine, _shares(mine, t0, tn), strict=True):
        group.grips.remove(grip)
        confidence, indices = min(step.confidence for step in group.steps), [one.index for one in group.steps]
        gripping = _grip_app(grip, begun, ended, group.moment_at, group.paths, confidence, indices)
        yield gripping.model_copy(update=_taught(hardest))
    first = group.steps[0]
    begun = first.t0
    if group.is_approached(first) and not mine:
        touch = group.touched(first)
        if group.only_touches:
            yield group.moving("move_to_contact", first, touch)
            return
        begun = touch.t
        yield group.moving("move_to_contact", first, touch, {"tn": begun})
    if not mine and length(hardest.force) >= LEAST_CONTACT_N:
        yield from _presses(group, begun)


def _shares(grips: Sequence[GripperAction], t0: float, tn: float) -> Sequence[tuple[float, float]]:
    """Return the part (begin, end) [s] of a contact's time that each grip in it has.

    An edit refers to an app by its start, so each grip needs a different one.
    """
    if len(grips) < 2:
        return [(t0, tn)] * len(grips)
    between = [0.5 * (grip.t + following.t) for grip, following in pairwise(grips)]
    return list(pairwise([min(t0, grips[0].t), *between, max(tn, grips[-1].t)]))


def _meets(group: AppGroup) -> bool:
    """Whether the group's last movement ends at the contact that follows.

    A contact that includes its approach has a Move To Contact of its own, unless a grip belongs to it. A
    movement against a resistance searches none, because the resistance would end the search.
    """
    contact = group.contact
    if contact is None or group.steps[-1].is_resisted:
        return False
    return not group.is_approached(contact) or any(
        grip.is_near(contact.t0, contact.tn) for grip in group.grips
    )


def _presses(group: AppGroup, begun: float) -> Iterator[App]:
    """Yield a press from `begun` [s] on, or one for each level of force that was held."""
    levels = divided_at_levels(group.steps, _hardest(group.steps).base, begun, group.moment_at)
    for steps in levels:
        yield _press(replace(group, steps=steps), max(begun, steps[0].segment.t0))


def _press(group: AppGroup, begun: float) -> App:
    """Return a press from `begun` [s] on, with the force of the hardest step.

    Its pose is that of the last time with most of the force. It ends before its contact if only an object
    that is held rests there afterwards. It has a path where it turns, or where it sways by more than a press
    that is held; otherwise it states how far it was off the straight line.
    """
    hardest = _hardest(group.steps)
    changes, end = _forces(hardest.force, group.force_limit_n), group.pressed(hardest)
    times = [t for step in group.steps for t in observed(step.segment.t0, step.segment.tn) if t >= begun]
    felt = forces_felt(hardest.base, times, group.moment_at)
    apart_n = other_force_n(length(hardest.force))
    weaker_n = weaker_force(felt, hardest.force, len(times), apart_n)
    changes["weaker_n"] = slackened_force(felt, hardest.force) if weaker_n is None else weaker_n
    changes["stronger_n"] = stronger_force(felt, length(hardest.force))
    changes["impact_n"] = impact(felt, length(hardest.force))
    if (tn := _press_ended(group, times, felt, hardest.force)) is not None:
        changes["tn"] = tn
    turns = False
    if end is not None:
        changes |= end.where
        paths = group.paths
        if paths is not None:
            off_m = paths.off_straight_m(begun, end.t)
            turns = paths.turning(begun, end.t) is not None
            winds = off_m is not None and off_m > SWAYED_M
            changes |= {"path": paths.between(begun, end.t)} if turns or winds else {"off_straight_m": off_m}
    if not turns:
        changes["aslant"] = force_aslant(felt, hardest.force) or force_aside(felt, hardest.force)
    return group.app("apply_force", group.steps, t0=begun, **changes)


def _press_ended(
    group: AppGroup, times: Sequence[float], felt: NDArray[np.float64], force: Vector
) -> float | None:
    """Return the time [s] at which a press ends in a rest that follows it in contact; None without one.

    In that rest the contact bears at most the weight of what is held. felt: (n, 3) [N] at times [s].
    """
    last_step = group.steps[-1].segment
    if last_step.kind != "contact" or last_step.corrected or len(felt) != len(times):
        return None
    carried = None if group.before is None else group.before.segment.load_kg
    last = last_pressed(felt, force, GRAVITY * (carried or 0.0) + PUSHES_BACK_N)
    return None if last is None else times[last] + TOUCHED_S


def _hardest(steps: Sequence[ProgramSegment]) -> ProgramSegment:
    held = [step for step in steps if step.segment.kind == "contact"] or steps
    return max(held, key=lambda step: length(step.force))


def _inserted(group: AppGroup) -> tuple[list[ProgramSegment], list[ProgramSegment]]:
    """Return the steps that push something in before the fingers first move, and the others.

    A peg is pushed into its hole, for example. The last step belongs to the fingers, unless it pushes in. A
    step in which the fingers move is divided there. Fingers that move later do not belong to the contact.
    """
    steps = group.steps
    t0, tn = steps[0].segment.t0, steps[-1].segment.tn
    first = min((grip.t for grip in group.grips if t0 <= grip.t and grip.is_near(t0, tn)), default=-math.inf)
    before = list(takewhile(lambda step: step.segment.tn <= first, steps))
    whole = before[: len(steps) - 1]
    if sum(step.pushed_in for step in whole) > INSERTED_M:
        return whole, steps[len(whole) :]
    after = steps[len(before) :]
    if after and after[0].segment.t0 + OBSERVED_S < first and not after[0].segment.corrected:
        pushing, gripping = divided_at(after[0], first, group.moment_at)
        before, after = [*before, pushing], [gripping, *after[1:]]
    if not before:
        return [], steps
    approach = None if group.before is None or group.before.touches else group.before.segment
    end, touched = before[-1], group.touched(before[0], approach).where["target"]
    hardest = _hardest(before)
    normal = direction(hardest.force)
    depth = -float(np.subtract(end.segment.position_end, touched) @ normal)
    # What is set down, or let back by a spring, pulls less and less, but nothing pushes the robot back.
    pushes = float(normal @ hardest.segment.force) >= PUSHES_BACK_N
    return (before, after) if pushes and depth > INSERTED_M else ([], steps)


def _slides(group: AppGroup) -> Iterable[App]:
    """Yield one app per stroke, with its own target and the forces of its rests."""
    for step in group.steps:
        force = stroke_force(step, group.moment_at) or step.force
        rests = {"rest_before": _rest(step.rests_before, group), "rest_after": _rest(step.rests_after, group)}
        begun = group.landed() if step is group.steps[0] else None
        times = observed(step.segment.t0 if begun is None else begun, step.segment.tn)
        felt = forces_felt(step.base, times, group.moment_at)
        pressed = [(felt, length(force)), *_rests_felt(step, length(force), rests.values(), group)]
        stronger = [stronger_force(there, newton) for there, newton in pressed]
        most, whole = max(newton for _, newton in pressed), np.concatenate([there for there, _ in pressed])
        others = {
            "weaker_n": weaker_force(felt, force, len(times)),
            "aslant": stroke_aslant(step, group.moment_at),
            "stronger_n": max((one for one in stronger if one is not None), default=None),
            "impact_n": impact(whole, most),
        }
        changes = _forces(force, group.force_limit_n) | rests | others
        yield group.moving("apply_force", step, group.ended(step), changes=changes, begun=begun)


def _rests_felt(
    step: ProgramSegment, newton: float, rests: Iterable[RestForce | None], group: AppGroup
) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield the forces (n, 3) [N] of each rest beside a stroke, with the size [N] that the robot exerts then.

    newton: of the stroke [N].
    """
    for parts, rest in zip((step.rests_before, step.rests_after), rests, strict=True):
        most = newton if rest is None else rest.newton_taught
        for part in parts:
            times = observed(part.segment.t0, part.segment.tn)
            yield forces_felt(part.base, times, group.moment_at), most


def _rest(rests: Sequence[ProgramSegment], group: AppGroup) -> RestForce | None:
    """Return the force of the rests at one end of a stroke, within the limit; None where they are short."""
    taught_n, limit_n = rest_force_n(rests, group.moment_at), group.force_limit_n
    if taught_n is None:
        return None
    newton = max(taught_n, LEAST_PRESS_N)
    return RestForce(newton=newton if limit_n is None else min(newton, limit_n), newton_taught=taught_n)


def _carries(group: AppGroup) -> Iterable[App]:
    """Yield one app per step of a carry, all with its average load, or with that until the load changed."""
    sets_down = _meets(group)
    for steps in _with_one_load(group.steps):
        weighed = weighed_steps(steps)
        load: dict[str, object] = {}
        if weighed:
            load = {
                "load_kg": average(weighed, "load_kg"),
                "load_sd_kg": average(weighed, "load_sd_kg"),
            }
        for step in steps:
            ends = sets_down and step is group.steps[-1]
            end = group.touch() if ends else None
            still = _holds_still(step, end)
            taught = _taught(step) if step.is_resisted and not still else {}
            yield group.moving("hold" if still else "transport", step, end, load | taught)


def _taught(step: ProgramSegment) -> dict[str, object]:
    """Return the field `force_taught` of an app that does not exert the force of a step."""
    return {"force_taught": _forces(step.force, None)["force_taught"]}


def _with_one_load(steps: Sequence[ProgramSegment]) -> list[list[ProgramSegment]]:
    """Return the steps of a carry, divided where its load changes, as when something is filled in.

    A step that is too short to be weighed well, or whose load is near the average before it, changes nothing.
    """
    runs: list[list[ProgramSegment]] = [[]]
    for step in steps:
        if has_other_load(step, runs[-1]):
            runs.append([])
        runs[-1].append(step)
    return runs


def _holds_still(step: ProgramSegment, end: AppEnd | None) -> bool:
    """Whether a step of a carry is a Hold rather than a Transport.

    A hold that ends at a contact may carry its load there. It is a Hold if its displacement is negligible, or
    if an operator has set its kind. end: None if the step does not end at a contact.
    """
    where = step.segment.position_end if end is None else end.where["target"]
    way_m = math.dist(step.segment.position_start, where)
    return step.segment.kind == "hold" and (end is None or step.segment.corrected or way_m < NOWHERE_M)


_BUILDERS: dict[str, Callable[[AppGroup], Iterable[App]]] = {
    "motion": _motions,
    "steady": _turns,
    "contact": _contacts,
    "sliding": _slides,
    "transport": _carries,
    "hold": _carries,
}


def _grip_app(
    grip: GripperAction,
    t0: float,
    tn: float,
    moment_at: MomentAt,
    paths: Paths | None,
    confidence: float,
    segments: Sequence[int],
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
        **_in_motion(grip, moment_at, paths),
    )


def _in_motion(grip: GripperAction, moment_at: MomentAt, paths: Paths | None) -> dict[str, float]:
    """Return the largest speeds of the flange while the fingers act; none where it rested."""
    if paths is None:
        return {}
    seen = [speeds for t in _acting(grip, moment_at) if (speeds := paths.speeds_at(t)) is not None]
    fastest = zip(AT_REST.items(), map(max, zip(*seen, strict=True)), strict=False)
    return {name: speed for (name, most), speed in fastest if speed > most}


def _acting(grip: GripperAction, moment_at: MomentAt) -> list[float]:
    """Return the times [s] of observations at which the fingers of an action move, at least its own time.

    The time of an action is one end of their motion. Without an opening the other end is unknown.
    """
    step = OBSERVED_S if grip.opens else -OBSERVED_S
    times, width = [grip.t], moment_at(grip.t).gripper_width
    for k in range(1, MOST_ACTING + 1):
        t = grip.t + k * step
        before, width = width, moment_at(t).gripper_width
        if before is not None and width is not None and abs(width - before) >= FINGERS_MOVE_M:
            times.append(t)
        elif len(times) > 1:
            break
    return times


def _forces(on_robot: Vector, limit_n: float | None) -> dict[str, object]:
    """Return the fields `force`, scaled to the limit where there is one, and `force_taught` [N].

    The robot exerts the opposite of the force that acts on it.
    """
    taught = -np.asarray(on_robot)
    scale = 1.0 if limit_n is None else min(1.0, limit_n / max(length(taught), 1e-12))
    return {"force": tuple((scale * taught).tolist()), "force_taught": tuple(taught.tolist())}

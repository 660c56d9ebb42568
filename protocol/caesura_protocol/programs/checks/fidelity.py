"""Compares a program with its demonstration, and reports taught motion and forces that it lacks.

Findings are warnings, with one exception: fingers that close away from the object. There is no warning below
the rounding of the displayed numbers (`reads_above`).

Parts of a demonstration that are in no app are found at the start of an app: its path states the pose of the
demonstration at that time, and the app before it the pose of the robot.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from caesura_protocol.app_contacts import ends_in_contact, is_resisted
from caesura_protocol.app_force_limit import LEAST_PRESS_N, exerted_forces, force_in_words
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.messages import App, Gap, Vector, ViaPoint, WrenchReport
from caesura_protocol.number_words import fixed, interval, reads_above
from caesura_protocol.programs.app_time_shifts import part_of, rests_of, speed_in_words
from caesura_protocol.programs.checks.findings import Finding, Remedy, in_mm, of_note
from caesura_protocol.programs.document import ProgramStep
from caesura_protocol.programs.document_timing import ProgramTiming
from caesura_protocol.programs.program_gripper import GRIP_REACH_M, GRIPS, SURE_SDS, held_loads
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.ways_between_apps import WayToPath, ways_to_paths
from caesura_protocol.reproduced_path import TOLERANCE_M, TOLERANCE_RAD
from caesura_protocol.rotations import angle_between
from caesura_protocol.sample_limits import TARED_BIAS_N
from caesura_protocol.up_direction import GRAVITY, UP

UNEVEN_SHARE = 0.15  # of a force, by which one beside it is another force
TAUGHT_APART = "a part was taught again"
ENTER_LOAD = Remedy(": enter load_kg in the JSON file", ": export JSON, and enter load_kg in that file")
STATE_WRENCH = Remedy(
    ": state it with --wrench-source", ": the bridge of the station states it, or the form of a recording"
)
SEND_ORIENTATION = Remedy(
    "; send qx qy qz qw, or the joints and --robot",
    ". To have it, play the recording again with the columns of its orientation, or of its joints "
    "and with its robot; a bridge has to send one of the two",
)
NAMED = 3  # impacts in a finding, the hardest ones
EDITED_APART = "the way between them was not taught"
EDITED: Mapping[str, Callable[[App], str]] = {  # text on an edit that changes what a robot does, by its mark
    "target": lambda app: "target" if app.target is None else f"target {in_mm(app.target)}",
    "speed": lambda app: f"speed {speed_in_words(app)}".rstrip(),
    "tolerance_m": lambda app: (
        "tolerance" if app.path is None else f"tolerance {1000 * app.path.tolerance_m:g} mm"
    ),
    "gripper_width": lambda app: (
        "gripper width" if app.gripper_width is None else f"gripper width {1000 * app.gripper_width:g} mm"
    ),
    "added": lambda app: "added",
}
SWAYED_M = 0.005  # a press that is held sways by less: 98 of 100 simulated ones
STEPPED_M = 0.01  # what a hand does beside a press is less, and so is what it does in passing
DRIFTED_M, RESTED_S = 0.005, 0.5  # by which a hand drifts in a rest in the air, if it stays there so long
PULLED_N = 2.0 * TARED_BIAS_N  # from which on a pull is another force than that of the air, by any drift
STRAYED_M, STRAYED_RAD = 0.005, math.radians(2.0)  # an executed path keeps closer to the taught one


@dataclass(frozen=True)
class DemonstrationQuality:
    """Gaps of a demonstration, and the capabilities of its wrench source.

    timing: how the apps were re-timed since; notes: the program's notes for its reader.
    """

    gaps: Sequence[Gap] = ()
    wrench: WrenchReport | None = None
    timing: ProgramTiming | None = None
    notes: Sequence[str] = ()


def fidelity_findings(
    apps: Sequence[App], quality: DemonstrationQuality | None, safety: Safety
) -> list[Finding]:
    """Return what the program omits of the demonstration; without `quality`, according to the apps."""
    found: list[Finding] = []
    if quality is not None:
        found += _wrench_findings(quality)
        found += _notes(quality)
        found += _missing_paths(apps)
        found += _missing_orientations(apps)
    found += _unknown_loads(apps)
    found += _unmoved_loads(apps)
    found += _impacts(apps)
    wrench = None if quality is None else quality.wrench
    up = UP if wrench is None or wrench.up is None else wrench.up
    pose: ViaPoint | None = None
    part = taught_in = None  # the edit that taught the part of this app again, and that of the pose
    led = True  # whether what was taught led from the pose to this app
    for index, (app, way) in enumerate(zip(apps, ways_to_paths(apps), strict=True)):
        part = part_of(app)
        led = led and part == taught_in and _follows(app)
        if led:
            missed = _motion_before(pose, app, apps[index - 1] if index else app, way)
        else:
            missed = _seam(pose, app, EDITED_APART if part == taught_in else TAUGHT_APART)
        pauses = _pause_before(apps[index - 1], app, safety) if index else ()
        before = apps[index - 1] if index else None
        carried = before if before is not None and APP_KINDS[before.kind].carries else None
        reasons = [
            *_edited(app),
            *_path_deviation(app),
            *pauses,
            *missed,
            *_small_load(app, carried),
            *_changed_load(app, carried),
            *_lost_motion(app),
            *_lost_press(app, before, up),
            *_force_limits(app),
        ]
        if quality is not None:
            reasons += _gaps_within(app, quality.gaps)
        found += [Finding("warning", index, app.kind, *reason) for reason in reasons]
        if not led and (off := _off_object(pose, app)):
            found.append(Finding("error", index, app.kind, *off))
        if app.target is not None:
            pose, taught_in, led = _pose_after(app, pose), part, not _is_redirected(app)
    return found


def _edited(app: App) -> Iterator[Reason]:
    """Yield a finding on what people set of an app, beside what the other findings state.

    A force is compared with the taught one, and the place of an app in the program with its neighbours.
    """
    marks = [mark for mark in app.changes if mark.field in EDITED]
    set_by = ", ".join(f"{EDITED[mark.field](app)} by {mark.author}" for mark in marks)
    if set_by:
        yield f"differs from the demonstration: {set_by}", None, None


Reason = tuple[str, float | None, float | None]  # with value and limit


def _path_deviation(app: App) -> Iterator[Reason]:
    path = app.path
    if path is None:
        yield from _winding_press(app)
        return
    if reads_above(1000 * path.deviation_m, 1000 * path.tolerance_m, 1):
        yield (
            f"deviates by up to {fixed(1000 * path.deviation_m, 1)} mm from the taught path, "
            f"the tolerance is {fixed(1000 * path.tolerance_m, 1)} mm",
            path.deviation_m,
            path.tolerance_m,
        )
    if reads_above(math.degrees(path.deviation_rad), math.degrees(path.tolerance_rad), 1):
        yield (
            f"deviates by up to {fixed(math.degrees(path.deviation_rad), 1)}° from the taught orientations, "
            f"the tolerance is {fixed(math.degrees(path.tolerance_rad), 1)}°",
            path.deviation_rad,
            path.tolerance_rad,
        )


def _winding_press(app: App) -> Iterator[Reason]:
    """Yield a finding if a press without a path did not lead straight to its target."""
    off = app.off_straight_m
    if off is not None and reads_above(1000 * off, 1000 * SWAYED_M, 1):
        yield (
            f"was taught up to {fixed(1000 * off, 1)} mm off the straight line to its target, expected at "
            f"most {1000 * SWAYED_M:g} mm: the robot pushes along that line",
            off,
            SWAYED_M,
        )


def _pause_before(before: App, app: App, safety: Safety) -> Iterator[Reason]:
    """Yield a finding on a taught pause between two apps that the robot does not keep."""
    pause = app.t0 - before.tn
    if reads_above(pause, safety.pause_s, 1):
        yield (
            f"comes after a pause of {fixed(pause, 1)} s, which is shortened to {safety.pause_s:g} s",
            pause,
            safety.pause_s,
        )


def _motion_before(pose: ViaPoint | None, app: App, before: App, way: WayToPath | None) -> Iterator[Reason]:
    """Yield a finding on motion between two apps that no app reproduces.

    The fingers of a robot move where the app before ends. before: that app; way: the robot's to the start of
    this app's path.
    """
    start = _start_of(app) if app.path is not None or app.kind in GRIPS else None
    if pose is None or start is None:
        return
    seen, then = start.t, "the robot moves straight to the start of this app"
    if way is None:
        then = "the robot joins the path of this app after its start"
    if app.path is None:
        seen, then = app.tn, "the robot does not move before this app"
    when = f"{interval(min(pose.t, seen), seen, 1)} s"
    moved = math.dist(start.position, pose.position)
    touches = APP_KINDS[app.kind].presses or APP_KINDS[before.kind].presses or ends_in_contact(before, app)
    least = STEPPED_M if touches or seen - pose.t < RESTED_S else DRIFTED_M
    if moved > least:
        reason = f"{fixed(1000 * moved, 0)} mm of motion taught at {when} are in no app: {then}"
        yield (reason, moved, least)
    turned = _orientation_change(pose, start)
    if has_turned(turned):
        degrees = fixed(math.degrees(turned), 1)
        yield (f"rotation of {degrees}° taught at {when} is in no app", turned, STRAYED_RAD)


def has_turned(radians: float) -> bool:
    """Return whether an angle, as it is printed, is more than an executed path may be off."""
    return reads_above(math.degrees(radians), math.degrees(STRAYED_RAD), 1)


def _follows(app: App) -> bool:
    """Return whether an app directly follows the same app as when it was taught; True without an edit."""
    return app.follows if isinstance(app, ProgramStep) else True


def _is_redirected(app: App) -> bool:
    """Return whether an edit gave an app another target than the taught one."""
    return any(mark.field == "target" for mark in app.changes)


def _off_object(pose: ViaPoint | None, app: App) -> Reason | None:
    """Return a finding if the fingers close away from the grasped object.

    A grasp takes place where the app before it ends.
    """
    if pose is None or app.kind != "grasp" or app.target is None:
        return None
    off = math.dist(app.target, pose.position)
    if off <= GRIP_REACH_M:
        return None
    reason = (
        f"grasps {fixed(1000 * off, 0)} mm from the taught place, "
        f"expected at most {1000 * GRIP_REACH_M:.0f} mm: insert a move to {in_mm(app.target)} before it"
    )
    return reason, off, GRIP_REACH_M


def _seam(pose: ViaPoint | None, app: App, why: str) -> Iterator[Reason]:
    """Yield a finding if an app does not begin where the app before it ends.

    why: text on why the two were not taught in a row.
    """
    start = _start_of(app)
    if pose is None or start is None or _off_object(pose, app):
        return
    tolerance_m = TOLERANCE_M if app.path is None else app.path.tolerance_m
    off = math.dist(start.position, pose.position)
    if reads_above(1000 * off, 1000 * tolerance_m, 1):
        yield (
            f"begins {fixed(1000 * off, 1)} mm from the end of the app before it, because {why}: "
            f"insert a move to {in_mm(start.position)} before it, or teach it again from there",
            off,
            tolerance_m,
        )
    tolerance_rad = TOLERANCE_RAD if app.path is None else app.path.tolerance_rad
    turned = _orientation_change(pose, start)
    degrees = math.degrees(turned)
    if reads_above(degrees, math.degrees(tolerance_rad), 1):
        yield (
            f"begins turned by {degrees:.1f}° from the end of the app before it, because {why}: "
            "teach one of the two again with the orientation of the other",
            turned,
            tolerance_rad,
        )


def _start_of(app: App) -> ViaPoint | None:
    """Return the pose at which an app begins: the start of its path, or else its target.

    None for an app without a path that travels or presses, or that has no target.
    """
    if app.path is not None:
        return app.path.start
    facts = APP_KINDS[app.kind]
    if app.target is None or facts.travels or facts.presses:
        return None
    return ViaPoint(t=app.t0, position=app.target, orientation=app.orientation)


def _force_limits(app: App) -> Iterator[Reason]:
    forces = list(exerted_forces(app))
    cut = [force for force in forces if force.is_cut]
    if cut:
        hardest = max(cut, key=lambda force: force.newton_taught)
        yield (f"force limited: {force_in_words(app)}", hardest.newton_taught, hardest.newton)
    raised = next((force for force in forces if force.is_raised), None)
    if raised is not None:
        reason = f"presses harder than taught: {force_in_words(app)}"
        yield (reason, raised.newton, raised.newton_taught)
    yield from _lost_rests(app)
    exerted = 0.0 if app.force is None else math.hypot(*app.force)
    if app.weaker_n is not None and exerted > app.weaker_n * (1.0 + UNEVEN_SHARE):
        reason = (
            f"presses with {fixed(exerted, 1)} N at {interval(app.t0, app.tn, 1)} s, and was taught with "
            f"{fixed(app.weaker_n, 1)} N for a part of it: teach each force as a separate press"
        )
        yield reason, exerted, app.weaker_n
    least = min((force.newton for force in forces), default=math.inf)
    if app.stronger_n is not None and app.stronger_n > least * (1.0 + UNEVEN_SHARE):
        reason = (
            f"presses with less than the {fixed(app.stronger_n, 1)} N that were taught for at least 0.2 s: "
            "if the task needs that force, teach it as a separate press"
        )
        yield reason, app.stronger_n, least
    held = 0.0 if app.aslant is None else math.hypot(*app.aslant)
    if app.aslant is not None and app.force is not None and held * exerted > 0.0:
        cosine = sum(map(operator.mul, app.aslant, app.force)) / (held * exerted)
        leans = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
        reason = (
            f"presses in one direction, and was taught with {fixed(held, 1)} N at {fixed(leans, 0)}° to it "
            "for at least half a second: teach each force as a separate press"
        )
        yield reason, held, exerted
    if APP_KINDS[app.kind].presses and app.screw is not None and app.screw.torque is None:
        degrees = math.degrees(app.screw.angle)
        reason = f"turns by {fixed(degrees, 0)}° in contact, with a torque that was not measured"
        yield (reason, None, None)


def _small_load(app: App, carried: App | None) -> Iterator[Reason]:
    """Yield a finding on a load below its uncertainty, at the first of the apps that carry it.

    carried: the app before, if it carries.
    """
    kg, sd_kg = app.load_kg, app.load_sd_kg
    if kg is None or sd_kg is None or kg >= SURE_SDS * sd_kg:
        return
    if carried is not None and (carried.load_kg, carried.load_sd_kg) == (kg, sd_kg):
        return
    least = SURE_SDS * sd_kg
    reason = f"load {fixed(kg, 2)} ± {fixed(sd_kg, 2)} kg is below what can be measured, {fixed(least, 2)} kg"
    yield reason, kg, least


def _changed_load(app: App, carried: App | None) -> Iterator[Reason]:
    """Yield a finding on a load that changed in the hand: the robot is given the new one from this app on.

    carried: the app before, if it carries.
    """
    if carried is None or not APP_KINDS[app.kind].carries or app.load_kg is None or carried.load_kg is None:
        return
    if abs(app.load_kg - carried.load_kg) > SURE_SDS * math.hypot(
        app.load_sd_kg or 0.0, carried.load_sd_kg or 0.0
    ):
        was, now = fixed(carried.load_kg, 2), fixed(app.load_kg, 2)
        reason = f"carries {now} kg, and the app before {was} kg: the held object must change as when taught"
        yield reason, app.load_kg, carried.load_kg


def _lost_motion(app: App) -> Iterator[Reason]:
    """Yield a finding on fingers that acted in motion: robots stand while their fingers move."""
    speed, turn = app.moved_m_per_s, app.turned_rad_per_s
    parts = [] if speed is None else [f"moved with {fixed(1000 * speed, 0)} mm/s"]
    parts += [] if turn is None else [f"turned with {fixed(math.degrees(turn), 0)}°/s"]
    if parts:
        when = f"at {interval(app.t0, app.tn, 1)} s"
        yield (
            f"{when} the flange {' and '.join(parts)} while the fingers moved: the robot stops for them",
            speed,
            None,
        )


def _lost_press(app: App, before: App | None, up: Vector) -> Iterator[Reason]:
    """Yield a finding on a press of an app that exerts no force.

    An object that is set down rests on its surface with its weight, once the fingers have let it go: that
    force is no press. Nor is that of the press before it, if it goes on. before: the app before it.
    """
    if app.force is not None or app.force_taught is None:
        return
    newtons = float(np.linalg.norm(app.force_taught))
    if is_resisted(app):
        against = (
            f"was taught against {fixed(newtons, 1)} N: the robot follows the path, and controls no force"
        )
        yield against, newtons, None
        return
    if before is not None and APP_KINDS[before.kind].presses and before.force is not None:
        if newtons <= (1.0 + UNEVEN_SHARE) * math.hypot(*before.force):
            return
    elif before is not None and before.load_kg is not None and app.kind == "gripper_move":
        pressed = np.add(app.force_taught, GRAVITY * before.load_kg * np.array(up))
        if np.linalg.norm(pressed) < LEAST_PRESS_N + SURE_SDS * GRAVITY * (before.load_sd_kg or 0.0):
            return
    yield f"was taught with a press of {fixed(newtons, 1)} N, which it does not reproduce", newtons, None


def _unknown_loads(apps: Sequence[App]) -> Iterator[Finding]:
    """Find loads that were not measured, each at the first app that carries it: robots get a load of 0."""
    named = False
    for index, (app, load_kg) in enumerate(zip(apps, held_loads(apps), strict=True)):
        if app.kind == "grasp":
            named = False
        elif APP_KINDS[app.kind].carries and load_kg is None and not named:
            named = True
            reason = "carries a load that was not measured, 0 kg are assumed"
            yield ENTER_LOAD.of(Finding("warning", index, app.kind, reason))


def _unmoved_loads(apps: Sequence[App]) -> Iterator[Finding]:
    """Find loads that were felt only at rest, each at the first app that holds it.

    What a hand pulls upwards is as heavy as a load. Only what is carried shows that it is one. Below
    `PULLED_N` a force is no other one than that of the air.
    """
    for _, group in groupby(enumerate(apps), key=lambda one: one[1].kind == "gripper_move"):
        held = [(index, app) for index, app in group if APP_KINDS[app.kind].carries]
        weighed = (one for one in held if (one[1].load_kg or 0.0) * GRAVITY >= PULLED_N)
        first = next(weighed, None)
        if first is None or any(app.kind == "transport" and not is_resisted(app) for _, app in held):
            continue
        index, app = first
        kg = app.load_kg or 0.0
        reason = (
            f"load {fixed(kg, 2)} kg was felt at rest, and never carried: if the fingers held something "
            f"fixed, this was a pull of {fixed(kg * GRAVITY, 1)} N, which no app exerts"
        )
        yield Finding("warning", index, app.kind, reason, kg)


def _impacts(apps: Sequence[App]) -> Iterator[Finding]:
    """Find impacts that are harder than their presses, in one finding for the program.

    Every second demonstration with a press begins one with an impact.
    """
    hit: list[tuple[float, str]] = []
    for index, app in enumerate(apps):
        most = max((force.newton for force in exerted_forces(app)), default=math.inf)
        if app.impact_n is not None and app.impact_n > most * (1.0 + UNEVEN_SHARE):
            hit.append((app.impact_n, name_of_app(index, app)))
    if hit:
        hardest = sorted(hit, reverse=True)[:NAMED]
        said = ", ".join(f"{fixed(newton, 1)} N in {name}" for newton, name in hardest)
        rest = f", and {len(hit) - NAMED} weaker" if len(hit) > NAMED else ""
        reason = f"impacts shorter than 0.2 s, as at a touch, are not reproduced: {said}{rest}"
        yield Finding("warning", None, None, reason, hardest[0][0])


def _lost_rests(app: App) -> Iterator[Reason]:
    """Yield a finding on a rest with another force than its stroke, for which the app has no time."""
    if app.force is None:
        return
    newtons = float(np.linalg.norm(app.force))
    for when, rest, seconds in zip(
        ("before", "after"), (app.rest_before, app.rest_after), rests_of(app), strict=True
    ):
        if rest is not None and seconds <= 0.0 and abs(rest.newton - newtons) > UNEVEN_SHARE * newtons:
            reason = (
                f"was taught with {fixed(rest.newton, 1)} N {when} its path, and presses with "
                f"{fixed(newtons, 1)} N there: without a path the duration of that force is unknown"
            )
            yield (reason, rest.newton, newtons)


def _gaps_within(app: App, gaps: Sequence[Gap]) -> Iterator[Reason]:
    for gap in gaps:
        if gap.t0 < app.tn and app.t0 < gap.tn:
            yield (
                f"was not observed at {interval(gap.t0, gap.tn, 2)} s: check its motion before a run",
                None,
                None,
            )


def _wrench_findings(quality: DemonstrationQuality) -> Iterator[Finding]:
    wrench = quality.wrench
    if wrench is None:
        return
    if not wrench.stated:
        reason = f"wrench source {wrench.source} is assumed"
        yield STATE_WRENCH.of(Finding("warning", None, None, reason))
    if not wrench.contact_models:
        yield of_note(f"contacts were not searched for. {wrench.note}")
    elif wrench.tare is None:
        said = wrench.note  # on the source, and on the tare
        for note in quality.notes:
            said = said.removeprefix(note)
        yield Finding("warning", None, None, said.strip() or "Not tared: forces have the bias of the sensor.")


def _notes(quality: DemonstrationQuality) -> Iterator[Finding]:
    """Yield the notes of the program as findings, except the one on its wrench, which is found already."""
    on_wrench = "" if quality.wrench is None else quality.wrench.note
    for note in quality.notes:
        if note not in on_wrench:
            yield of_note(note)


def _missing_paths(apps: Sequence[App]) -> Iterator[Finding]:
    taught = [(index, app) for index, app in enumerate(apps) if app.added is None]
    moving = [(index, app) for index, app in taught if APP_KINDS[app.kind].travels]
    without = [(index, app) for index, app in moving if app.path is None]
    reason = "the taught path is unknown: the robot moves straight to the target"
    if moving and len(without) == len(moving):
        yield Finding("warning", None, None, f"{reason} (a file of version 1 has no paths)")
        return
    for index, app in without:
        yield Finding("warning", index, app.kind, reason)


def _missing_orientations(apps: Sequence[App]) -> Iterator[Finding]:
    """Find taught movements without an orientation: one finding for the program if none has one."""
    moving = [
        (index, app) for index, app in enumerate(apps) if APP_KINDS[app.kind].travels and app.added is None
    ]
    without = [(index, app) for index, app in moving if app.orientation is None]
    reason = "the taught orientation is unknown: the robot keeps its current one"
    if moving and len(without) == len(moving):
        yield SEND_ORIENTATION.of(Finding("warning", None, None, reason))
        return
    for index, app in without:
        yield Finding("warning", index, app.kind, reason)


def _pose_after(app: App, pose: ViaPoint | None) -> ViaPoint | None:
    """Return the pose after an app, with the taught time of reaching it.

    A path reaches its target before its app ends if a rest follows. The time at which a press without a path
    reached its target is unknown; the earliest is that of its start.
    """
    if app.target is None:
        return pose
    orientation = app.orientation if pose is None else app.orientation or pose.orientation
    begun = app.t0 if APP_KINDS[app.kind].presses else app.tn
    t = begun if app.path is None else min(app.path.tn, app.tn)
    return ViaPoint(t=t, position=app.target, orientation=orientation)


def _orientation_change(one: ViaPoint, other: ViaPoint) -> float:
    """Return the angle [rad] between two orientations; 0 if one is not known."""
    if one.orientation is None or other.orientation is None:
        return 0.0
    return angle_between(one.orientation, other.orientation)

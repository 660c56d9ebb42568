"""What was taught and is not reproduced: a program beside its demonstration. Warnings only.

What does not end up in an app shows where an app begins: its path says where the demonstration was then, and
the app before it where the robot is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from caesura_lab.execution.findings import Finding
from caesura_protocol.force_limit import force_in_words, is_limited
from caesura_protocol.messages import App, Gap, ViaPoint, WrenchReport
from caesura_protocol.programs.app_kinds import APP_KINDS
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.timing import ProgramTiming
from caesura_protocol.rotations import angle_between

EVEN = 1e-6  # relative, by which a number may be above its tolerance
SURE_SDS = 2.0  # deviations of a load from nothing, above which it is significant
STEPPED_M, STEPPED_RAD = 0.01, math.radians(3.0)  # a hand at rest drifts by less


@dataclass(frozen=True)
class Taught:
    """What is known of a demonstration beside its apps: what was not observed, what the wrench is worth.

    timing: how the apps were re-timed since.
    """

    gaps: Sequence[Gap] = ()
    wrench: WrenchReport | None = None
    timing: ProgramTiming | None = None


def fidelity_findings(apps: Sequence[App], taught: Taught | None, safety: Safety) -> list[Finding]:
    """What of the demonstration the program leaves out; without `taught`, what the apps say of themselves."""
    found: list[Finding] = []
    if taught is not None:
        found += _of_the_wrench(taught.wrench)
        found += _without_path(apps)
    here: ViaPoint | None = None
    for index, app in enumerate(apps):
        before = apps[index - 1] if index else None
        reasons = [*_path(app), *_between(before, here, app, safety), *_effort(app)]
        if taught is not None:
            reasons += _unobserved(app, taught.gaps)
        found += [Finding("warning", index, app.kind, *reason) for reason in reasons]
        here = _after(app, here)
    return found


Reason = tuple[str, float | None, float | None]  # with value and limit


def _path(app: App) -> Iterator[Reason]:
    path = app.path
    if path is None:
        return
    if path.deviation_m > path.tolerance_m * (1.0 + EVEN):
        yield (
            f"deviates by up to {1000 * path.deviation_m:.1f} mm from the path that was taught, "
            f"{1000 * path.tolerance_m:.1f} mm were asked for",
            path.deviation_m,
            path.tolerance_m,
        )
    if path.deviation_rad > path.tolerance_rad * (1.0 + EVEN):
        yield (
            f"deviates by up to {math.degrees(path.deviation_rad):.1f}° from the orientations taught, "
            f"{math.degrees(path.tolerance_rad):.1f}° were asked for",
            path.deviation_rad,
            path.tolerance_rad,
        )


def _between(before: App | None, here: ViaPoint | None, app: App, safety: Safety) -> Iterator[Reason]:
    """What was done since the app before it, and is in no app."""
    if before is None:
        return
    pause = app.t0 - before.tn
    if pause > safety.pause_s:
        yield (
            f"comes after a pause of {pause:.1f} s, which is shortened to {safety.pause_s:g} s",
            pause,
            safety.pause_s,
        )
    if here is None or app.path is None:
        return
    start, when = app.path.start, f"{min(here.t, app.path.start.t):.1f}–{app.path.start.t:.1f} s"
    moved = math.dist(start.position, here.position)
    if moved > STEPPED_M:
        yield (f"begins where {1000 * moved:.0f} mm taught at {when} lead, in no app", moved, STEPPED_M)
    turned = _angle(here, start)
    if turned > STEPPED_RAD:
        degrees = math.degrees(turned)
        yield (f"rotation of {degrees:.0f}° taught at {when} is in no app", turned, STEPPED_RAD)


def _effort(app: App) -> Iterator[Reason]:
    if is_limited(app):
        exerted = float(np.linalg.norm(app.force or ()))
        yield (
            f"force limited: {force_in_words(app)}",
            float(np.linalg.norm(app.force_taught or ())),
            exerted,
        )
    if app.force is None and app.force_taught is not None:
        newtons = float(np.linalg.norm(app.force_taught))
        yield (f"was taught with a press of {newtons:.1f} N, which it does not reproduce", newtons, None)
    if app.kind == "apply_force" and app.screw is not None and app.screw.torque is None:
        degrees = math.degrees(app.screw.angle)
        yield (f"turns by {degrees:.0f}° in contact, with a torque that was not measured", None, None)
    if app.load_kg is not None and app.load_sd_kg is not None and app.load_kg < SURE_SDS * app.load_sd_kg:
        least = SURE_SDS * app.load_sd_kg
        yield (
            f"load {app.load_kg:.2f} ± {app.load_sd_kg:.2f} kg is below what can be measured, {least:.2f} kg",
            app.load_kg,
            least,
        )


def _unobserved(app: App, gaps: Sequence[Gap]) -> Iterator[Reason]:
    for gap in gaps:
        if gap.t0 < app.tn and app.t0 < gap.tn:
            yield (f"was not observed from {gap.t0:.2f} to {gap.tn:.2f} s: look at what it does", None, None)


def _of_the_wrench(wrench: WrenchReport | None) -> Iterator[Finding]:
    if wrench is None:
        return
    if not wrench.stated:
        reason = f"wrench source {wrench.source} is assumed: state it with --wrench-source"
        yield Finding("warning", None, None, reason)
    if not wrench.contact_models:
        reason = f"contacts were not looked for: wrench source {wrench.source} hides them"
        yield Finding("warning", None, None, reason)


def _without_path(apps: Sequence[App]) -> Iterator[Finding]:
    moving = [(index, app) for index, app in enumerate(apps) if APP_KINDS[app.kind].travels]
    without = [(index, app) for index, app in moving if app.path is None]
    reason = "the path that was taught is not known: straight to the target"
    if moving and len(without) == len(moving):
        yield Finding("warning", None, None, f"{reason} (a file of version 1 has no paths)")
        return
    for index, app in without:
        yield Finding("warning", index, app.kind, reason)


def _after(app: App, here: ViaPoint | None) -> ViaPoint | None:
    """Where the robot is after an app, and when that was taught."""
    if app.target is None:
        return here
    orientation = app.orientation if here is None else app.orientation or here.orientation
    return ViaPoint(t=app.tn, position=app.target, orientation=orientation)


def _angle(one: ViaPoint, other: ViaPoint) -> float:
    """[rad] between two orientations; 0 where one is not known."""
    if one.orientation is None or other.orientation is None:
        return 0.0
    return angle_between(one.orientation, other.orientation)

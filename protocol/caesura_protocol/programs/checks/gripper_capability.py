"""Checks that the gripper has the forces, speeds and widths that a program needs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from caesura_protocol.messages import App
from caesura_protocol.programs.checks.findings import Finding
from caesura_protocol.programs.checks.value_ranges import WIDTH_TOLERANCE_M
from caesura_protocol.programs.program_gripper import SHUT_M
from caesura_protocol.programs.safety import Safety
from caesura_protocol.robots import GripperDescription

ASSUMED = {
    "gripper_move": "the fingers open to their limit, {widest_mm:g} mm",
    "grasp": "0 mm is assumed, and the fingers close until they hold an object",
}


def gripper_findings(
    apps: Sequence[App], safety: Safety, gripper: GripperDescription | None
) -> list[Finding]:
    """Return the actions that a gripper cannot perform. `value_findings` checks the widths of fingers.

    gripper: None where it is not known; then fingers are assumed.
    """
    if gripper is None:
        return [*_unstated_widths(apps, safety)]
    return [
        *_settings(safety, gripper),
        *_unseen_losses(apps, gripper),
        *_widths(apps, gripper),
        *_between_states(apps, gripper),
        *(_unstated_widths(apps, safety) if _has_widths(gripper) else ()),
        *_unopened(apps, gripper),
    ]


def _settings(safety: Safety, gripper: GripperDescription) -> Iterator[Finding]:
    """Yield a finding for a force or speed out of the gripper's range.

    A force above the range is an error. A force below it, and any speed, is a warning: the gripper limits it.
    """
    force, speed = gripper.clamped(safety.grasp_force_n, safety.gripper_m_per_s)
    for name, asked, given, unit in (
        ("force", safety.grasp_force_n, force, "N"),
        ("speed", safety.gripper_m_per_s, speed, "m/s"),
    ):
        if asked != given:
            limit = "at most" if asked > given else "at least"
            reason = f"the fingers' {name} {asked:g} {unit}: a {gripper.title} has {limit} {given:g} {unit}"
            severe = name == "force" and asked > given
            yield Finding("error" if severe else "warning", None, None, reason, asked, given)


def _unseen_losses(apps: Sequence[App], gripper: GripperDescription) -> Iterator[Finding]:
    """Yield a warning at each grasp if the gripper reports no loss.

    The script then continues without the object.
    """
    if gripper.event != "none":
        return
    for index, app in enumerate(apps):
        if app.kind == "grasp":
            silent = f"a {gripper.title} does not report whether it holds an object"
            reason = f"{silent}: the program continues if the object is lost"
            yield Finding("warning", index, app.kind, reason, None, None)


def _widths(apps: Sequence[App], gripper: GripperDescription) -> Iterator[Finding]:
    if gripper.kind == "suction":
        for index, app in enumerate(apps):
            if app.gripper_width:
                reason = f"gripper width {1000 * app.gripper_width:g} mm: a {gripper.title} has no width"
                yield Finding("warning", index, app.kind, reason, app.gripper_width, 0.0)


def _between_states(apps: Sequence[App], gripper: GripperDescription) -> Iterator[Finding]:
    """Yield a warning for each width of fingers that a switched gripper does not have: it opens or shuts."""
    if gripper.kind == "suction" or gripper.interface != "digital_output":
        return
    for index, app in enumerate(apps):
        width, opening = app.gripper_width, gripper.opening_m or 0.0
        if app.kind == "gripper_move" and width is not None and SHUT_M < width < opening - WIDTH_TOLERANCE_M:
            states = f"a {gripper.title} is open at {1000 * opening:g} mm or shut, so it opens"
            reason = f"gripper width {1000 * width:g} mm: {states}"
            yield Finding("warning", index, app.kind, reason, width, opening)


def _has_widths(gripper: GripperDescription) -> bool:
    """Return whether the fingers stop at a width, not only open and shut."""
    return gripper.kind != "suction" and gripper.interface != "digital_output"


def _unstated_widths(apps: Sequence[App], safety: Safety) -> Iterator[Finding]:
    """Yield a warning for each app without a taught width, such as with a closed flag.

    Scripts and the simulated robot then assume a width.
    """
    widest = safety.gripper_width_m
    for index, app in enumerate(apps):
        if app.gripper_width is None and app.kind in ASSUMED:
            assumed = ASSUMED[app.kind].format(widest_mm=1000 * widest)
            reason = f"no gripper width is stated: {assumed}; change its width"
            yield Finding("warning", index, app.kind, reason, None, widest)


def _unopened(apps: Sequence[App], gripper: GripperDescription) -> Iterator[Finding]:
    """Yield a warning at a first grasp before which no app opens the fingers: they must be open already."""
    first = next((index for index, app in enumerate(apps) if app.kind in ASSUMED), None)
    if first is None or apps[first].kind != "grasp" or gripper.kind == "suction":
        return
    width = apps[first].gripper_width
    wide = "" if width is None else f" by more than {1000 * width:.0f} mm"
    reason = f"no app opens the fingers before this one: open them{wide} before the program starts"
    yield Finding("warning", first, "grasp", reason, None, width)

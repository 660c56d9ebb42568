"""Preconditions of apps: a contact or a grasp before a press, something in the fingers before a carry.

In contact a tool must not be turned to the start of the next path, because its tip would be driven into the
surface. Nor may a press pull the tool away: it pushes along the tool.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from caesura_protocol.app_contacts import ends_in_contact, is_resisted
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.messages import App, Quaternion
from caesura_protocol.number_words import fixed
from caesura_protocol.programs.checks.findings import Finding, Remedy, in_mm
from caesura_protocol.programs.held_grasps import HeldGrasps, eases, held_grasps, is_regrip
from caesura_protocol.programs.program_gripper import SHUT_M
from caesura_protocol.rotations import angle_between

PULLS = "pulls on the touched surface: its force points away from the tool"
_IN_BASE_FRAME = ". Was the force recorded in the base frame, as the environment's on the robot? If not, "
_FROM_CONTACT = (
    ". Did the recording begin in contact? Then its first force was taken as zero: teach it again from free "
    "space"
)
WHY_IT_PULLS = Remedy(
    f"{_IN_BASE_FRAME}state force_frame in the recording or --force-frame, or negate the force"
    f"{_FROM_CONTACT}",
    f"{_IN_BASE_FRAME}play the recording again, and choose its frame and whose force it is{_FROM_CONTACT}",
)
UNHELD = "carries, but nothing was grasped: an app 'grasp' must come before it"
WHY_UNHELD = (
    ". The program has none: was the gripper's state recorded? If nothing was carried, the force of its "
    "segment is no load: correct it to contact or motion"
)
ACROSS_SINE = math.sin(math.radians(15.0))  # of a force across the tool: 2.3 N of bias turn one of 9 N as far
TURN_AT_CONTACT_RAD = math.radians(15.0)  # taught ones turn by 9° at most


def precondition_findings(apps: Sequence[App]) -> list[Finding]:
    """Find apps whose preconditions do not hold, and contacts or grasps that no later app ends."""
    found: list[Finding] = []
    touching, moved, emptied = False, False, False
    orientation: Quaternion | None = None
    *before, after = held_grasps(apps)
    for index, (app, held) in enumerate(zip(apps, before, strict=True)):
        following = apps[index + 1] if index + 1 < len(apps) else None
        empties = emptied or _is_shut(app) or any(later.kind == "grasp" for later in apps[index + 1 :])
        reason = _violations(app, touching=touching, holds=held is not None, empties=empties)
        if reason == UNHELD and all(one.kind != "grasp" for one in apps):
            reason += "" if any(one.reason.startswith(UNHELD) for one in found) else WHY_UNHELD
        if reason:
            began = _begins_in_contact(app) if APP_KINDS[app.kind].presses and not moved else ""
            found.append(Finding("error", index, app.kind, reason + began))
        orientation = app.orientation or orientation
        if APP_KINDS[app.kind].presses and _pulls(app, orientation):
            said = any(one.reason.startswith(PULLS) for one in found)
            pulls = Finding("error", index, app.kind, PULLS)
            found.append(pulls if said else WHY_IT_PULLS.of(pulls))
        if touching and (turned := _turned(apps[index - 1], app)) > TURN_AT_CONTACT_RAD:
            found.append(_turned_at_contact(index, app, turned))
        if app.kind == "grasp" and not moved:
            found.append(Finding("warning", index, app.kind, _begins_at(app)))
        if app.kind == "grasp" and held is not None:
            found.append(_regrip(index, apps, held))
        emptied = emptied or app.kind == "gripper_move"
        facts = APP_KINDS[app.kind]
        # A missing contact is found once. What is gripped where it stands is touched by it.
        stays = facts.in_contact and (touching or facts.presses or app.kind == "grasp")
        touching = stays or ends_in_contact(app, following) or is_resisted(app)
        moved = moved or facts.travels
    if after is not None:
        reason = "grasps an object that is never released: an app 'move gripper' must follow"
        found.append(Finding("error", after.last, apps[after.last].kind, reason))
    return found


def _regrip(index: int, apps: Sequence[App], held: HeldGrasps) -> Finding:
    """Return a warning for a grasp that changes the grip on what is held; an error for any other one."""
    app, first, last = apps[index], apps[held.first], apps[held.last]
    holder = name_of_app(held.first, first)
    if app.gripper_width is None or last.gripper_width is None or not is_regrip(app, first, last):
        reason = f"grasps, but {holder} holds something already: an app 'move gripper' must come before it"
        return Finding("error", index, app.kind, reason)
    widths = f"from {1000 * last.gripper_width:.0f} to {1000 * app.gripper_width:.0f} mm"
    if eases(app, last):
        reason = f"opens {widths} around the object of {holder}: a narrower object falls"
    else:
        reason = f"closes {widths} on the object of {holder}, with the grasp force of the cell"
        carried = (one.load_kg or 0.0 for one in apps[held.first : index])
        reason += "" if any(carried) else ". If that grasp holds nothing, make it a 'move gripper'"
    return Finding("warning", index, app.kind, reason)


def _pulls(app: App, orientation: Quaternion | None) -> bool:
    """Return whether the force of a press points away from the tool, if the orientation is known.

    A push across the tool points away from it only by the sensor's bias and noise.
    """
    if app.force is None or orientation is None or not any(orientation):
        return False
    x, y, z, w = orientation
    axis = 2.0 * (x * z + y * w), 2.0 * (y * z - x * w), w * w + z * z - x * x - y * y
    towards_n = sum(a * newton for a, newton in zip(axis, app.force, strict=True))
    return towards_n < -ACROSS_SINE * math.hypot(*app.force)


def _turned(before: App, app: App) -> float:
    """Return the angle [rad] from an app's final orientation to the start of the next path; 0 if unknown."""
    begins = None if app.path is None else app.path.start.orientation
    if begins is None or before.orientation is None:
        return 0.0
    return angle_between(before.orientation, begins)


def _turned_at_contact(index: int, app: App, turned: float) -> Finding:
    found, limit = math.degrees(turned), math.degrees(TURN_AT_CONTACT_RAD)
    reason = (
        f"begins turned by {fixed(found, 0)}° from the end of the app before it, in contact, expected at "
        f"most {fixed(limit, 0)}°: teach it again, or insert a move away from the surface before it"
    )
    return Finding("error", index, app.kind, reason, found, limit)


def _begins_in_contact(app: App) -> str:
    """Return text on the missing app that leads to the contact of the first press, with a remedy."""
    begins = app.target if app.path is None else app.path.start.position
    there = "" if begins is None else f" with target {in_mm(begins)}"
    return (
        ". The recording began in contact, or an edit removed the motion there: "
        f"teach it again from free space, or insert such an app{there}"
    )


def _begins_at(app: App) -> str:
    """Return text on the place of the arm before a program that begins with a grasp."""
    there = "the taught place" if app.target is None else f"{in_mm(app.target)} (flange)"
    return (
        f"grasps before anything moves: bring the arm to {there} first, or insert a move to there before it"
    )


def _is_shut(app: App) -> bool:
    """Return whether an app ends with fingers that hold nothing between them."""
    return app.gripper_width is not None and app.gripper_width <= SHUT_M


def _violations(app: App, *, touching: bool, holds: bool, empties: bool) -> str | None:
    """Return text on the first precondition that does not hold.

    empties: whether a move of the gripper may be one of empty fingers.
    """
    if APP_KINDS[app.kind].presses and not touching:
        return "presses without a contact: an app 'move to contact' must come before it"
    if app.kind == "gripper_move" and not holds and not empties:
        return "releases an object that was never grasped: an app 'grasp' must come before it"
    if APP_KINDS[app.kind].carries and not holds:
        return UNHELD
    return None

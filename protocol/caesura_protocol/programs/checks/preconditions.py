"""What must hold before an app is run: a contact before a press, something in the fingers before a carry."""

from __future__ import annotations

from collections.abc import Sequence

from caesura_protocol.app_kinds import APP_KINDS, ends_in_contact
from caesura_protocol.messages import App
from caesura_protocol.programs.checks.findings import Finding


def order_findings(apps: Sequence[App]) -> list[Finding]:
    """Find apps whose preconditions do not hold, and contacts or grasps that no later app ends."""
    found: list[Finding] = []
    touching, holding = False, None
    for index, app in enumerate(apps):
        following = apps[index + 1].kind if index + 1 < len(apps) else None
        grasps_later = any(later.kind == "grasp" for later in apps[index + 1 :])
        reason = _violations(app, touching=touching, holds=holding is not None, grasps_later=grasps_later)
        if reason:
            found.append(Finding("error", index, app.kind, reason))
        if app.kind == "grasp":
            holding = index
        elif app.kind == "gripper_move":
            holding = None
        stays = touching and APP_KINDS[app.kind].in_contact
        touching = stays or ends_in_contact(app.kind, following)
    if holding is not None:
        reason = "grasps what is never released: an app 'move gripper' must follow"
        found.append(Finding("error", holding, apps[holding].kind, reason))
    return found


def _violations(app: App, *, touching: bool, holds: bool, grasps_later: bool) -> str | None:
    if APP_KINDS[app.kind].presses and not touching:
        return "presses without a contact: an app 'move to contact' must come before it"
    if app.kind == "grasp" and holds:
        return "grasps, but something is held already: an app 'move gripper' must come before it"
    if app.kind == "gripper_move" and not holds and not grasps_later:
        return "releases what was never grasped: an app 'grasp' must come before it"
    if APP_KINDS[app.kind].carries and not holds:
        return "carries, but nothing was grasped: an app 'grasp' must come before it"
    return None

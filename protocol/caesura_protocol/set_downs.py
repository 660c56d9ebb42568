"""Whether a contact ends an app: where the robot looks for a surface, and where it lets go in the air."""

from __future__ import annotations

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App


def ends_in_contact(app: App, following: App | None) -> bool:
    """Return whether a contact ends an app. following: the next app, None for the last one.

    It ends a Move To Contact, a carry before a press, and a carry before fingers that moved in contact: their
    app states the force of that contact. Fingers that open in the air let fall what they hold.
    """
    if app.kind == "move_to_contact":
        return True
    if following is None or not APP_KINDS[app.kind].carries:
        return False
    facts = APP_KINDS[following.kind]
    return facts.presses or (facts.in_contact and following.force_taught is not None)

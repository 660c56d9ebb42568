"""Whether an app touches something: where the robot looks for a surface, and what it pushes on its way."""

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


def is_resisted(app: App) -> bool:
    """Return whether an app moves against a resistance that gives way, such as a box that it pushes."""
    return APP_KINDS[app.kind].travels and app.force_taught is not None

"""What exporters refuse before they write, and what they share about contacts."""

from __future__ import annotations

import math
from collections.abc import Iterator

from caesura_protocol.app_kinds import app_name
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import CONSTANTS
from caesura_protocol.programs.safety import Safety
from caesura_protocol.rotations import matrix_of

FORCE_SLACK_N = 1e-6
ACTING = (  # limits on which a running script acts; the others are kept when it is written
    "MAX_SPEED_M_PER_S",
    "CONTACT_SPEED_M_PER_S",
    "MAX_FORCE_N",
    "STOP_FORCE_N",
    "CONTACT_FORCE_N",
    "SEARCH_M",
)


def acting_limits(safety: Safety) -> Iterator[str]:
    """The limits as lines of a script."""
    for name in ACTING:
        field, why = CONSTANTS[name]
        yield f"{name} = {getattr(safety, field):g}  # {why}"


def refuse_beyond_limits(program: ProgramFile) -> None:
    """Raises ValueError for an app whose place, force or load is beyond the limits of the program."""
    safety = program.safety
    for index, app in enumerate(program.apps):
        name = app_name(index, app.kind)
        places = [("target", app.target)]
        if app.path is not None:
            places += [("its path", point.position) for point in (app.path.start, *app.path.via)]
        for what, place in places:
            for x, low, high in zip(place or (), safety.workspace_low, safety.workspace_high, strict=False):
                if not low <= x <= high:
                    raise ValueError(f"{name}: {what} at {x:g} m, the workspace is {low} to {high} m")
        force = 0.0 if app.force is None else math.hypot(*app.force)
        if force > safety.most_force_n + FORCE_SLACK_N:
            raise ValueError(f"{name}: force {force:.1f} N, at most {safety.most_force_n:.1f} N are allowed")
        if app.load_kg is not None and not 0.0 <= app.load_kg <= safety.load_kg:
            raise ValueError(f"{name}: load {app.load_kg} kg, at most {safety.load_kg} kg are allowed")


def press_direction(app: App, following: App | None) -> Vector:
    """Where a contact is looked for: along the force that follows, or else where the tool points."""
    if following is not None and following.force is not None and any(following.force):
        size = math.hypot(*following.force)
        x, y, z = (value / size for value in following.force)
    else:
        x, y, z = matrix_of(app.orientation or (1.0, 0.0, 0.0, 0.0))[:, 2].tolist()
    return x, y, z

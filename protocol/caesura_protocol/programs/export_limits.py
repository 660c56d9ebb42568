"""Limits that exporters check before they write a script, and the lines of those on which a script acts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from caesura_protocol.app_force_limit import LEAST_FORCE_N, exerted_forces, is_press
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.messages import App
from caesura_protocol.programs.checks.preconditions import precondition_findings
from caesura_protocol.programs.checks.value_ranges import impossible_numbers
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.robots import RobotDescription

CONSTANTS = {
    "MAX_SPEED_M_PER_S": ("speed_m_per_s", "of the flange, never faster"),
    "MAX_TURN_RAD_PER_S": ("turn_rad_per_s", "of the flange, never faster"),
    "CONTACT_SPEED_M_PER_S": ("contact_speed_m_per_s", "where a contact is looked for"),
    "MAX_FORCE_N": ("most_force_n", "that an app may ask for"),
    "STOP_FORCE_N": ("felt_force_n", "of anything: the robot stops"),
    "CONTACT_FORCE_N": ("contact_n", "from which a contact is one"),
    "SEARCH_M": (
        "search_m",
        "that a contact may be from where it was taught, and a press beyond its way",
    ),
    "MAX_LOAD_KG": ("load_kg", "in the gripper"),
    "GRASP_FORCE_N": ("grasp_force_n", "of the fingers"),
    "GRIPPER_M_PER_S": ("gripper_m_per_s", "of the fingers"),
    "WORKSPACE_LOW_M": ("workspace_low", "x, y, z of the flange in the base frame"),
    "WORKSPACE_HIGH_M": ("workspace_high", "x, y, z of the flange in the base frame"),
    "MAX_PAUSE_S": ("pause_s", "between two apps; what was taught longer is shortened"),
}
FORCE_SLACK_N = 1e-6
ACTING = (  # limits on which a running script acts; the others are kept when it is written
    "MAX_SPEED_M_PER_S",
    "CONTACT_SPEED_M_PER_S",
    "MAX_FORCE_N",
    "STOP_FORCE_N",
    "CONTACT_FORCE_N",
    "SEARCH_M",
)


def limits(program: ProgramFile, names: Iterable[str] = tuple(CONSTANTS)) -> Iterator[tuple[str, Any, str]]:
    """Yield the name, value and meaning of limits of a script.

    The force that an app may ask for is at least that of the program: where the robot would be stopped at it,
    a script does not begin.
    """
    for name in names:
        field, why = CONSTANTS[name]
        value = getattr(program.safety, field)
        yield name, max(value, hardest_n(program)) if name == "MAX_FORCE_N" else value, why


def hardest_n(program: ProgramFile) -> float:
    """Return the largest force [N] that a robot feels in a program, with friction; 0 without a press."""
    return max((one.newton for app in program.apps for one in exerted_forces(app)), default=0.0)


def acting_limits(program: ProgramFile) -> Iterator[str]:
    """Yield the limits on which a running script acts, as its lines, without exponents."""
    for name, value, why in limits(program, ACTING):
        yield f"{name} = {f'{value:.9f}'.rstrip('0').rstrip('.')}  # {why}"


def within_robot(acceleration: float, robot: RobotDescription | None) -> float:
    """Return an acceleration of the flange [m/s²], limited to half of the robot's maximum."""
    return acceleration if robot is None else min(acceleration, 0.5 * robot.flange_acceleration_limit)


def refuse_impossible(program: ProgramFile) -> None:
    """Raise ValueError for a number that no app can have, whatever the limits of the cell."""
    for index, app in enumerate(program.apps):
        for one in impossible_numbers(index, app):
            raise ValueError(f"{name_of_app(index, app)}: {one.reason}")


def refuse_beyond_limits(program: ProgramFile) -> None:
    """Raise ValueError without an app, and for one beyond the limits of position, force or load, or without a
    precondition.

    It is raised, too, for a number that no app can have, whatever the limits of the cell.
    A press needs a contact before it: otherwise it would begin at any position of the arm. A carry needs a
    grasp: otherwise the robot would compensate a load that it does not have.
    """
    if not program.apps:
        raise ValueError("it has no app, so a robot would do nothing")
    safety = program.safety
    refuse_impossible(program)
    for index, app in enumerate(program.apps):
        name = name_of_app(index, app)
        _refuse_incomplete(name, app)
        _refuse_outside(name, app, safety)
        force, most = max((one.newton for one in exerted_forces(app)), default=0.0), safety.force_n
        if most is not None and force > most + FORCE_SLACK_N:
            raise ValueError(f"{name}: force {force:.1f} N, at most {most:.1f} N are allowed")
        if app.load_kg is not None and not 0.0 <= app.load_kg <= safety.load_kg:
            raise ValueError(f"{name}: load {app.load_kg} kg, at most {safety.load_kg} kg are allowed")
    for one in precondition_findings(program.apps):
        if one.index is None:
            continue
        app = program.apps[one.index]
        if APP_KINDS[app.kind].presses or APP_KINDS[app.kind].carries:
            raise ValueError(f"{name_of_app(one.index, app)}: {one.reason}")


def _refuse_outside(name: str, app: App, safety: Safety) -> None:
    places = [("target", app.target)]
    if app.path is not None:
        places += [("its path", point.position) for point in (app.path.start, *app.path.via)]
    for what, place in places:
        limits = zip("xyz", place or (), safety.workspace_low, safety.workspace_high, strict=False)
        for axis, value, low, high in limits:
            if not low <= value <= high:
                limit = f"the workspace is {1000 * low:.0f} to {1000 * high:.0f} mm"
                remedy = "state that of the cell with --cell"
                raise ValueError(f"{name}: {what} at {axis} {1000 * value:.0f} mm, {limit}; {remedy}")


def _refuse_incomplete(name: str, app: App) -> None:
    for field in APP_KINDS[app.kind].needs:
        if getattr(app, field) is None:
            raise ValueError(f"{name} has no {field}")
    if app.path is not None and app.target is None:
        raise ValueError(f"{name} has a path, but no target")
    newtons = math.hypot(*(app.force or ()))
    if APP_KINDS[app.kind].presses and not is_press(newtons):
        expected = f"expected one with a direction, at least {LEAST_FORCE_N:g} N"
        raise ValueError(f"{name}: force {newtons:g} N, {expected}")

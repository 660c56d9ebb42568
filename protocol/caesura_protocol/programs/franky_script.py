"""A program as a script for franky (franky-control 2, https://github.com/TimSchneider42/franky).

The script stands alone: limits as constants at its top, the apps as a table, and one method for each kind. It
is a template (`franky_template.py.txt`) with these filled in.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pprint import pformat
from typing import Any

from caesura_protocol.app_kinds import app_title
from caesura_protocol.force_limit import is_limited
from caesura_protocol.messages import Vector
from caesura_protocol.paths import turn_of, turning_at_points
from caesura_protocol.programs.document import ProgramFile, ProgramStep
from caesura_protocol.programs.safety import Safety
from caesura_protocol.robots import robot_description
from caesura_protocol.screw_motion import stop_torque_nm

FIELDS = ("target", "orientation", "joints", "force", "force_taught", "load_kg", "gripper_width")
DIGITS = 6
MARK_LIMITS, MARK_APPS, MARK_NAME = "# <LIMITS>", "# <APPS>", "<NAME>"
CONSTANTS = {
    "MAX_SPEED_M_PER_S": ("speed_m_per_s", "of the flange, never faster"),
    "MAX_TURN_RAD_PER_S": ("turn_rad_per_s", "of the flange, never faster"),
    "CONTACT_SPEED_M_PER_S": ("contact_speed_m_per_s", "where a contact is looked for"),
    "MAX_FORCE_N": ("most_force_n", "that an app may ask for"),
    "STOP_FORCE_N": ("felt_force_n", "of anything: the robot stops"),
    "CONTACT_FORCE_N": ("contact_n", "from which a contact is one"),
    "SEARCH_M": ("search_m", "past its target that a contact is looked for"),
    "MAX_LOAD_KG": ("load_kg", "in the gripper"),
    "GRASP_FORCE_N": ("grasp_force_n", "of the fingers"),
    "GRIPPER_M_PER_S": ("gripper_m_per_s", "of the fingers"),
    "WORKSPACE_LOW_M": ("workspace_low", "x, y, z of the flange in the base frame"),
    "WORKSPACE_HIGH_M": ("workspace_high", "x, y, z of the flange in the base frame"),
    "MAX_PAUSE_S": ("pause_s", "between two apps; what was taught longer is shortened"),
}


def franky_script(program: ProgramFile) -> str:
    """The script's text. Raises ValueError for a robot of another maker, or a number that is not finite."""
    if program.robot is not None and robot_description(program.robot).script != "franky":
        raise ValueError(f"a franky script is for a Franka arm, and its robot is {program.robot}")
    template = files("caesura_protocol.programs").joinpath("franky_template.py.txt").read_text("utf-8")
    name = f"{program.station}/{program.session}, revision {program.revision}"
    apps = [_row(app) for app in program.apps]
    program.as_json()  # refuses what is not finite
    return (
        template.replace(MARK_NAME, name)
        .replace(MARK_LIMITS, _limits(program.safety))
        .replace(MARK_APPS, f"APPS = {pformat(apps, width=100, sort_dicts=False)}")
    )


def _limits(safety: Safety) -> str:
    lines = (f"{name} = {getattr(safety, field)!r}  # {why}" for name, (field, why) in CONSTANTS.items())
    return "\n".join(lines)


def _row(app: ProgramStep) -> dict[str, Any]:
    """What the script needs of an app."""
    row: dict[str, Any] = {
        "kind": app.kind,
        "title": app.name or app_title(app.kind),
        "t0": round(app.t0, 3),
        "tn": round(app.tn, 3),
    }
    for name in FIELDS:
        value = getattr(app, name)
        if value is not None:
            row[name] = _rounded(value)
    if not is_limited(app):
        row.pop("force_taught", None)
    if app.path is not None:
        points, began = (app.path.start, *app.path.via), app.path.start.t
        turning: Sequence[Vector | None] = turning_at_points(app) or [None] * len(points)
        row["path"] = [
            (round(one.t - began, 3), *map(_rounded, (one.position, one.orientation, one.velocity, turns)))
            for one, turns in zip(points, turning, strict=True)
        ]
        row["arrives"] = round(app.path.tn - began, 3)
        row["turns"] = _rounded(turn_of(app))
    most_nm = stop_torque_nm(app.screw)
    if app.screw is not None and most_nm is not None:
        row["tight"] = _rounded(app.screw.axis), _rounded(app.screw.point), _rounded(most_nm)
    return row


def _rounded(value: tuple[float, ...] | float | None) -> Any:
    if isinstance(value, tuple):
        return tuple(round(x, DIGITS) for x in value)
    return None if value is None else round(value, DIGITS)

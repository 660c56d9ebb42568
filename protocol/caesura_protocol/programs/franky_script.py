"""A program as a script for franky (franky-control 2, https://github.com/TimSchneider42/franky).

The script is self-contained: limits as constants at its top, the apps as a table, and one method for each
kind. It is the template `franky_template.py.txt` with these values.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_force_limit import is_path_limited
from caesura_protocol.app_kinds import APP_KINDS, name_of_app, step_title
from caesura_protocol.messages import Quaternion
from caesura_protocol.programs.app_time_shifts import goes_on, rests_of
from caesura_protocol.programs.contact_forces import force_in_tool, without_friction
from caesura_protocol.programs.document import ProgramFile, ProgramStep
from caesura_protocol.programs.export_limits import limits, refuse_beyond_limits
from caesura_protocol.programs.held_grasps import eased_grasps
from caesura_protocol.programs.program_gripper import gripper_of, not_driven, with_held_loads
from caesura_protocol.programs.script_templates import (
    felt_with_friction,
    filled_template,
    head_comments,
    in_docstring,
    robot_of_script,
    table_of_apps,
    title_of,
)
from caesura_protocol.programs.ways_between_apps import ways_to_paths
from caesura_protocol.reproduced_path import Curve, curve_of, turn_of
from caesura_protocol.rotations import angular_velocities
from caesura_protocol.screw_torque_and_text import stop_torque_nm

FIELDS = ("target", "orientation", "joints", "force", "force_taught", "load_kg", "gripper_width")
DIGITS = 6
POINTS_S = 0.2  # at most between two points of a path: franky's own way between them is not the taught one
MARK_LIMITS, MARK_APPS, MARK_NAME, MARK_ROBOT = "# <LIMITS>", "# <APPS>", "<NAME>", "<ROBOT>"
MARK_FINDINGS = "# <FINDINGS>\n"


def franky_script(program: ProgramFile) -> str:
    """Return the script's text.

    Raises ValueError for a robot of another maker, a gripper that franky cannot drive, an app beyond the
    limits, or a number that is not finite.
    """
    robot = robot_of_script(program, "franky", "a franky script is for a Franka arm")
    _refuse_other_gripper(program)
    refuse_beyond_limits(program)
    program = with_held_loads(program)
    texts = {
        MARK_NAME: title_of(program),
        MARK_ROBOT: in_docstring("Franka Panda" if robot is None else robot.title),
        MARK_FINDINGS: head_comments(program),
        MARK_LIMITS: "\n".join(f"{name} = {value!r}  # {why}" for name, value, why in limits(program)),
        MARK_APPS: table_of_apps(program, _rows(program.apps), 96),
    }
    return filled_template("franky_template.py.txt", texts)


def _refuse_other_gripper(program: ProgramFile) -> None:
    """Raise ValueError where fingers move that are stated to be other than those of a Franka Hand."""
    held_by = gripper_of(program)
    if held_by is None or held_by.interface == "franka":
        return
    for index, app in enumerate(program.apps):
        if app.kind in {"grasp", "gripper_move"}:
            raise ValueError(not_driven(name_of_app(index, app), "franky", held_by, {"franka"}))


def _rows(apps: Sequence[ProgramStep]) -> list[dict[str, Any]]:
    """Return the data of each app that the script needs.

    An app without a stop at its target has `goes_on`, the velocities there; a carry that a contact ends has
    `sets_down`; a grasp that opens the fingers around what is held `eases`; an app that begins elsewhere than
    the app before it ends `leads_in`, the time [s] to its start.
    """
    rows, eased = [], eased_grasps(apps)
    around = zip(apps, [*apps[1:], None], [*apps[2:], None, None], ways_to_paths(apps), strict=False)
    for index, (app, following, after, way) in enumerate(around):
        row = _row(app)
        if way is not None:
            row["leads_in"] = round(way.seconds, 3)
        if index in eased:
            row["eases"] = True
        if app.path is not None and _is_passed(app, following, after):
            row["goes_on"] = tuple(map(_rounded, (app.path.end_velocity, app.path.end_angular_velocity)))
        if APP_KINDS[app.kind].carries and ends_in_contact(app, following):
            row["sets_down"] = True
        rows.append(row)
    return rows


def _is_passed(app: ProgramStep, following: ProgramStep | None, after: ProgramStep | None) -> bool:
    """Return whether both apps are one motion of the robot.

    The robot does not react to contact or torque during that motion.
    """
    if following is None or not goes_on(app, following):
        return False
    meets = ends_in_contact(following, after)
    return not meets and app.screw is None and following.screw is None


def _row(taught: ProgramStep) -> dict[str, Any]:
    """Return the data of an app that the script needs, independently of its neighbours."""
    app = without_friction(taught)
    row: dict[str, Any] = {
        "kind": app.kind,
        "title": step_title(app.kind, app.name, app.target_name),
        "t0": round(app.t0, 3),
        "tn": round(app.tn, 3),
    }
    for name in FIELDS:
        value = getattr(app, name)
        if value is not None:
            row[name] = _rounded(_unit(value) if name == "orientation" else value)
    row |= felt_with_friction(taught)
    if not is_path_limited(taught):
        row.pop("force_taught", None)
    if app.path is not None:
        curve = curve_of(app)
        row["path"], row["via"] = _way_points(curve), len(app.path.via)
        row["peaks"] = _rounded(curve.peaks())
        row["arrives"] = _rounded(app.path.tn - app.path.start.t)
        in_tool = force_in_tool(app)
        if in_tool is not None:
            row["in_tool"] = _rounded(in_tool)
        row["waits"] = round(rests_of(app)[0], 3)
        for name, rest in (("before_n", app.rest_before), ("after_n", app.rest_after)):
            if rest is not None:
                row[name] = _rounded(rest.newton)
        row["turns"] = _rounded(turn_of(app))
    most_nm = stop_torque_nm(app.screw)
    if app.screw is not None and most_nm is not None:
        row["tight"] = _rounded(app.screw.axis), _rounded(app.screw.point), _rounded(most_nm)
    return row


def _way_points(curve: Curve) -> list[tuple[Any, ...]]:
    """Return the knots of a curve but the last, and points between them, at most `POINTS_S` apart.

    Each has its time since the start [s], position, quaternion, velocity and rate of turn.
    """
    points = []
    for begun, ended in pairwise(curve.t.tolist()):
        parts = max(math.ceil(round((ended - begun) / POINTS_S, 6)), 1)
        for t in np.linspace(begun, ended, parts, endpoint=False).tolist():
            values, velocities, _ = curve.at(t)
            (x, y, z, *quaternion), turning = values.tolist(), None
            if quaternion:
                turning = tuple(angular_velocities(values[None, 3:], velocities[None, 3:])[0].tolist())
            passed = (x, y, z), _unit(quaternion), tuple(velocities[:3].tolist()), turning
            points.append((_rounded(t - float(curve.t[0])), *map(_rounded, passed)))
    return points


def _unit(quaternion: Sequence[float] | None) -> Quaternion | None:
    """Return a quaternion of unit length: libfranka refuses a pose whose rotation has another one."""
    if not quaternion:
        return None
    x, y, z, w = (value / math.hypot(*quaternion) for value in quaternion)
    return x, y, z, w


def _rounded(value: tuple[float, ...] | float | None) -> Any:
    if isinstance(value, tuple):
        return tuple(round(x, DIGITS) for x in value)
    return None if value is None else round(value, DIGITS)

"""A program as a script for xArm-Python-SDK 1.18 (https://github.com/xArm-Developer/xArm-Python-SDK).

The script is self-contained: limits as constants at its top, the apps as a table, and a runner. It is the
template `xarm_template.py.txt` with these values. The force controller acts along an axis of the base or of
the tool: a force within 20° of one is exerted along it, and any other force is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from caesura_protocol.app_kinds import APP_KINDS, step_title
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.contact_forces import force_in_tool, orientation_halfway
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.export_limits import acting_limits, refuse_beyond_limits, within_robot
from caesura_protocol.programs.held_grasps import eased_grasps
from caesura_protocol.programs.planned_apps import PlannedApp, planned_apps
from caesura_protocol.programs.program_gripper import GRIPS, gripper_of, not_driven, with_held_loads
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.script_templates import (
    felt_with_friction,
    filled_template,
    head_comments,
    in_docstring,
    robot_of_script,
    table_of_apps,
    title_of,
)
from caesura_protocol.programs.straight_legs import LEGS, Quaternion
from caesura_protocol.robots import GripperDescription
from caesura_protocol.rotations import matrix_of, rotation_vector
from caesura_protocol.screw_torque_and_text import stop_torque_nm

ACCELERATION_M_PER_S2 = 1.0
WIDTH_MARGIN_M = 0.01  # by which the fingers are sent on past the width of what they grasp
MOST_LEAN_RAD = math.radians(20.0)  # of a force from an axis along which it is pressed all the same
NAMED_LEAN_RAD = math.radians(5.0)  # from which on the script says so
SAME_RAD = math.radians(2.0)  # by which an axis of the tool must be nearer than one of the base
LEAST_TURN_RAD_PER_S = 0.1  # of `set_position_aa`: XArm.__get_tcp_motion_params of SDK 1.18.4
DIGITS = 6
BASE, TOOL = 0, 1  # frames of the force controller


def xarm_script(program: ProgramFile) -> str:
    """Return the script's text.

    Raises ValueError for a robot of another maker, a gripper that the SDK cannot drive, an app beyond the
    limits, a force along no axis, or a number that is not finite.
    """
    robot = robot_of_script(program, "xarm", "an xArm script is for UFACTORY's arms")
    title = "an arm of UFACTORY" if robot is None else robot.title
    acceleration = within_robot(ACCELERATION_M_PER_S2, robot)
    refuse_beyond_limits(program)
    program = with_held_loads(program)
    planned = list(planned_apps(program, acceleration))
    rows = [_row(one, program) for one in planned]
    texts = {
        "<NAME>": title_of(program),
        "<ROBOT>": in_docstring(title),
        "<LEGS>": LEGS,
        "<FINDINGS>\n": _fingers_comment(program) + head_comments(program),
        "<LIMITS>": "\n".join(acting_limits(program)),
        "<ACCELERATION>": f"{acceleration:g}",
        "<APPS>": table_of_apps(
            program, rows, 106, [[*_leaning(one.app), *_hurried(one)] for one in planned]
        ),
    }
    return filled_template("xarm_template.py.txt", texts)


def _row(planned: PlannedApp, program: ProgramFile) -> dict[str, Any]:
    """Return the data of an app that the script needs."""
    app = planned.app
    row: dict[str, Any] = {
        "kind": app.kind,
        "title": step_title(app.kind, app.name, app.target_name),
        "pause": round(planned.pause_s, 3),
        "wait": round(planned.wait_s, 3),
        "stay": round(planned.stay_s, 3),
        "hold": round(planned.hold_s, 3),
    }
    row["legs"] = [
        (
            _pose(leg.position, leg.orientation),
            _rounded(leg.speed_m_per_s),
            _rounded(leg.turn_rad / leg.seconds),
            _rounded(leg.blend_m),
        )
        for leg in planned.legs
    ]
    if planned.start is not None:
        row["start"] = _pose(*planned.start)
    if planned.contact is not None:
        row["contact"], row["clear"] = tuple(map(_rounded, planned.contact)), planned.clear_legs
        row["taught"] = tuple(map(_rounded, app.target or ()))
    if APP_KINDS[app.kind].carries:
        row["load_kg"] = round(app.load_kg or 0.0, 3)
    if app.kind == "apply_force" and app.force is not None:
        row["force"] = frame, axis, newtons = _force(planned.name, app)
        row |= felt_with_friction(program.apps[planned.place])
        row["push"] = tuple(_rounded(value / abs(newtons)) for value in app.force)
        begins = planned.begins or app.target or (0.0, 0.0, 0.0)
        ends = [leg.position for leg in planned.legs] or [app.target or begins]
        row["way"] = [tuple(map(_rounded, place)) for place in (begins, *ends)]
        for name, rest in (("wait_force", app.rest_before), ("hold_force", app.rest_after)):
            if rest is not None:
                row[name] = frame, axis, round(math.copysign(rest.newton, newtons), 3)
    if app.kind in GRIPS:
        row |= _grip(planned, program)
    most_nm = stop_torque_nm(app.screw)
    if app.screw is not None and most_nm is not None:
        row["tight"] = tuple(app.screw.axis), tuple(app.screw.point), _rounded(most_nm)
    return row


def _grip(planned: PlannedApp, program: ProgramFile) -> dict[str, Any]:
    """Return the data of an action of the gripper; a grasp that eases the grip opens the fingers first."""
    held_by = gripper_of(program)
    row: dict[str, Any] = {"fingers": _fingers(planned, held_by, program.safety)}
    if planned.stands is not None:
        row["stands"] = tuple(map(_rounded, planned.stands))
    if planned.place in eased_grasps(program.apps):
        opened = planned._replace(app=planned.app.model_copy(update={"kind": "gripper_move"}))
        row["eased"] = _fingers(opened, held_by, program.safety)
    return row


def _force(name: str, app: App) -> tuple[int, int, float]:
    """Return the frame and axis nearest to the force of an app, and the force [N] along it.

    Raises ValueError if its angle to all axes exceeds `MOST_LEAN_RAD`.
    """
    frame, axis, lean_rad, newtons = _axis(app)
    if lean_rad > MOST_LEAN_RAD:
        leans = f"its force leans by {math.degrees(lean_rad):.1f}° from {_axis_in_words(frame, axis)}"
        most = f"at most {math.degrees(MOST_LEAN_RAD):.0f}°"
        raise ValueError(f"{name}: {leans}, {most}: teach it again, pushing along the axis of the tool")
    return frame, axis, newtons


def _axis(app: App) -> tuple[int, int, float, float]:
    """Return a frame, its axis, the angle of an app's force to it [rad], and the force [N] along it.

    If the path tilts the tool, the axis is one of the tool.
    """
    force, orientation = app.force or (0.0, 0.0, 0.0), orientation_halfway(app)
    newtons, in_tool = math.hypot(*force), force_in_tool(app)
    if in_tool is not None and orientation is not None:
        x, y, z = (matrix_of(orientation) @ in_tool).tolist()
        force = (x, y, z)
    base = (BASE, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    tool = (TOOL, () if orientation is None else matrix_of(orientation).T.tolist())
    found = []
    for frame, axes in (base, tool) if in_tool is None else (tool,):
        for number, axis in enumerate(axes):
            along = sum(a * b for a, b in zip(axis, force, strict=True))
            lean = math.acos(min(abs(along) / newtons, 1.0))
            found.append((frame, number, lean, round(math.copysign(newtons, along), 3)))
    return min(found, key=lambda one: one[2] + SAME_RAD * one[0])


def _axis_in_words(frame: int, axis: int) -> str:
    return f"the axis {'xyz'[axis]} of the {'tool' if frame == TOOL else 'base'}"


def _leaning(app: App) -> list[str]:
    """Return a warning on a force that leans from the axis along which it presses; else no line."""
    if app.kind != "apply_force":
        return []
    frame, axis, lean_rad, _ = _axis(app)
    said = f"its force leans by {math.degrees(lean_rad):.0f}° from {_axis_in_words(frame, axis)}"
    return [f"warning: {said}, along which it presses"] if lean_rad > NAMED_LEAN_RAD else []


def _hurried(planned: PlannedApp) -> list[str]:
    """Return a warning on turns in place that are slower than the SDK turns; else no line."""
    rates = [leg.turn_rad / leg.seconds for leg in planned.legs if leg.speed_m_per_s is None]
    slowest = min((rate for rate in rates if rate > 0.0), default=math.inf)
    if slowest >= LEAST_TURN_RAD_PER_S:
        return []
    least = f"the SDK turns in place with at least {LEAST_TURN_RAD_PER_S:g} rad/s"
    return [f"warning: it turns in place with {slowest:.3f} rad/s, and {least}: its turn takes less time"]


def _pose(place: Vector, orientation: Quaternion | None) -> tuple[float, ...]:
    turn: Sequence[float] = () if orientation is None else rotation_vector(orientation)
    return tuple(round(value, DIGITS) for value in (*place, *turn))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, DIGITS)


# --- Grippers ---------------------------------------------------------------------------------------------


def _count(held_by: GripperDescription, app: App) -> int:
    width = app.gripper_width
    if app.kind == "grasp":
        return held_by.count(max((width or 0.0) - WIDTH_MARGIN_M, 0.0))
    return held_by.count(held_by.opening_m or 0.0 if width is None else width)


def _robotiq(held_by: GripperDescription, app: App, safety: Safety) -> tuple[Any, ...]:
    speed, force = held_by.register_counts(safety.gripper_m_per_s, safety.grasp_force_n)
    return "robotiq", _count(held_by, app), speed, force


def _xarm(held_by: GripperDescription, app: App, safety: Safety) -> tuple[Any, ...]:
    if held_by.kind == "suction":
        return ("vacuum",)
    return "xarm", _count(held_by, app), held_by.count(held_by.opening_m or 0.0)


FINGERS: Mapping[str, Callable[[GripperDescription, App, Safety], tuple[Any, ...]]] = {
    "robotiq": _robotiq,
    "xarm": _xarm,
}


def _fingers_comment(program: ProgramFile) -> str:
    """Return a line of comment if the gripper has neither the force nor the speed of the cell; else none."""
    held_by, safety = gripper_of(program), program.safety
    drives_own = held_by is not None and held_by.interface == "xarm" and held_by.kind == "fingers"
    if not drives_own or not any(app.kind in GRIPS for app in program.apps):
        return ""
    cell = f"{safety.grasp_force_n:g} N and {safety.gripper_m_per_s:g} m/s of the cell"
    return f"# warning: force and speed of the fingers are those set at the gripper, not the {cell}\n"


def _fingers(planned: PlannedApp, held_by: GripperDescription | None, safety: Safety) -> tuple[Any, ...]:
    call = None if held_by is None else FINGERS.get(held_by.interface or "")
    if held_by is None or call is None:
        raise ValueError(not_driven(planned.name, "the SDK", held_by, FINGERS))
    return call(held_by, planned.app, safety)

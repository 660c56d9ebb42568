"""Writes a program as URScript, for an arm of Universal Robots.

Every app is written as separate lines; common functions are in a template (`ur_template.script.txt`). Free
movements are `movel` with blends, movements along a surface `movep` in force mode, and the first movement is
a `movej`. A movement that a contact or a torque ends runs in a thread, which is then killed. URScript
functions are those of the script manual for PolyScope 5. Poses are the flange's, in the controller's base
frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from textwrap import indent

import numpy as np

from caesura_protocol.app_kinds import APP_KINDS, app_name, step_title
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.contact_forces import force_in_tool
from caesura_protocol.programs.document import ProgramFile, joint_count_mismatch
from caesura_protocol.programs.export_limits import (
    acting_limits,
    hardest_n,
    refuse_beyond_limits,
    within_robot,
)
from caesura_protocol.programs.held_grasps import eased_grasps
from caesura_protocol.programs.planned_apps import LEAST_PAUSE_S, PlannedApp, planned_apps
from caesura_protocol.programs.program_gripper import GRIPS, SHUT_M, gripper_of, not_driven, with_held_loads
from caesura_protocol.programs.script_templates import (
    filled_template,
    findings_as_comments,
    group_comments,
    head_comments,
    one_line,
    robot_of_script,
    title_of,
)
from caesura_protocol.programs.straight_legs import LEGS, Leg, Quaternion
from caesura_protocol.robots import GripperDescription
from caesura_protocol.rotations import align_signs, matrix_of, rotation_vector
from caesura_protocol.screw_torque_and_text import stop_torque_nm

ACCELERATION_M_PER_S2 = 1.2  # as movel has it where none is stated
GRAVITY_M_PER_S2 = 9.82  # as the controller's installation has it; the vector points away from the ground
WIDTH_MARGIN_M = 0.01  # by which the fingers are sent on past the width of what they grasp
JOINTS = 6  # of every arm of the maker
PERIOD_S = 0.02  # between two looks at the depth of a press
SLIDE_M = 0.005  # a way that is longer, in contact, is one along a surface
LEAST_BLEND_M = 0.0001  # below it two blends could overlap by the rounding of the script's numbers
INDENT = "  "


def ur_script(program: ProgramFile) -> str:
    """Return the script's text.

    Raises ValueError for a robot of another maker, a gripper that URScript cannot drive, an app beyond the
    limits, or a number that is not finite.
    """
    robot = robot_of_script(program, "urscript", "URScript is for Universal Robots")
    title = "an arm of Universal Robots" if robot is None else robot.title
    acceleration = within_robot(ACCELERATION_M_PER_S2, robot)
    refuse_beyond_limits(program)
    if wrong := joint_count_mismatch(program, title, JOINTS):
        raise ValueError(wrong)
    program = with_held_loads(program)
    writer = _Writer(program)
    lines = [line for app in planned_apps(program, acceleration) for line in writer.lines(app)]
    texts = {
        "<NAME>": title_of(program),
        "<ROBOT>": one_line(title),
        "<LEGS>": LEGS,
        "<FINDINGS>\n": indent(head_comments(program), INDENT),
        "<LIMITS>": "\n".join(f"{INDENT}{line}" for line in acting_limits(program)),
        "<HARDEST_N>": f"{hardest_n(program):.3f}",
        "<GRAVITY>\n": _gravity(program),
        "<UP>": _list((0.0, 0.0, 1.0) if program.up is None else program.up),
        "<ACCELERATION>": f"{acceleration:g}",
        "<GRIPPER>": "\n".join(_gripper_functions(program)),
        "<APPS>": "\n".join(f"{INDENT}{line}" if line else "" for line in lines),
    }
    return _ascii(_indented(filled_template("ur_template.script.txt", texts)))


def _gravity(program: ProgramFile) -> str:
    """Return the line that sets the stated mounting.

    Empty without one, so that the installation's setting applies.
    """
    if program.up is None:
        return ""
    away = _list([GRAVITY_M_PER_S2 * value for value in program.up])
    return f"{INDENT}set_gravity({away})  # [m/s2] away from the ground, as this program states it\n"


def _indented(text: str) -> str:
    """Return a script whose empty lines are comments: the controller needs an indentation in every line.

    "All other script lines must be indented by at least one white space" (script manual, Connecting to
    URControl). The script begins with its `def`, and ends with its `end`.
    """
    return "".join(f"{line or f'{INDENT}#'}\n" for line in text.splitlines())


def _ascii(text: str) -> str:
    """Return a script in ASCII, as the controller needs it: other characters occur only in comments.

    They become their codes, so that two names stay two.
    """
    for mark, word in (("°", " degrees"), ("–", " to "), ("±", "+-")):
        text = text.replace(mark, word)
    return text.encode("ascii", "backslashreplace").decode("ascii")


def _string_name(planned: PlannedApp) -> str:
    """Return an app's name as the content of a string, or its kind where that needs more than ASCII."""
    name = planned.app.name
    is_plain = name is not None and name.isascii() and name.isprintable() and not {'"', "\\"} & set(name)
    return app_name(planned.place, planned.app.kind, name if is_plain else None)


class _Writer:
    """Writes the lines of planned apps."""

    def __init__(self, program: ProgramFile) -> None:
        self._gripper = gripper_of(program)
        self._eased = eased_grasps(program.apps)
        self._comments, self._groups = findings_as_comments(program), group_comments(program)

    def lines(self, planned: PlannedApp) -> list[str]:
        """Return the lines of an app, and of the pause after it."""
        app = planned.app
        lines = ["", self._groups[planned.place]] if planned.place in self._groups else []
        lines += ["", f"# {one_line(planned.name)}, {app.tn - app.t0:.2f} s"]
        if app.name or app.target_name:
            lines.append(f"# called: {step_title(app.kind, app.name, app.target_name)}")
        lines += [f"# {comment}" for comment in self._comments.get(planned.place, ())]
        lines += [f'begin_app("{_string_name(planned)}")']
        if app.kind == "apply_force":
            lines += self._force(planned)
        elif app.kind in GRIPS:
            lines += self._grip(planned)
        else:
            lines += self._way(planned)
        return lines + ([f"sleep({planned.pause_s:.3f})"] if planned.pause_s >= LEAST_PAUSE_S else [])

    def _way(self, planned: PlannedApp) -> list[str]:
        app, held = planned.app, self._check_held(planned.app)
        lines = list(held)
        if APP_KINDS[app.kind].carries:
            lines.append(f"carry({app.load_kg or 0.0:.3f})")
        if planned.start is not None:
            near = "get_actual_joint_positions()" if app.joints is None else _list(app.joints)
            pose = _pose(*planned.start)
            lines.append(f"movej(get_inverse_kin({pose}, {near}), a=0.5, v=START_RAD_PER_S)")
        moves = [_move(leg, "movel") for leg in planned.legs]
        rest = [f"sleep({planned.hold_s:.3f})"] if planned.hold_s >= LEAST_PAUSE_S else []
        if planned.contact is None:
            return [*lines, *self._watched(planned.place, moves, self._tightness(app)), *rest, *held]
        lines += rest
        if planned.clear_legs is not None:
            lines += [*moves[: planned.clear_legs], "zero_wrench()"]
            moves = moves[planned.clear_legs :]
        lines += self._watched(planned.place, moves, "felt() < CONTACT_FORCE_N")
        lines += [] if moves else ["global arrived = True"]
        return [*lines, *held, f"search_contact({_list(app.target or ())}, {_list(planned.contact)})"]

    def _check_held(self, app: App) -> list[str]:
        """Return the check for a held object if an app carries and the gripper reports one; else no line."""
        driven = self._gripper is not None and self._gripper.interface == "robotiq"
        return ["check_held()"] if driven and APP_KINDS[app.kind].carries else []

    def _tightness(self, app: App) -> str | None:
        """Return the condition to continue a turn: a torque below its stop; None without a stop."""
        most_nm = stop_torque_nm(app.screw)
        if app.screw is None or most_nm is None:
            return None
        return f"torque_about({_list(app.screw.axis)}, {_list(app.screw.point)}) < {most_nm:.4f}"

    def _watched(self, index: int, moves: Sequence[str], condition: str | None) -> list[str]:
        """Return lines that move while a condition holds; without one, the movements unchanged."""
        if condition is None or not moves:
            return list(moves)
        thread = f"way_{index + 1}"
        return [
            f"thread {thread}():",
            *(f"{INDENT}{move}" for move in moves),
            f"{INDENT}global arrived = True",
            "end",
            "global arrived = False",
            f"moving = run {thread}()",
            f"while not arrived and {condition}:",
            f"{INDENT}sync()",
            "end",
            "kill moving",
            "stopl(2.0)",
        ]

    def _force(self, planned: PlannedApp) -> list[str]:
        app, number = planned.app, planned.place + 1
        force = app.force or (0.0, 0.0, 0.0)
        newtons, name = math.hypot(*force), f"held_{number}"
        begins = planned.begins or app.target or (0.0, 0.0, 0.0)
        first, last = _directions(app)
        ends = begins if planned.legs else app.target or begins
        lines = [f"begin_press({_list(first)}, {_list(begins)}, {_list(ends)})"]
        given = ""
        for seconds, wanted_n, direction, moves in (
            (planned.wait_s, planned.wait_n, first, []),
            (planned.stay_s, newtons, first, _press_moves(app, begins, planned.legs)),
            (planned.hold_s, planned.hold_n, last, []),
        ):
            held, wanted = _held(name, seconds, "check_press()"), _begin_force(direction, wanted_n)
            if wanted != given and (held or moves):
                lines.append(wanted)
                given = wanted
            tight = self._tightness(app)
            beyond = "beyond() < SEARCH_M"
            lines += self._watched(planned.place, moves, beyond if tight is None else f"{beyond} and {tight}")
            lines += ["check_press()"] if moves else held
        return [*lines, "end_force_mode()", "stopl(2.0)"]

    def _grip(self, planned: PlannedApp) -> list[str]:
        held_by, calls = self._gripper, None
        if held_by is not None:
            calls = GRIPPER_CALLS.get(held_by.interface or "")
        if held_by is None or calls is None:
            raise ValueError(not_driven(planned.name, "URScript", held_by, GRIPPER_CALLS))
        lines = [] if planned.stands is None else [f"check_stands({_list(planned.stands)})"]
        lines += calls(held_by, planned.app, planned.place in self._eased)
        return [*lines, *(["carry(0.0)"] if planned.app.kind == "gripper_move" else [])]


def _press_moves(app: App, begins: Vector, legs: Sequence[Leg]) -> list[str]:
    """Return the movements of a press.

    Before each, `leg` is set to the two ends of its leg, beyond which the flange is not pushed far.
    If the path tilts the tool, the force turns with it from leg to leg.
    """
    kind = "movep" if app.path is not None and app.path.length_m >= SLIDE_M else "movel"
    moves, in_tool, newtons = [], force_in_tool(app), math.hypot(*(app.force or ()))
    turned = None if app.path is None else app.path.start.orientation
    for leg in legs:
        moves.append(f"global leg = {_list((*begins, *leg.position))}")
        if in_tool is not None and turned is not None and leg.orientation is not None:
            both = np.array([turned, leg.orientation])
            align_signs(both)
            push = _turned(in_tool, (both.sum(axis=0) / np.linalg.norm(both.sum(axis=0))).tolist())
            moves += [f"global push = {_list(push)}", _begin_force(push, newtons)]
        moves.append(_move(leg, kind))
        begins, turned = leg.position, leg.orientation
    return moves


def _begin_force(direction: Vector, newtons: float) -> str:
    return f"begin_force({_pose((0.0, 0.0, 0.0), _z_along(direction))}, {newtons:.3f})"


def _directions(app: App) -> tuple[Vector, Vector]:
    """Return the unit vectors of a press before its path begins and after it has ended, base frame."""
    in_tool, force = force_in_tool(app), app.force or (0.0, 0.0, 0.0)
    if in_tool is None or app.path is None or app.path.start.orientation is None or app.orientation is None:
        return _unit(force), _unit(force)
    return _turned(in_tool, app.path.start.orientation), _turned(in_tool, app.orientation)


def _turned(in_tool: Vector, orientation: Sequence[float]) -> Vector:
    x, y, z = (matrix_of(orientation) @ in_tool).tolist()
    return _unit((x, y, z))


def _unit(vector: Vector) -> Vector:
    length = math.hypot(*vector)
    return vector[0] / length, vector[1] / length, vector[2] / length


def _held(name: str, seconds: float, each: str) -> list[str]:
    """Return lines that repeat a line every period for some seconds; none for less than half a period."""
    steps = round(seconds / PERIOD_S)
    if not steps:
        return []
    return [
        f"{name} = 0",
        f"while {name} < {steps}:",
        f"{INDENT}{each}",
        f"{INDENT}{name} = {name} + 1",
        f"{INDENT}sleep({PERIOD_S})",
        "end",
    ]


def _move(leg: Leg, kind: str) -> str:
    how = f"t={leg.seconds:.3f}"
    if leg.speed_m_per_s is not None:
        how = f"a=ACCELERATION, v=limited({leg.speed_m_per_s:.6f})"
    kind = "movel" if leg.speed_m_per_s is None else kind  # movep takes no time
    blend = f", r={leg.blend_m:.6f}" if leg.blend_m >= LEAST_BLEND_M else ""
    return f"{kind}({_pose(leg.position, leg.orientation)}, {how}{blend})"


def _pose(place: Vector, orientation: Quaternion | None) -> str:
    if orientation is None:
        return f"here({_list(place)})"
    return f"p{_list((*place, *rotation_vector(orientation)))}"


def _list(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.6f}' for value in values)}]"


def _z_along(direction: Vector) -> Quaternion:
    """Return a rotation that turns z into a direction of unit length."""
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    length = math.sqrt(2.0 * (1.0 + z))
    return (-y / length, x / length, 0.0, 0.5 * length)


# --- Grippers ---------------------------------------------------------------------------------------------


def _robotiq(held_by: GripperDescription, app: App, eases: bool) -> list[str]:
    width = app.gripper_width
    opened = [f"gripper_go({held_by.count(held_by.opening_m or 0.0 if width is None else width)})"]
    if app.kind == "grasp":
        count = held_by.count(max((width or 0.0) - WIDTH_MARGIN_M, 0.0))
        return [
            *(opened if eases else []),  # a grasp only closes the fingers
            f"if gripper_go({count}) != 2:",
            f'{INDENT}stop_program("nothing between the fingers")',
            "end",
        ]
    return opened


def _digital_output(held_by: GripperDescription, app: App, _eases: bool) -> list[str]:
    shuts = held_by.kind == "fingers" and app.gripper_width is not None and app.gripper_width <= SHUT_M
    return [f"set_standard_digital_out({held_by.output}, {app.kind == 'grasp' or shuts})", "sleep(0.5)"]


GRIPPER_CALLS: Mapping[str, Callable[[GripperDescription, App, bool], list[str]]] = {
    "robotiq": _robotiq,
    "digital_output": _digital_output,
}

_ROBOTIQ_FUNCTIONS = """\
  # The gripper, by the socket of Robotiq's URCap on the controller.
  def gripper_set(name, value):
    socket_set_var(name, value, "gripper")
    sync()
    socket_read_byte_list(3, "gripper")  # ack
  end

  def gripper_go(count):
    # until it stops: 1 stopped while opening, 2 while closing, 3 at the count
    gripper_set("POS", count)
    gripper_set("GTO", 1)
    sleep(0.1)
    local waited = 0
    local stopped = socket_get_var("OBJ", "gripper")
    while stopped == 0:
      if waited > 100:
        stop_program("the gripper does not stop")
      end
      sleep(0.05)
      waited = waited + 1
      stopped = socket_get_var("OBJ", "gripper")
    end
    return stopped
  end

  def check_held():
    # what is held may slip out or fall: the fingers then close further, and the gripper says so
    if socket_get_var("OBJ", "gripper") != 2:
      stop_program("nothing between the fingers any more")
    end
  end

  if not socket_open("127.0.0.1", 63352, "gripper"):
    stop_program("no gripper at the controller's socket")
  end
  if socket_get_var("STA", "gripper") != 3:
    stop_program("the gripper is not activated")
  end
"""


def _gripper_functions(program: ProgramFile) -> list[str]:
    held_by = gripper_of(program)
    if held_by is None or held_by.interface != "robotiq":
        return []
    if not any(app.kind in GRIPS for app in program.apps):
        return []
    counts = held_by.register_counts(program.safety.gripper_m_per_s, program.safety.grasp_force_n)
    lines = [_ROBOTIQ_FUNCTIONS.rstrip()]
    lines += [
        f'{INDENT}gripper_set("{name}", {count})' for name, count in zip(("SPE", "FOR"), counts, strict=True)
    ]
    return [*lines, ""]

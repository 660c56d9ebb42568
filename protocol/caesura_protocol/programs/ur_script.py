"""A program as URScript, for an arm of Universal Robots.

Every app is written out, in lines that stand alone; what they share is a template (`ur_template.script.txt`).
Free ways are `movel` with blends, ways along a surface `movep` in force mode, and the first way is a `movej`.
A movement that a contact or a torque ends runs in a thread, which is killed then. Functions of URScript are
those of the script manual for PolyScope 5. Poses are the flange's, in the controller's base frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files

from caesura_protocol.app_kinds import APP_KINDS, app_name, ends_in_contact
from caesura_protocol.messages import App, Vector
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import CONSTANTS
from caesura_protocol.programs.gripping import gripper_of
from caesura_protocol.programs.limits import press_direction, refuse_beyond_limits
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.straight_legs import Leg, Quaternion, straight_legs
from caesura_protocol.robots import GripperDescription, grippers, robot_description
from caesura_protocol.rotations import rotation_vector
from caesura_protocol.screw_motion import stop_torque_nm

STANDOFF_M = 0.02
DEPTH_M = 0.05
ACCELERATION_M_PER_S2 = 1.2  # as movel has it where none is stated
WIDTH_MARGIN_M = 0.01  # by which the fingers are sent on past the width of what they grasp
LEAST_PAUSE_S = 0.05
PERIOD_S = 0.02  # between two looks at the depth of a press
SLIDE_M = 0.005  # a way that is longer, in contact, is one along a surface
ACTING = (  # limits on which the running script acts; the others are kept when it is written
    "MAX_SPEED_M_PER_S",
    "CONTACT_SPEED_M_PER_S",
    "MAX_FORCE_N",
    "STOP_FORCE_N",
    "CONTACT_FORCE_N",
    "SEARCH_M",
)
GRIPS = ("grasp", "gripper_move")
INDENT = "  "


def ur_script(program: ProgramFile) -> str:
    """The script's text.

    Raises ValueError for a robot of another maker, a gripper that URScript cannot drive, an app beyond the
    limits, or a number that is not finite.
    """
    title, acceleration = "an arm of Universal Robots", ACCELERATION_M_PER_S2
    if program.robot is not None:
        robot = robot_description(program.robot)
        if robot.script != "urscript":
            raise ValueError(f"URScript is for Universal Robots, and its robot is {program.robot}")
        title, acceleration = robot.title, min(acceleration, 0.5 * robot.flange_acceleration_limit)
    program.as_json()  # refuses what is not finite
    refuse_beyond_limits(program)
    template = files("caesura_protocol.programs").joinpath("ur_template.script.txt").read_text("utf-8")
    lines = [line for app in _apps(program, acceleration) for line in app]
    filled = {
        "<NAME>": f"{program.station}/{program.session}, revision {program.revision}",
        "<ROBOT>": title,
        "<LIMITS>": "\n".join(_limits(program.safety)),
        "<STANDOFF>": f"{STANDOFF_M}",
        "<DEPTH>": f"{DEPTH_M}",
        "<ACCELERATION>": f"{acceleration:g}",
        "<GRIPPER>": "\n".join(_gripper_functions(program)),
        "<APPS>": "\n".join(f"{INDENT}{line}" if line else "" for line in lines),
    }
    for mark, text in filled.items():
        template = template.replace(mark, text)
    return template


def _limits(safety: Safety) -> Iterator[str]:
    for name in ACTING:
        field, why = CONSTANTS[name]
        yield f"{INDENT}{name} = {getattr(safety, field):g}  # {why}"


def _apps(program: ProgramFile, acceleration: float) -> Iterator[list[str]]:
    """The lines of one app after another."""
    writer = _Writer(program, acceleration)
    for index, app in enumerate(program.apps):
        following = program.apps[index + 1] if index + 1 < len(program.apps) else None
        yield writer.app(index, app, following)


class _Writer:
    """Writes apps; keeps where the flange is."""

    def __init__(self, program: ProgramFile, acceleration: float) -> None:
        self._safety = program.safety
        self._gripper = gripper_of(program)
        self._acceleration = acceleration
        self._place: Vector | None = None  # at the end of the last movement

    def app(self, index: int, app: App, following: App | None) -> list[str]:
        """The lines of an app, and the pause after it."""
        name = app_name(index, app.kind)
        lines = ["", f"# {name}, {app.tn - app.t0:.2f} s as taught", f'textmsg("{name}")']
        if app.kind == "apply_force":
            lines += self._force(index, app)
        elif app.kind in GRIPS:
            lines += self._grip(index, app)
        else:
            lines += self._way(index, app, following)
        if app.target is not None:
            self._place = app.target
        pause = 0.0 if following is None else min(following.t0 - app.tn, self._safety.pause_s)
        return lines + ([f"sleep({pause:.3f})"] if pause >= LEAST_PAUSE_S else [])

    def _way(self, index: int, app: App, following: App | None) -> list[str]:
        lines = []
        if APP_KINDS[app.kind].carries:
            lines.append(f"set_payload(tool_kg + {app.load_kg or 0.0:.3f}, tool_cog)")
        if not ends_in_contact(app.kind, None if following is None else following.kind):
            start, legs = self._begun(app, self._legs(app))
            moves = [_move(leg, "movel") for leg in legs]
            return lines + start + self._watched(index, moves, self._tightness(app))
        direction = press_direction(app, following)
        x, y, z = (STANDOFF_M * value for value in direction)
        start, legs = self._begun(app, self._legs(app, (x, y, z)))
        moves = [_move(leg, "movel") for leg in legs]
        lines += [*start, "zero_wrench()", *self._watched(index, moves, "felt() < CONTACT_FORCE_N")]
        return [*lines, f"search_contact({_list(direction)})"]

    def _legs(self, app: App, short: Vector | None = None) -> list[Leg]:
        return straight_legs(app, self._place, self._safety, self._acceleration, stop_short=short)

    def _begun(self, app: App, legs: list[Leg]) -> tuple[list[str], list[Leg]]:
        """By the joints to where a program begins, slowly, and the legs that remain then."""
        if self._place is not None:
            return [], legs
        place, orientation = legs[0].position, legs[0].orientation
        if app.path is not None:
            place, orientation = app.path.start.position, app.path.start.orientation
        near = "get_actual_joint_positions()" if app.joints is None else _list(app.joints)
        line = f"movej(get_inverse_kin({_pose(place, orientation)}, {near}), a=0.5, v=START_RAD_PER_S)"
        return [line], [] if app.path is None else legs

    def _tightness(self, app: App) -> str | None:
        """The condition under which a turn goes on."""
        most_nm = stop_torque_nm(app.screw)
        if app.screw is None or most_nm is None:
            return None
        return f"torque_about({_list(app.screw.axis)}, {_list(app.screw.point)}) < {most_nm:.4f}"

    def _watched(self, index: int, moves: Sequence[str], condition: str | None) -> list[str]:
        """Movements that end where a condition no longer holds; without one, as they are."""
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

    def _force(self, index: int, app: App) -> list[str]:
        if app.force is None:
            raise ValueError(f"{app_name(index, app.kind)} has no force")
        newtons = math.hypot(*app.force)
        direction: Vector = tuple(x / newtons for x in app.force)  # type: ignore[assignment]
        frame = _pose((0.0, 0.0, 0.0), _z_along(direction))
        began = f"began_{index + 1}"
        lines = [f"{began} = get_actual_tcp_pose()", f"begin_force({frame}, {newtons:.3f})"]
        if app.path is None:
            steps = max(round((app.tn - app.t0) / PERIOD_S), 1)
            lines += [
                f"held_{index + 1} = 0",
                f"while held_{index + 1} < {steps}:",
                f"{INDENT}check_depth({began}, {_list(direction)})",
                f"{INDENT}held_{index + 1} = held_{index + 1} + 1",
                f"{INDENT}sleep({PERIOD_S})",
                "end",
            ]
        else:
            slides = app.path.length_m >= SLIDE_M
            moves = [_move(leg, "movep" if slides else "movel") for leg in self._legs(app)]
            lines += self._watched(index, moves, self._tightness(app))
        return [*lines, "end_force_mode()", "stopl(2.0)"]

    def _grip(self, index: int, app: App) -> list[str]:
        calls = None if self._gripper is None else GRIPPER_CALLS.get(self._gripper.interface or "")
        if self._gripper is None or calls is None:
            known = [name for name, one in grippers().items() if one.interface in GRIPPER_CALLS]
            title = "no gripper" if self._gripper is None else f"a {self._gripper.title}"
            expected = f"expected --gripper {', '.join(known)}"
            raise ValueError(f"{app_name(index, app.kind)}: URScript drives {title}, {expected}")
        lines = calls(self._gripper, app)
        if app.kind == "gripper_move":
            lines.append("set_payload(tool_kg, tool_cog)")
        return lines


def _move(leg: Leg, kind: str) -> str:
    how = (
        f"t={leg.seconds:.3f}" if leg.speed_m_per_s is None else f"a=ACCELERATION, v={leg.speed_m_per_s:.4f}"
    )
    kind = "movel" if leg.speed_m_per_s is None else kind  # movep takes no time
    blend = f", r={leg.blend_m:.4f}" if leg.blend_m > 0.0 else ""
    return f"{kind}({_pose(leg.position, leg.orientation)}, {how}{blend})"


def _pose(place: Vector, orientation: Quaternion | None) -> str:
    if orientation is None:
        return f"here({_list(place)})"
    return f"p{_list((*place, *rotation_vector(orientation)))}"


def _list(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:.6f}' for value in values)}]"


def _z_along(direction: Vector) -> Quaternion:
    """A rotation that turns z into a direction of unit length."""
    x, y, z = direction
    if z < -1.0 + 1e-9:
        return (1.0, 0.0, 0.0, 0.0)
    length = math.sqrt(2.0 * (1.0 + z))
    return (-y / length, x / length, 0.0, 0.5 * length)


# --- Grippers ---------------------------------------------------------------------------------------------


def _robotiq(held_by: GripperDescription, app: App) -> list[str]:
    width = app.gripper_width
    if app.kind == "grasp":
        count = held_by.count(max((width or 0.0) - WIDTH_MARGIN_M, 0.0))
        return [
            f"if gripper_go({count}) != 2:",
            f'{INDENT}stop_program("nothing between the fingers")',
            "end",
        ]
    return [f"gripper_go({held_by.count(held_by.opening_m or 0.0 if width is None else width)})"]


def _digital_output(held_by: GripperDescription, app: App) -> list[str]:
    return [f"set_standard_digital_out({held_by.output}, {app.kind == 'grasp'})", "sleep(0.5)"]


GRIPPER_CALLS: Mapping[str, Callable[[GripperDescription, App], list[str]]] = {
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
    force, speed = held_by.clamped(program.safety.grasp_force_n, program.safety.gripper_m_per_s)
    shares = {
        "SPE": (speed, held_by.least_speed_m_per_s, held_by.speed_m_per_s or speed),
        "FOR": (force, held_by.least_force_n, held_by.force_n or force),
    }
    lines = [_ROBOTIQ_FUNCTIONS.rstrip()]
    for name, (value, least, most) in shares.items():
        count = round(255 * (value - least) / (most - least)) if most > least else 255
        lines.append(f'{INDENT}gripper_set("{name}", {count})')
    return [*lines, ""]

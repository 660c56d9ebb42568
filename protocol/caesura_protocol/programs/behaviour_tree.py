"""Writes a program as a behaviour tree for BehaviorTree.CPP 4: one sequence, one action per app, typed ports.

The apps of a group are a sequence within it, with the group's name.
Lists of numbers have semicolons, as in its text form of a `std::vector<double>`. The node registered under an
action's name implements it (https://www.behaviortree.dev, "The XML format"). Pauses between apps are `Sleep`,
a node of the library. Comments have the robot, the name of the program, the notes of apps and the findings of
a check.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml

import numpy as np

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_force_limit import is_path_limited
from caesura_protocol.app_kinds import APP_KINDS, AppKind, app_number, step_title
from caesura_protocol.messages import AppPath
from caesura_protocol.programs.app_time_shifts import goes_on, rests_of
from caesura_protocol.programs.apps_by_phase import groups_by_first
from caesura_protocol.programs.document import ProgramFile, ProgramStep
from caesura_protocol.programs.export_limits import refuse_impossible
from caesura_protocol.programs.planned_apps import LEAST_PAUSE_S, pause_between
from caesura_protocol.programs.program_gripper import gripper_of, within_gripper
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.script_templates import findings_by_app, texts_of_people
from caesura_protocol.reproduced_path import turning_at_points
from caesura_protocol.robots import GripperDescription, GripperError, RobotError
from caesura_protocol.screw_torque_and_text import torque_about_axis

DOUBLE, DOUBLES = "double", "std::vector<double>"
TREE = "Task"
DIGITS = 7  # of a number: a place up to 10 m is stated to 1 µm
NO_XML = re.compile("[\x00-\x1f\ufffe\uffff]")  # no XML has these, not even as a reference


class Port(NamedTuple):
    """An input of an action: its name, its C++ type, and its meaning."""

    name: str
    type: str
    meaning: str


TARGET = Port("target", DOUBLES, "x;y;z of the flange in the base frame [m]")
ORIENTATION = Port("orientation", DOUBLES, "x;y;z;w of the flange in the base frame")
JOINTS = Port("joints", DOUBLES, "the joints as they were taught [rad]")
SECONDS = Port("seconds", DOUBLE, "how long it lasts [s]")
FORCE = Port("force", DOUBLES, "x;y;z that the robot exerts, base frame [N]")
WIDTH = Port("width", DOUBLE, "between the fingers [m]")
LOAD = Port("load", DOUBLE, "what is carried [kg]")
SPEED = Port("max_speed", DOUBLE, "limit of the flange's speed [m/s]")
TURN = Port("max_turn", DOUBLE, "limit of the flange's rate of turn [rad/s]")
MOST = Port("max_force", DOUBLE, "force at which to stop [N]")
CONTACT = Port(
    "contact_force", DOUBLE, "force from which a contact is one [N]; without it none is looked for"
)
SLOW = Port("contact_speed", DOUBLE, "speed at which a contact is looked for [m/s]")
SEARCH = Port("search", DOUBLE, "how far past the target a contact is looked for [m]")
GRIP_FORCE = Port("grip_force", DOUBLE, "of the fingers [N]")
GRIP_SPEED = Port("grip_speed", DOUBLE, "of the fingers [m/s]")

VIA = Port(
    "via",
    DOUBLES,
    "via points from the start of the path on, each t;x;y;z;qx;qy;qz;qw;vx;vy;vz: [s] since the start, pose, "
    "velocity [m/s]; nan for what is not known",
)
TURNING = Port(
    "turning", DOUBLES, "x;y;z of the rate of turn at the start and each via point, base frame [rad/s]"
)
ARRIVES = Port("arrives", DOUBLE, "time of the target since the start of the path [s]")
END_VELOCITY = Port(
    "end_velocity", DOUBLES, "x;y;z at the target, on into the next app [m/s]; without it, it rests there"
)
END_TURNING = Port("end_turning", DOUBLES, "x;y;z of the rate of turn at the target, likewise [rad/s]")
WAITS = Port(
    "waits",
    DOUBLE,
    "for how long it presses before the path begins [s]; what is left of `seconds` after it is pressed, too",
)
BEFORE = Port("force_before", DOUBLE, "that is pressed before the path, where it is another one [N]")
AFTER = Port("force_after", DOUBLE, "that is pressed after the path, where it is another one [N]")
LENGTH = Port("length", DOUBLE, "of the path that was taught [m]")
TOLERANCE = Port("tolerance", DOUBLE, "how far the path may be off the taught one [m]")
TOLERANCE_TURN = Port("tolerance_turn", DOUBLE, "likewise its orientation [rad]")
TAUGHT = Port("force_taught", DOUBLES, "x;y;z that was taught, where a limit has cut it [N]")

AXIS = Port("axis", DOUBLES, "x;y;z of unit length: what is turned about, in the base frame")
POINT = Port("axis_point", DOUBLES, "x;y;z of a point of that axis [m]")
ANGLE = Port("angle", DOUBLE, "about that axis [rad]")
PITCH = Port("pitch", DOUBLE, "along the axis in one whole turn [m]")
TORQUE = Port("torque", DOUBLE, "taught about the axis, above 0 in the direction of the turn [Nm]")

PORTS: Mapping[str, Port] = MappingProxyType(
    {
        port.name: port
        for port in (
            *(TARGET, ORIENTATION, JOINTS, SECONDS, FORCE, TAUGHT, WIDTH, LOAD, SPEED, TURN, MOST, CONTACT),
            *(SLOW, SEARCH, VIA, TURNING, ARRIVES, END_VELOCITY, END_TURNING, WAITS, BEFORE, AFTER, LENGTH),
            *(TOLERANCE, TOLERANCE_TURN, AXIS, POINT, ANGLE, PITCH, TORQUE, GRIP_FORCE, GRIP_SPEED),
        )
    }
)


def behaviour_tree(program: ProgramFile) -> str:
    """Return the XML text, with a model of every action that it uses.

    Raises ValueError without an app, and for a number that no app can have, or that is not finite.
    """
    if not program.apps:
        raise ValueError("it has no app, and BehaviorTree.CPP refuses a sequence without a child")
    program.as_json()  # refuses what is not finite
    refuse_impossible(program)
    comments = texts_of_people(program)
    for place, found in findings_by_app(program).items():
        comments.setdefault(place, []).extend(found)
    root = Xml.Element("root", {"BTCPP_format": "4", "main_tree_to_execute": TREE})
    tree = Xml.SubElement(root, "BehaviorTree", {"ID": TREE})
    name = f"{program.station}/{program.session}, revision {program.revision}"
    sequence = Xml.SubElement(tree, "Sequence", {"name": name})
    if program.robot is not None:
        sequence.append(_comment(f"taught on the robot {program.robot}"))
    held_by = _gripper(program)
    if held_by is not None:
        sequence.append(_comment(f"for the gripper {held_by.title}"))
    program = program.model_copy(update={"safety": within_gripper(program.safety, held_by)})
    grips = {} if held_by is not None and held_by.kind == "suction" else _grips(program.safety)
    sequence.extend(map(_comment, comments.get(None, ())))
    whole, until = sequence, 0  # the app after the group that `sequence` is
    groups = groups_by_first(program.groups, len(program.apps))
    for index, app in enumerate(program.apps):
        if (group := groups.get(index)) is not None:
            sequence, until = (
                Xml.SubElement(whole, "Sequence", {"name": _valid(group.heading)}),
                group.last + 1,
            )
        elif index == until:
            sequence = whole
        sequence.extend(map(_comment, comments.get(index, ())))
        title = _valid(step_title(app.kind, app.name, app.target_name))
        following = program.apps[index + 1] if index + 1 < len(program.apps) else None
        given = {"name": f"{app_number(index)} {title}"} | _inputs(app, following, program.safety, grips)
        Xml.SubElement(sequence, action_name(app.kind), given)
        if (pause_s := pause_between(app, following, program.safety)) >= LEAST_PAUSE_S:
            Xml.SubElement(sequence, "Sleep", {"msec": str(round(1000 * pause_s))})
    models = Xml.SubElement(root, "TreeNodesModel")
    for kind in sorted({app.kind for app in program.apps}):
        _model(models, kind)
    Xml.indent(root, "  ")
    return Xml.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def action_name(kind: AppKind) -> str:
    """Return the name under which an action is registered: MoveToContact for move_to_contact."""
    return kind.title().replace("_", "")


def _comment(text: str) -> Xml.Element[Any]:
    """Return a comment; XML has no `--` within one, and some characters nowhere."""
    return Xml.Comment(_valid(f" {re.sub('-(?=-)', '- ', text)} "))


def _valid(text: str) -> str:
    """Return a text with a replacement for the characters that XML cannot have."""
    return NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)


def _model(models: Xml.Element, kind: AppKind) -> None:
    action = Xml.SubElement(models, "Action", {"ID": action_name(kind)})
    for name in APP_KINDS[kind].ports:
        port = PORTS[name]
        Xml.SubElement(action, "input_port", {"name": port.name, "type": port.type}).text = port.meaning


def _gripper(program: ProgramFile) -> GripperDescription | None:
    """Return the gripper of a program; None without a known one, which the findings name."""
    try:
        return gripper_of(program)
    except (GripperError, RobotError):
        return None


def _grips(safety: Safety) -> dict[str, float]:
    """Return the force and the speed of the fingers, by port."""
    return {GRIP_FORCE.name: safety.grasp_force_n, GRIP_SPEED.name: safety.gripper_m_per_s}


def _inputs(
    app: ProgramStep, following: ProgramStep | None, safety: Safety, grips: Mapping[str, float]
) -> dict[str, str]:
    """Return the known values of the ports of an app's action, as text by port.

    grips: force and speed of the fingers, by port.
    """
    screw = app.screw
    searches = ends_in_contact(app, following)
    onward = app.path if goes_on(app, following) else None
    values: dict[str, Sequence[float] | float | None] = {
        TARGET.name: app.target,
        ORIENTATION.name: app.orientation,
        JOINTS.name: app.joints,
        SECONDS.name: app.tn - app.t0,
        FORCE.name: app.force,
        TAUGHT.name: app.force_taught if is_path_limited(app) else None,
        VIA.name: None if app.path is None else _via(app.path),
        TURNING.name: None if app.path is None else np.ravel(turning_at_points(app)).tolist() or None,
        ARRIVES.name: None if app.path is None else app.path.tn - app.path.start.t,
        END_VELOCITY.name: None if onward is None else onward.end_velocity,
        END_TURNING.name: None if onward is None else onward.end_angular_velocity,
        WAITS.name: None if app.path is None else rests_of(app)[0],
        BEFORE.name: None if app.rest_before is None else app.rest_before.newton,
        AFTER.name: None if app.rest_after is None else app.rest_after.newton,
        LENGTH.name: None if app.path is None else app.path.length_m,
        TOLERANCE.name: None if app.path is None else app.path.tolerance_m,
        TOLERANCE_TURN.name: None if app.path is None else app.path.tolerance_rad,
        AXIS.name: None if screw is None else screw.axis,
        POINT.name: None if screw is None else screw.point,
        ANGLE.name: None if screw is None else screw.angle,
        PITCH.name: None if screw is None else screw.pitch_m,
        TORQUE.name: None if screw is None else torque_about_axis(screw),
        WIDTH.name: app.gripper_width,
        LOAD.name: app.load_kg,
        SPEED.name: safety.speed_m_per_s,
        TURN.name: safety.turn_rad_per_s,
        MOST.name: safety.felt_force_n,
        CONTACT.name: safety.contact_n if searches else None,
        SLOW.name: safety.contact_speed_m_per_s if searches else None,
        SEARCH.name: safety.search_m if searches else None,
    }
    values |= grips
    ports = [(name, values.get(name)) for name in APP_KINDS[app.kind].ports]
    return {name: _text(value) for name, value in ports if value is not None}


def _via(path: AppPath) -> list[float]:
    """Return the numbers of a path's start and via points: time, position, orientation, velocity of each.

    Times [s] count from the start. Unknown numbers are nan.
    """
    unknown = (math.nan,) * 4
    return [
        number
        for one in (path.start, *path.via)
        for number in (
            one.t - path.start.t,
            *one.position,
            *(one.orientation or unknown),
            *(one.velocity or unknown[:3]),
        )
    ]


def _text(value: Sequence[float] | float) -> str:
    if isinstance(value, float | int):
        return f"{value:.{DIGITS}g}"
    return ";".join(f"{x:.{DIGITS}g}" for x in value)

"""Common parts of the scripts of all vendors: robot checks, findings as comments, and templates."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from itertools import pairwise, repeat
from pprint import pformat
from textwrap import indent
from typing import Any

from caesura_protocol.app_contacts import ends_in_contact
from caesura_protocol.app_kinds import APP_KINDS, name_of_app
from caesura_protocol.messages import App, as_line
from caesura_protocol.programs.apps_by_phase import groups_by_first
from caesura_protocol.programs.checks import document_findings
from caesura_protocol.programs.contact_forces import friction_of
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.program_gripper import GRIP_REACH_M
from caesura_protocol.robots import RobotDescription, robot_description
from caesura_protocol.session_time_display import clock_from

NO_ROBOT = (
    "the program states no robot, so whether these poses are those of this arm is not known: state it with "
    "--robot, where it was taught on this arm"
)
NAMED_FRICTION_N = 0.5  # that is left out of a force, from which on a script says so


def robot_of_script(program: ProgramFile, script: str, expected: str) -> RobotDescription | None:
    """Return the robot of a program; None if it states none.

    script: name of the script in robot descriptions; expected: text for the error. Raises ValueError for a
    robot of another vendor, or a number that is not finite.
    """
    robot = None if program.robot is None else robot_description(program.robot)
    if robot is not None and robot.script != script:
        fits = f"use --format {robot.script or 'bt'}"
        raise ValueError(f"{expected}, and the program's robot is {program.robot}: {fits}")
    program.as_json()  # refuses what is not finite
    return robot


def findings_as_comments(program: ProgramFile) -> dict[int | None, list[str]]:
    """Return comment lines of a script without a mark, by app from 0; None: the whole program.

    Besides the texts of people and a check's findings, a carry that sets down has a line on its contact
    search, a stroke one on the removed friction.
    """
    comments = texts_of_people(program)
    for index, (app, following) in enumerate(pairwise(program.apps)):
        if APP_KINDS[app.kind].carries and ends_in_contact(app, following):
            said = "sets down: looks for the surface at its end, slowly until it is felt"
            comments.setdefault(index, []).append(said)
    for index, app in enumerate(program.apps):
        if (rubbed_n := friction_of(app)) > NAMED_FRICTION_N:
            said = f"{rubbed_n:.1f} N of the taught force are left out: friction takes them along the way"
            comments.setdefault(index, []).append(said)
    for place, found in findings_by_app(program).items():
        comments.setdefault(place, []).extend(found)
    return comments


def texts_of_people(program: ProgramFile) -> dict[int | None, list[str]]:
    """Return the notes of apps as lines, by app from 0; None: the name of the program."""
    said: dict[int | None, list[str]] = {
        index: [one_line(f"note: {app.note}")] for index, app in enumerate(program.apps) if app.note
    }
    if program.name is not None:
        said[None] = [one_line(f"called: {program.name}")]
    return said


def findings_by_app(program: ProgramFile) -> dict[int | None, list[str]]:
    """Return what a check finds as lines, by app from 0; None: the whole program.

    Reach is not checked: that needs the kinematics of a robot.
    """
    found: dict[int | None, list[str]] = {}
    if program.robot is None:
        found[None] = [f"warning: {NO_ROBOT}"]
    clock = clock_from(program.apps[0].t0 if program.apps else 0.0)
    for one in document_findings(program):
        text = clock.text(f"{one.severity}: {one.reason}")
        found.setdefault(one.index, []).append(one_line(text))
    if clock.words and found:
        found.setdefault(None, []).insert(0, f"in comments, {clock.words}")
    return found


def group_comments(program: ProgramFile) -> dict[int, str]:
    """Return the comment line at which each group of apps begins, by its first app from 0."""
    groups = groups_by_first(program.groups, len(program.apps))
    return {index: one_line(f"# === {group.heading} ===") for index, group in groups.items()}


def felt_with_friction(app: App) -> dict[str, float]:
    """Return the force [N] that is felt along a stroke, as `felt_n`; empty if no friction is left out."""
    return {"felt_n": round(math.hypot(*app.force or ()), 3)} if friction_of(app) > 0.0 else {}


def head_comments(program: ProgramFile) -> str:
    """Return a check's findings on the whole program, as lines of comment for the top of a script."""
    return "".join(f"# {comment}\n" for comment in findings_as_comments(program).get(None, ()))


def table_of_apps(
    program: ProgramFile,
    rows: Sequence[Mapping[str, Any]],
    width: int,
    also: Iterable[Sequence[str]] = repeat(()),
) -> str:
    """Return the apps of a Python script as a list of rows, with the findings on an app above its row.

    also: further comments on each app.
    """
    comments, groups, lines = findings_as_comments(program), group_comments(program), []
    for index, (app, row, more) in enumerate(zip(program.apps, rows, also, strict=False)):
        said = [one_line(name_of_app(index, app)), *comments.get(index, ()), *more]
        lines += [f"    {groups[index]}"] if index in groups else []
        lines += [f"    # {comment}" for comment in said]
        lines += [indent(pformat(row, width=width, sort_dicts=False), "    ") + ","]
    return "\n".join(["APPS = [", *lines, "]"])


def one_line(text: str) -> str:
    """Return a text without line breaks and control characters.

    Text after a line break would be code, and Python refuses a source with a NUL.
    """
    return " ".join(as_line(text).split())


def filled_template(name: str, texts: Mapping[str, str]) -> str:
    """Return the template of this file name, with texts in place of its marks."""
    texts = {"<GRIP_REACH_M>": f"{GRIP_REACH_M:g}", **texts}
    template = files("caesura_protocol.programs").joinpath(name).read_text("utf-8")
    marks = "|".join(map(re.escape, texts))
    return re.sub(marks, lambda mark: texts[mark[0]], template)  # a text may contain a mark of another one


def in_docstring(text: str) -> str:
    """Return a text in one line, with quotes and backslashes as a docstring needs them."""
    return one_line(text).replace("\\", "\\\\").replace('"', '\\"')


def title_of(program: ProgramFile) -> str:
    """Return the source of a script as text: station, session and revision."""
    return f"{program.station}/{program.session}, revision {program.revision}"

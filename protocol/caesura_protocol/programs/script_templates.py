"""What the scripts of all makers share: which robots they are for, and how their template is filled."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.robots import RobotDescription, robot_description


def robot_of_script(program: ProgramFile, script: str, expected: str) -> RobotDescription | None:
    """The robot of a program, None where it states none.

    script: the scripts of its robots, as descriptions name them; expected: in words, for the error. Raises
    ValueError for a robot of another maker, or a number that is not finite.
    """
    robot = None if program.robot is None else robot_description(program.robot)
    if robot is not None and robot.script != script:
        raise ValueError(f"{expected}, and its robot is {program.robot}")
    program.as_json()  # refuses what is not finite
    return robot


def filled_template(name: str, texts: Mapping[str, str]) -> str:
    """The template of this file name, with a text in place of every mark."""
    template = files("caesura_protocol.programs").joinpath(name).read_text("utf-8")
    for mark, text in texts.items():
        template = template.replace(mark, text)
    return template


def title_of(program: ProgramFile) -> str:
    """What a script names as its source."""
    return f"{program.station}/{program.session}, revision {program.revision}"

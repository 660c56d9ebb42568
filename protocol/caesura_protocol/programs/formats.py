"""Formats that a program can be written in, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

from caesura_protocol.programs.behaviour_tree import behaviour_tree
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from caesura_protocol.robots import robot_description

WRITERS: Mapping[str, Callable[[ProgramFile], str]] = MappingProxyType(
    {
        "json": ProgramFile.as_json,
        "franky": franky_script,
        "urscript": ur_script,
        "xarm": xarm_script,
        "bt": behaviour_tree,
    }
)


class FormatFacts(NamedTuple):
    """How a format is offered to people. is_script: it is for the robots whose description names it."""

    title: str
    suffix: str
    is_script: bool = False


FORMATS: Mapping[str, FormatFacts] = MappingProxyType(
    {
        "json": FormatFacts("JSON", "json"),
        "franky": FormatFacts("franky script", "py", is_script=True),
        "urscript": FormatFacts("URScript", "script", is_script=True),
        "xarm": FormatFacts("xArm script", "py", is_script=True),
        "bt": FormatFacts("behaviour tree", "xml"),
    }
)


def formats_of(robot: str | None) -> list[str]:
    """Return the formats that a program of a robot can be written in; None: every one."""
    script = None if robot is None else robot_description(robot).script
    return [name for name, facts in FORMATS.items() if not facts.is_script or robot is None or name == script]

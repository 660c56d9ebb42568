"""The formats in which a program can be written, by name."""

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


class ProgramWriter(NamedTuple):
    """A format: its title, the suffix of its files, and the function that writes it.

    is_script: whether it is only for robots whose description names it.
    """

    title: str
    suffix: str
    write: Callable[[ProgramFile], str]
    is_script: bool = False


WRITERS: Mapping[str, ProgramWriter] = MappingProxyType(
    {
        "json": ProgramWriter("JSON", ".json", ProgramFile.as_json),
        "franky": ProgramWriter("franky script", ".py", franky_script, is_script=True),
        "urscript": ProgramWriter("URScript", ".script", ur_script, is_script=True),
        "xarm": ProgramWriter("xArm script", ".py", xarm_script, is_script=True),
        "bt": ProgramWriter("behaviour tree", ".xml", behaviour_tree),
    }
)


def formats_of(robot: str | None) -> list[str]:
    """Return the formats in which a robot's program can be written; None: all formats."""
    script = None if robot is None else robot_description(robot).script
    return [name for name, one in WRITERS.items() if not one.is_script or robot is None or name == script]

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


class ProgramWriter(NamedTuple):
    """A format: its title, the suffix of its files, and the function that writes it."""

    title: str
    suffix: str
    write: Callable[[ProgramFile], str]


WRITERS: Mapping[str, ProgramWriter] = MappingProxyType(
    {
        "json": ProgramWriter("JSON", ".json", ProgramFile.as_json),
        "franky": ProgramWriter("franky script", ".py", franky_script),
        "urscript": ProgramWriter("URScript", ".script", ur_script),
        "xarm": ProgramWriter("xArm script", ".py", xarm_script),
        "bt": ProgramWriter("behaviour tree", ".xml", behaviour_tree),
    }
)

"""Formats that a program can be written in, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from caesura_protocol.programs.behaviour_tree import behaviour_tree
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script

WRITERS: Mapping[str, Callable[[ProgramFile], str]] = MappingProxyType(
    {
        "json": ProgramFile.as_json,
        "franky": franky_script,
        "urscript": ur_script,
        "xarm": xarm_script,
        "bt": behaviour_tree,
    }
)

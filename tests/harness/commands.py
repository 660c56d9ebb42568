"""Every command of the command line, with its own options: the modules of all are imported."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from caesura_protocol.lazy_commands import LazyCommand


def every_command(group: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """What is typed for each command that is listed, and the command."""
    for name, listed in group.commands.items():
        if listed.hidden:
            continue
        command = listed.load() if isinstance(listed, LazyCommand) else listed
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from every_command(command, *path, name)

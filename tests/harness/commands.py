"""The command line as tests run it: assembled once a process, as that takes as long as many a command."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import typer

from caesura_clients.cli import build
from caesura_protocol.lazy_commands import LazyCommand


@cache
def application() -> typer.Typer:
    """`caesura`, which a run of one of its commands leaves as it was."""
    return build()


def every_command(group: Any, *path: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """What is typed for each command that is listed, and the command, of which the module is imported."""
    for name, listed in group.commands.items():
        if listed.hidden:
            continue
        command = listed.load() if isinstance(listed, LazyCommand) else listed
        yield (*path, name), command
        if hasattr(command, "commands"):
            yield from every_command(command, *path, name)

"""Registers the command of the simulated teacher."""

from importlib.util import find_spec

import typer

from caesura_protocol.lazy_commands import add_command


def register(app: typer.Typer) -> None:
    """Add the command `teach`, if its extra is installed."""
    if find_spec("pinocchio") is not None and find_spec("caesura_service") is not None:
        add_command(app, "teach", "caesura_lab.teacher.teach_command:teach")

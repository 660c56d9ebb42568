"""Registers the command `dashboard`."""

from importlib.util import find_spec

import typer

from caesura_protocol.lazy_commands import add_command


def register(app: typer.Typer) -> None:
    """Add the command `dashboard`, if its extra is installed."""
    if find_spec("nicegui") is not None:
        add_command(app, "dashboard", "caesura_clients.dashboard.dashboard_command:dashboard")

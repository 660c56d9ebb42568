"""Registers the commands of third-party viewers, Foxglove and Rerun."""

import typer

from caesura_protocol.lazy_commands import add_command


def register(app: typer.Typer) -> None:
    """Add the commands `foxglove` and `rerun` to the app."""
    add_command(app, "foxglove", "caesura_clients.viewer.foxglove_command:serve_foxglove")
    add_command(app, "rerun", "caesura_clients.viewer.rerun_command:show_in_rerun")

"""The commands of viewers of other projects."""

import typer

from caesura_protocol.lazy_commands import add_command


def register(app: typer.Typer) -> None:
    """Add the commands."""
    add_command(app, "foxglove", "caesura_clients.viewer.foxglove_command:serve_foxglove")
    add_command(app, "rerun", "caesura_clients.viewer.rerun_command:show_in_rerun")

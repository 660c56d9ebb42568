"""The commands of a server: `serve` and `certs`. Raises ModuleNotFoundError without the extra `service`."""

import typer

from caesura_protocol.lazy_commands import add_command
from caesura_service.extra import check_installed

check_installed()


def register(app: typer.Typer) -> None:
    """Add every command of a server."""
    add_command(app, "serve", "caesura_service.commands.serve:serve")
    add_command(app, "certs", "caesura_service.commands.certs:certs")

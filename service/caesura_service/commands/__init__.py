"""The commands of a server: `serve` and `certs`."""

import typer

from caesura_service.commands.certs import certs
from caesura_service.commands.serve import serve


def register(app: typer.Typer) -> None:
    """Add every command of a server."""
    for command in (serve, certs):
        app.command(command.__name__)(command)

"""The commands of a server: `serve` and `certs`. Raises ModuleNotFoundError without the extra `service`."""

import typer

from caesura_protocol.lazy_commands import add_command
from caesura_service.extra import check_installed

check_installed()


def register(app: typer.Typer) -> None:
    """Add every command of a server."""
    add_command(
        app,
        "serve",
        "caesura_service.commands.serve:serve",
        "Segment what bridges publish, until SIGINT or SIGTERM.",
    )
    add_command(
        app,
        "certs",
        "caesura_service.commands.certs:certs",
        "Make certificates for mutual TLS, and the access rules for every role.",
    )

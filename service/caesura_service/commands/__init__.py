"""The commands that the service adds to `caesura`, one module each."""

import typer

from caesura_service.commands import annotate
from caesura_service.commands.certs import certs
from caesura_service.commands.check import check, execute
from caesura_service.commands.demo import demo
from caesura_service.commands.evaluate import evaluate
from caesura_service.commands.export import export_recording
from caesura_service.commands.report import report
from caesura_service.commands.segment import segment
from caesura_service.commands.serve import serve
from caesura_service.commands.sessions import delete, export

__all__ = ["delete", "export", "register"]  # the first two join the group `sessions` by being imported


def register(app: typer.Typer) -> None:
    """Add every command of the service."""
    for command in (serve, certs, segment, check, execute, evaluate, report, demo):
        app.command(command.__name__)(command)
    app.command("export")(export_recording)
    annotate.register(app)

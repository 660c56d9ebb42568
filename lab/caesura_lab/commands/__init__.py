"""The commands that work on recordings and programs, one module each."""

import typer

from caesura_lab.commands import annotate
from caesura_lab.commands.check import check, execute
from caesura_lab.commands.demo import demo
from caesura_lab.commands.evaluate import evaluate
from caesura_lab.commands.export import export_recording
from caesura_lab.commands.report import report
from caesura_lab.commands.segment import segment
from caesura_lab.commands.sessions import delete, export

__all__ = ["delete", "export", "register"]  # the first two join the group `sessions` by being imported


def register(app: typer.Typer) -> None:
    """Add every command that works on recordings and programs."""
    for command in (segment, check, execute, evaluate, report, demo):
        app.command(command.__name__)(command)
    app.command("export")(export_recording)
    annotate.register(app)

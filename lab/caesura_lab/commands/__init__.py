"""The commands that work on recordings and programs, one module each.

Raises ModuleNotFoundError without the extra `service`.
"""

from importlib.util import find_spec

import typer

from caesura_clients.cli.sessions import sessions
from caesura_protocol.lazy_commands import add_command
from caesura_service.extra import check_installed

check_installed()

COMMANDS = {
    "segment": "caesura_lab.commands.segment:segment",
    "check": "caesura_lab.commands.check_and_execute:check",
    "execute": "caesura_lab.commands.check_and_execute:execute",
    "evaluate": "caesura_lab.commands.evaluate:evaluate",
    "report": "caesura_lab.commands.report:report",
    "demo": "caesura_lab.commands.demo:demo",
    "export": "caesura_lab.commands.export:export_recording",
}

add_command(sessions, "export", "caesura_lab.commands.journal_sessions:export")
add_command(sessions, "delete", "caesura_lab.commands.journal_sessions:delete")
add_command(sessions, "journals", "caesura_lab.commands.journal_sessions:journals")


def register(app: typer.Typer) -> None:
    """Add every command that works on recordings and programs; `annotate` where its extra is installed."""
    for name, place in COMMANDS.items():
        add_command(app, name, place)
    if find_spec("nicegui") is not None:
        add_command(app, "annotate", "caesura_lab.commands.annotate:annotate")

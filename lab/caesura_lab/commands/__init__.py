"""The commands that work on recordings and programs, one module each.

Raises ModuleNotFoundError without the extra `service`.
"""

from importlib.util import find_spec

import typer

from caesura_clients.cli.sessions import sessions
from caesura_protocol.lazy_commands import add_command
from caesura_service.extra import check_installed

check_installed()

COMMANDS = (
    (
        "segment",
        "caesura_lab.commands.segment:segment",
        "Divide a recording into segments and show them with the task program.",
    ),
    (
        "check",
        "caesura_lab.commands.check:check",
        "Say what of a program cannot be run, app by app. The exit code is 1 where anything cannot.",
    ),
    (
        "execute",
        "caesura_lab.commands.check:execute",
        "Run a program on the simulated robot. The exit code is 1 where it is refused or stopped.",
    ),
    (
        "evaluate",
        "caesura_lab.commands.evaluate:evaluate",
        "Judge segmentations against the truth: boundaries, classes, delays, load and force.",
    ),
    (
        "report",
        "caesura_lab.commands.report:report",
        "Draw a recording as it is divided: signals, path, tables, and what the filter believed when.",
    ),
    (
        "demo",
        "caesura_lab.commands.demo:demo",
        "Teach a simulated robot and watch segments and the task program appear.",
    ),
    (
        "export",
        "caesura_lab.commands.export:export_recording",
        "Write a recording in another format: .mcap with its segments for Foxglove and Rerun, .npz or .csv.",
    ),
)
ANNOTATE = (
    "annotate",
    "caesura_lab.commands.annotate:annotate",
    "Mark boundaries and classes of a recording by hand, in a browser on this machine.",
)

add_command(
    sessions,
    "export",
    "caesura_lab.commands.sessions:export",
    "Write a session: .npz, a recording that `caesura segment` and a bridge can read; or .mcap, samples and "
    "results for Foxglove and Rerun; or, with --format lerobot, sessions as the episodes of a dataset.",
)
add_command(
    sessions,
    "delete",
    "caesura_lab.commands.sessions:delete",
    "Delete a session for good: its samples, results and corrections, in every journal of DIR.",
)


def register(app: typer.Typer) -> None:
    """Add every command that works on recordings and programs; `annotate` where its extra is installed."""
    for command in COMMANDS:
        add_command(app, *command)
    if find_spec("nicegui") is not None:
        add_command(app, *ANNOTATE)

"""The commands of a client install: name, function, and line in the list of commands."""

from __future__ import annotations

import typer

from caesura_clients.cli.sessions import sessions
from caesura_protocol.lazy_commands import add_command

COMMANDS = (
    (
        "bridge",
        "caesura_clients.cli.bridge:bridge",
        "Send one robot's samples to the service. Ctrl-C, or SIGTERM, ends the demonstration.",
    ),
    (
        "start",
        "caesura_clients.cli.demonstrations:start",
        "Start a demonstration at a bridge in standby.",
    ),
    (
        "stop",
        "caesura_clients.cli.demonstrations:stop",
        "Stop the demonstration of a station; returns once the service has all of it.",
    ),
    (
        "watch",
        "caesura_clients.cli.watch:watch",
        "Show segments as they are found; what is marked ~ may still change. All stations by default.",
    ),
    (
        "hints",
        "caesura_clients.cli.hints:hints",
        "Show hints to the teacher as they are raised and cleared. All stations by default.",
    ),
    (
        "program",
        "caesura_clients.cli.programs:program",
        "Show the task program of a station or of one of its sessions, or write it for a robot.",
    ),
    (
        "edit",
        "caesura_clients.cli.edit:edit",
        "Correct a session, open or closed: changepoints, kinds, force limits, names of phases.",
    ),
    (
        "doctor",
        "caesura_clients.cli.doctor:doctor",
        "Check connection, clock, credentials, journal, samples and wrench, and say what to do.",
    ),
    (
        "edit-program",
        "caesura_clients.cli.edit_program:edit_program",
        "Edit the program of a session, open or closed; what was inferred stays beneath the edits.",
    ),
    (
        "record",
        "caesura_clients.cli.record:record_session",
        "Record a session as it is taught, until it is closed or Ctrl-C: .mcap with its results, .npz "
        "or .csv.",
    ),
    (
        "robots",
        "caesura_clients.cli.robots:list_robots",
        "List the robots that --robot takes, of this package, of others, and of the folder CAESURA_ROBOTS.",
    ),
)


def register(app: typer.Typer) -> None:
    """Add the commands of a client install."""
    for name, place, summary in COMMANDS:
        add_command(app, name, place, summary)
    app.add_typer(sessions)

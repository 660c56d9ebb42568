"""`caesura sessions list` and `show`: print all sessions, and the details of one."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console, Group
from rich.text import Text

from caesura_clients.cli.connection_options import Config, Connect, Json, Station
from caesura_clients.cli.options import connected, only_station, reported
from caesura_clients.cli.result_tables import (
    clock_lines,
    description_line,
    outcome_line,
    phases_table,
    program_view,
    segments_view,
)
from caesura_clients.cli.session_table import print_sessions
from caesura_clients.query import damaged_sessions, sessions
from caesura_protocol.errors import ProtocolError
from caesura_protocol.session_time_display import clock_of


def list_sessions(
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """List the sessions of the service; `opened` is in local time."""
    with reported(), connected(endpoint, config) as caesura:
        try:
            found = sessions(caesura.transport, station or "*", complete=True)
        except ProtocolError as error:
            if error.code != "overloaded":
                raise
            found = caesura.sessions(station or "*")
            typer.echo(f"not all sessions are listed: {error.message}", err=True)
        try:
            found += damaged_sessions(caesura.transport, station or "*")
        except ProtocolError as error:
            typer.echo(f"damaged sessions are not listed: {error.message}", err=True)
    if as_json:
        typer.echo(json.dumps([asdict(info) for info in found], indent=2))
    else:
        print_sessions(found)


def show(
    session: Annotated[str | None, typer.Argument(help="By default the newest one of the station.")] = None,
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show one session: its segments, its phases, its task program, and what did not become segments."""
    with reported(), connected(endpoint, config) as caesura:
        found = caesura.snapshot(only_station(caesura, station, session), session)
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
        return
    clock = clock_of(found.segments.segments)
    lost = outcome_line(found.status, clock)
    views = [*clock_lines(clock), segments_view(found.status, found.segments.segments, clock)]
    if len(found.segments.phases) > 1:
        views.append(phases_table(found.segments.phases, "phases", clock))
    views.append(program_view(found.program, clock, found.segments.phases))
    if line := description_line(found.status.description):
        views.insert(0, Text(line))
    Console().print(Group(*views, *([lost] if lost else [])))

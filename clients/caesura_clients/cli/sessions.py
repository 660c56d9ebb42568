"""`caesura sessions`: what sessions there are, and what is known of one. Where the service is installed it
adds commands of its own, which look into the journal on its machine.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console, Group
from rich.text import Text

from caesura_clients.cli.demonstrations import describe
from caesura_clients.cli.options import Config, Connect, Json, Station, connected, only_station, reported
from caesura_clients.cli.result_tables import (
    clock_lines,
    description_line,
    outcome_line,
    phases_table,
    program_view,
    segments_view,
    sessions_view,
)
from caesura_protocol.distribution import install_command
from caesura_protocol.errors import NotFound
from caesura_protocol.session_clock import clock_of

sessions = typer.Typer(name="sessions", help="List the sessions of the service, or show one.")
sessions.command("describe")(describe)
OF_THE_SERVICE = ("export", "delete")  # they look into its journal


@sessions.callback(invoke_without_command=True)
def _default(
    context: typer.Context,
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """List the sessions of the service, or show one."""
    if context.invoked_subcommand is None:
        list_sessions(station, as_json, endpoint, config)
    elif any(_was_typed(context, name) for name in context.params):
        raise typer.BadParameter(f"options stand behind the command: sessions {context.invoked_subcommand} …")


def _was_typed(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


@sessions.command("list")
def list_sessions(
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """List the sessions of the service."""
    with reported(), connected(endpoint, config) as caesura:
        found = caesura.sessions(station or "*")
        if not found and not caesura.services():  # access rules deny without a word
            raise NotFound("a service is there, but answers nothing: are these a reader's credentials?")
    if as_json:
        typer.echo(json.dumps([asdict(info) for info in found], indent=2))
    else:
        Console().print(sessions_view(found))


@sessions.command("show")
def show(
    session: Annotated[str | None, typer.Argument(help="By default the newest one of the station.")] = None,
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """Show one session: its segments, its phases, its task program, and what did not become segments."""
    with reported(), connected(endpoint, config) as caesura:
        found = caesura.snapshot(only_station(caesura, station), session)
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
        return
    lost = outcome_line(found.status)
    clock = clock_of(found.segments.segments)
    views = [*clock_lines(clock), segments_view(found.status, found.segments.segments)]
    if len(found.segments.phases) > 1:
        views.append(phases_table(found.segments.phases, "phases", clock))
    views.append(program_view(found.program, clock))
    if line := description_line(found.status.description):
        views.insert(0, Text(line))
    Console().print(Group(*views, *([lost] if lost else [])))


def stand_in(group: typer.Typer) -> None:
    """Where the service is not installed, its commands take anything and say where they run."""
    there = {info.name for info in group.registered_commands}
    for name in sorted(set(OF_THE_SERVICE) - there):
        _elsewhere(group, name)


def _elsewhere(group: typer.Typer, name: str) -> None:
    anything = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}

    @group.command(name, hidden=True, context_settings=anything)
    def _missing() -> None:
        typer.echo(
            f"error: caesura sessions {name} runs on the service's machine, where the journal is; "
            f"it comes with {install_command('service')}",
            err=True,
        )
        raise typer.Exit(2)

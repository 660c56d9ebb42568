"""`caesura sessions`: lists sessions and shows one.

An installed service adds commands that read its journal.
"""

from __future__ import annotations

import typer

from caesura_clients.cli.connection_options import Config, Connect, Json, Station
from caesura_protocol.lazy_commands import add_command
from caesura_protocol.package_version_and_extras import install_command

sessions = typer.Typer(name="sessions", help="List the sessions of the service, or show one.")
add_command(sessions, "describe", "caesura_clients.cli.start_stop_describe:describe")
add_command(sessions, "list", "caesura_clients.cli.sessions_list_and_show:list_sessions")
add_command(sessions, "show", "caesura_clients.cli.sessions_list_and_show:show")
OF_THE_SERVICE = ("export", "delete", "journals")  # they look into its journal


@sessions.callback(invoke_without_command=True)
def _default(
    context: typer.Context,
    station: Station = None,
    as_json: Json = False,
    endpoint: Connect = None,
    config: Config = None,
) -> None:
    """List the sessions of the service, or show one."""
    from caesura_clients.cli.sessions_list_and_show import list_sessions  # noqa: PLC0415 - it takes a second

    if context.invoked_subcommand is None:
        list_sessions(station, as_json, endpoint, config)
    elif any(_was_typed(context, name) for name in context.params):
        raise typer.BadParameter(
            f"write the options after the command: sessions {context.invoked_subcommand} …"
        )


def _was_typed(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def stand_in(group: typer.Typer) -> None:
    """Add a hidden placeholder for each of the service's commands if the service is not installed.

    A placeholder accepts any arguments, prints on which machine the command runs, and exits with 2.
    """
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

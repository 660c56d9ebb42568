"""The command `caesura`. It assembles itself from what is installed: every entry point of the group
`caesura.commands` names a function that adds its commands; those whose extra is missing are left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import EntryPoint, entry_points

import typer

GROUP = "caesura.commands"
OWN_PACKAGES = ("caesura_protocol", "caesura_service", "caesura_clients")


def build(found: Iterable[EntryPoint] | None = None) -> typer.Typer:
    """The application with every command that can be imported."""
    app = typer.Typer(
        name="caesura",
        help="Divides a kinaesthetic demonstration, while it is taught, into segments with a meaning.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback()
    def _root() -> None:
        """Make a single command a subcommand as well."""

    for entry_point in entry_points(group=GROUP) if found is None else found:
        _add(app, entry_point)
    return app


def main() -> None:
    """Run the command line."""
    build()()


def _add(app: typer.Typer, entry_point: EntryPoint) -> None:
    try:
        register = entry_point.load()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in OWN_PACKAGES:
            raise
        return  # an extra that is not installed
    register(app)

"""The command `caesura`. Its subcommands depend on what is installed.

Every entry point of the group `caesura.commands` names a function that adds its commands. A command's own
module is imported when it runs. A command whose extra is missing is not listed; using it prints what to
install.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Annotated

import typer

from caesura_clients.cli.sessions import sessions, stand_in
from caesura_protocol.package_version_and_extras import (
    DISTRIBUTION,
    PACKAGES,
    install_command,
    installed_version,
)

GROUP = "caesura.commands"
COMMANDS_OF_EXTRA: Mapping[str, tuple[str, ...]] = {
    "service": ("serve", "certs", "segment", "demo", "check", "execute", "evaluate", "export", "report"),
    "teacher": ("teach",),
    "dashboard": ("dashboard",),
    "service,dashboard": ("annotate",),
}
# What the dynamic linker says of a library that a package from the index needs from the system.
MISSING_LIBRARY = re.compile(r"(\S+\.so[.\d]*): cannot open shared object file")
DEBIAN_PACKAGES = {"libgomp.so.1": "libgomp1"}  # pinocchio's


def build(found: Iterable[EntryPoint] | None = None) -> typer.Typer:
    """Return the application with every command that can be imported."""
    app = typer.Typer(
        name="caesura",
        help="Divides a kinaesthetic demonstration, while it is taught, into segments with a meaning.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    @app.callback()
    def _root(
        *,
        version: Annotated[
            bool, typer.Option("--version", "-V", is_eager=True, callback=_version, help="Show the version.")
        ] = False,
    ) -> None:
        """Divides a kinaesthetic demonstration, while it is taught, into segments with a meaning."""

    for entry_point in entry_points(group=GROUP) if found is None else found:
        _add(app, entry_point)
    for extra, names in COMMANDS_OF_EXTRA.items():
        for name in sorted(set(names) - _names(app)):
            _stand_in(app, name, extra)
    stand_in(sessions)
    return app


def main() -> None:
    """Run the command line. A library of the system that is missing is named, with its package."""
    try:
        build()()
    except ImportError as error:
        missing = MISSING_LIBRARY.match(str(error))
        if missing is None:
            raise
        library = missing[1]
        package = DEBIAN_PACKAGES.get(library, "the package that has it")
        typer.echo(f"error: this machine has no {library}; on Debian and Ubuntu install {package}", err=True)
        sys.exit(1)


def _version(*, asked: bool) -> None:
    if asked:
        typer.echo(f"{DISTRIBUTION} {installed_version()}")
        raise typer.Exit


def _add(app: typer.Typer, entry_point: EntryPoint) -> None:
    try:
        entry_point.load()(app)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in PACKAGES:
            raise
        return  # an extra that is not installed


def _names(app: typer.Typer) -> set[str]:
    return {str(info.name or getattr(info.callback, "__name__", "")) for info in app.registered_commands}


def _stand_in(app: typer.Typer, name: str, extra: str) -> None:
    """Add an unlisted placeholder command that takes any arguments and prints what to install."""
    anything = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}

    @app.command(name, hidden=True, context_settings=anything)
    def _missing() -> None:
        typer.echo(f"error: caesura {name} needs {install_command(extra)}", err=True)
        raise typer.Exit(2)

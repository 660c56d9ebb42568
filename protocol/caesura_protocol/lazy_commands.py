"""Commands whose module is imported when they run: a list of commands, and the version, need none of them."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand


class LazyCommand(TyperCommand):
    """A command of which the name and the summary are known; `load` imports the rest."""

    place: ClassVar[str]

    def load(self) -> Any:
        """Import the command, with its options."""
        alone = typer.Typer(add_completion=False)
        alone.command(self.name)(resolve_name(self.place))
        return typer.main.get_command(alone)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Parse what was typed by the command's own options, and run that command then."""
        return self.load().make_context(*args, **options)


def add_command(app: typer.Typer, name: str, place: str, summary: str) -> None:
    """Add a command.

    place: `module:function`. summary: one line of the list of commands, the first paragraph of the function's
    docstring.
    """
    cls = type("LazyCommand", (LazyCommand,), {"place": place})
    app.command(name, help=summary, cls=cls)(_no_options)


def _no_options() -> None:
    """Stand for a function that is not imported."""

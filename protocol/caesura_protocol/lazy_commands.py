"""Commands whose module is imported only when they run, so that listing them imports none of it."""

from __future__ import annotations

import ast
import inspect
from importlib.util import find_spec
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand

from caesura_protocol.option_error_texts import check_finite, values_named


class LazyCommand(TyperCommand):
    """A command of which only the name and the place are known; `load` imports it."""

    place: ClassVar[str]
    takes_numbers: ClassVar[bool]

    def _summary(self) -> str:
        """Return the command's line in a list of commands."""
        return summary_of(self.place)

    def _discard(self, _words: str | None) -> None:
        """Discard the help text of the placeholder function."""

    help = property(_summary, _discard)

    def load(self) -> Any:
        """Import the command, with its options."""
        alone = typer.Typer(add_completion=False)
        settings = {"ignore_unknown_options": True} if self.takes_numbers else {}
        function = resolve_name(self.place)
        alone.command(self.name, help=_unwrapped(function.__doc__), context_settings=settings)(function)
        return typer.main.get_command(alone)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Parse the arguments with the options of the loaded command, which then runs."""
        with values_named():
            context = self.load().make_context(*args, **options)
            check_finite(context)
            return context


def add_command(app: typer.Typer, name: str, place: str, *, takes_numbers: bool = False) -> None:
    """Add a command. place: `module:function`.

    takes_numbers: whether its arguments may be negative. An unknown option is then an argument too, which the
    command must refuse.
    """
    named = {"place": place, "takes_numbers": takes_numbers}
    app.command(name, cls=type("LazyCommand", (LazyCommand,), named))(_no_options)


def summary_of(place: str) -> str:
    """Return the first paragraph of a function's docstring, read from its module's source without an import.

    Raises ModuleNotFoundError.
    """
    module, name = place.split(":")
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"no module {module!r}", name=module)
    functions = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
    docstrings = (
        ast.get_docstring(one) for one in functions if isinstance(one, ast.FunctionDef) and one.name == name
    )
    return " ".join((next(docstrings, None) or "").partition("\n\n")[0].split())


def _unwrapped(docstring: str | None) -> str:
    """The paragraphs of a docstring, a line each: a terminal wraps them at its own width."""
    return "\n\n".join(" ".join(one.split()) for one in inspect.cleandoc(docstring or "").split("\n\n"))


def _no_options() -> None:
    """Placeholder of a function that is not imported."""

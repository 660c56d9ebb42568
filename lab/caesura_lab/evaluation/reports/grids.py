"""Tables whose cells are text, rendered for a terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text


@dataclass(frozen=True)
class Grid:
    """A table as text: each row has one cell per heading; the first is its name."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def as_text(self) -> RenderableType:
        """Render the title and the table for a terminal."""
        table = Table(padding=(0, 1, 0, 0), box=None)
        for i, heading in enumerate(self.headings):
            table.add_column(Text(heading), justify="right" if i else "left", no_wrap=not i)
        for row in self.rows:
            table.add_row(*map(Text, row))  # as text: brackets are no markup here
        return Group(Text(f"\n{self.title}", style="italic"), table)

    def as_markdown(self) -> str:
        """Render the title and the table as Markdown."""
        ruler = ["---"] + ["---:"] * (len(self.headings) - 1)
        lines = [f"| {' | '.join(cells)} |" for cells in (self.headings, ruler, *self.rows)]
        return "\n".join([f"{self.title}\n", *lines])


@dataclass(frozen=True)
class GridPage:
    """A heading, grids, and notes below them."""

    heading: str
    grids: Sequence[Grid]
    notes: Sequence[str] = ()

    def as_text(self) -> RenderableType:
        """Render the page for a terminal."""
        grids = (grid.as_text() for grid in self.grids)
        return Group(Text(self.heading, style="bold"), *grids, *map(Text, self.notes))

    def as_markdown(self) -> str:
        """Render the page as Markdown."""
        grids = (grid.as_markdown() for grid in self.grids)
        return "\n\n".join([f"**{self.heading}**", *grids, *self.notes]) + "\n"

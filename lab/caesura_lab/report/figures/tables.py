"""Tables on paper, on as many pages as needed; a table that fits on a page is not divided."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from caesura_lab.report.figures import style
from caesura_lab.report.report_data import ReportData
from caesura_lab.report.tables import Table, TableColumn, notes

ROW, HEAD, GAP = 0.0245, 0.056, 0.05  # heights, shares of the page
FIRST, LAST = 0.925, 0.06  # where rows may stand on the page
SIZE = 8.5  # [pt]
PADDING = 2.0  # letters between columns
NOTE_LETTERS = 175
NOTE_LINE, EDGE = 0.019, 0.02  # heights, shares of the page


def table_pages(content: ReportData, tables: Sequence[Table]) -> Iterator[Figure]:
    """Yield pages with the tables in order, continued on the next page; the notes are last."""
    figure, top = style.page(content, tables[0].title), FIRST
    for number, table in enumerate(tables):
        rest = table
        if number and _room(top) < min(len(table.rows), _room(FIRST)):
            yield figure
            figure, top = style.page(content, table.title), FIRST
        elif number:
            figure.text(style.LEFT, top - 0.005, table.title, fontsize=13, fontweight="bold", va="top")
            top -= GAP
        while len(rest.rows) > _room(top):
            _draw(figure, _part(rest, 0, _room(top)), table, top)
            rest = _part(rest, _room(top), None)
            yield figure
            figure, top = style.page(content, f"{table.title}, continued"), FIRST
        top = _note(figure, _draw(figure, rest, table, top), table.note) - GAP
    for note in notes(content.view, content.notes):
        if _note_end(top + GAP / 2, note) < EDGE:
            yield figure
            figure, top = style.page(content, "Notes"), FIRST
        top = _note(figure, top + GAP / 2, note) - GAP / 2
    yield figure


def _room(top: float) -> int:
    """Return the number of rows that fit below a heading at this height."""
    return max(int((top - HEAD - LAST - 2 * ROW) / ROW), 0)


def _part(table: Table, first: int, last: int | None) -> Table:
    return replace(table, rows=table.rows[first:last], kinds=table.kinds[first:last])


def _draw(figure: Figure, part: Table, whole: Table, top: float) -> float:
    """Draw some rows of a table under its heading; return their lower edge."""
    edges = _edges(whole)
    for column, (left, right) in zip(whole.columns, edges, strict=True):
        place, align = _flush(column, left, right)
        figure.text(place, top - 0.006, column.name, ha=align, va="top", fontsize=SIZE, fontweight="bold")
        unit = f"[{column.unit}]" if column.unit else ""
        figure.text(place, top - 0.027, unit, ha=align, va="top", fontsize=SIZE, color=style.FAINT)
    top -= HEAD
    _rule(figure, top + 0.006)
    for row, kind in zip(part.rows, part.kinds, strict=True):
        _draw_row(figure, whole, row, kind, top, edges)
        top -= ROW
    _rule(figure, top)
    return top


def _draw_row(
    figure: Figure,
    table: Table,
    row: tuple[str, ...],
    kind: str | None,
    top: float,
    edges: list[tuple[float, float]],
) -> None:
    if kind is not None:
        place = (style.LEFT - 0.014, top - ROW + 0.003), 0.008, ROW - 0.006
        figure.add_artist(Rectangle(*place, facecolor=style.COLOUR_OF_KIND[kind], linewidth=0))
    for column, cell, (left, right) in zip(table.columns, row, edges, strict=True):
        place_x, align = _flush(column, left, right)
        family = "DejaVu Sans" if column.words else "DejaVu Sans Mono"
        figure.text(place_x, top - ROW / 2, cell, ha=align, va="center", fontsize=SIZE, family=family)


def _flush(column: TableColumn, left: float, right: float) -> tuple[float, str]:
    return (left, "left") if column.words else (right, "right")


def _edges(table: Table) -> list[tuple[float, float]]:
    """Return left and right edge of every column, as wide as its longest cell."""
    cells = [[column.name, *(row[i] for row in table.rows)] for i, column in enumerate(table.columns)]
    letters = [max(len(cell) for cell in column) + PADDING for column in cells]
    unit = (style.RIGHT - style.LEFT) / (sum(letters) - PADDING)
    edges, left = [], style.LEFT
    for count in letters:
        edges.append((left, left + (count - PADDING) * unit))
        left += count * unit
    return edges


def _rule(figure: Figure, height: float) -> None:
    figure.add_artist(Line2D([style.LEFT, style.RIGHT], [height, height], color=style.INK, linewidth=0.8))


def _note(figure: Figure, top: float, note: str) -> float:
    """Draw a paragraph below a table; return its lower edge."""
    for line in textwrap.wrap(note, NOTE_LETTERS):
        figure.text(style.LEFT, top - 0.008, line, va="top", fontsize=7.5, color=style.FAINT)
        top -= NOTE_LINE
    return top


def _note_end(top: float, note: str) -> float:
    """Return where a paragraph that begins at this height ends."""
    return top - NOTE_LINE * len(textwrap.wrap(note, NOTE_LETTERS))

"""Reads Caesura's csv: one column per component of a signal, options in comments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from caesura_protocol.columns import missing_columns, signal_columns
from caesura_protocol.formats.calendar_time import EXPECTED, CalendarTimes, is_calendar_time, seconds_of
from caesura_protocol.formats.csv_layout_detection import (
    DELIMITERS,
    PLACES,
    guessed,
    has_own_columns,
    read_layout,
    with_turns,
)
from caesura_protocol.formats.csv_lines import cell_of, is_comment, read_lines, rows_of, stated_in_comments
from caesura_protocol.formats.mapping_file_write import mapping_text
from caesura_protocol.formats.unvalidated_recording import Array, UnvalidatedRecording
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.number_words import counted
from caesura_protocol.recording import (
    OF_FILE,
    STATED,
    RecordingError,
    UnknownColumnsError,
    assumed_by_writer,
    did_you_mean,
)

MOST_NAMED = 20  # columns of a file, in an error


def read_csv(path: Path) -> UnvalidatedRecording:
    """Return arrays and options of a file.

    Raises UnknownColumnsError for columns of other software, RecordingError for a signal without all of its
    columns, and ValueError for a table that is no rectangle of numbers.
    """
    lines = [line.strip() for line in read_lines(path)]
    stated = stated_in_comments(lines)
    numbers = [number for number, line in enumerate(lines, start=1) if line and not is_comment(line)]
    if len(numbers) < 2:
        raise ValueError(f"{counted(len(numbers), 'row')}, expected a header and at least one sample")
    delimiter = _delimiter(lines[numbers[0] - 1])
    if delimiter is None:
        raise _foreign(path)
    rows = _without_last_delimiter(rows_of((lines[number - 1] for number in numbers), delimiter))
    header = rows[0]
    assumed: list[str] = []
    if delimiter != "," and any("," in cell for row in rows[1:] for cell in row):
        rows[1:] = [[cell.replace(",", ".") for cell in row] for row in rows[1:]]
        assumed.append(f"Columns are divided by {delimiter!r}, and the comma is the decimal mark.")
    if has_calendar_time := "t" in header and is_calendar_time(cell_of(rows[1], header.index("t"))):
        times = _with_seconds(header.index("t"), rows[1:], numbers[1:])
        assumed.append(times.in_words)
        stated = {**stated, **times.options}
    column = _columns(header, rows[1:], numbers[1:])
    arrays = {
        signal: np.column_stack([column[name] for name in names])
        for signal, names in _whole_signals(path, column).items()
    }
    if "t" in column:
        arrays["t"] = column["t"]
    known = {"t", *(name for names in COLUMNS_OF_SIGNAL.values() for name in names)}
    options = {key: value for key, value in stated.items() if key in OF_FILE}
    assumed += assumed_by_writer(stated)
    # Other comments are for people, unless they look like an option.
    mistyped = [key for key in stated if key not in STATED and did_you_mean(key) in STATED]
    ignored = [*mistyped, *(name for name in column if name not in known)]
    return UnvalidatedRecording(
        arrays, options, ignored, tuple(assumed), tuple(numbers[1:]), has_calendar_time=has_calendar_time
    )


def _delimiter(header: str) -> str | None:
    """Return the delimiter of Caesura's own csv by its header; None for columns of other software."""
    for delimiter in DELIMITERS:
        if has_own_columns(rows_of([header], delimiter)[0]):
            return delimiter
    return None


def _without_last_delimiter(rows: list[list[str]]) -> list[list[str]]:
    """Return the rows without the empty cell made by a delimiter at their ends.

    The header may have that delimiter or not.
    """
    width = len(rows[0]) if rows[0][-1] else len(rows[0]) - 1
    if all(len(row) == width + 1 and not row[-1] for row in rows[1:]):
        return [row[:width] for row in rows]
    return rows


def _with_seconds(index: int, rows: list[list[str]], lines: Sequence[int]) -> CalendarTimes:
    """Replace the dates of a column by seconds from the first one, in place; return them."""
    cells = [cell_of(row, index) for row in rows]
    times = seconds_of(cells, [f"line {line}" for line in lines])
    for row, time in zip(rows, times.t.tolist(), strict=True):
        if index < len(row):
            row[index] = repr(time)
    return times


def _foreign(path: Path) -> UnknownColumnsError:
    """Return the error for a csv with other columns, which lists them, with an example of a mapping."""
    layout = read_layout(path)
    header, guess = layout.header, with_turns(layout, guessed(layout))
    more = f" and {len(header) - MOST_NAMED} more" if len(header) > MOST_NAMED else ""
    asked = dict.fromkeys(("t", *({} if PLACES & set(guess.columns) else ("px", "py", "pz"))), "…")
    return UnknownColumnsError(
        f"{path}: has the columns {', '.join(header[:MOST_NAMED])}{more}; expected t, and px py pz or "
        "q1 to q7. --mapping FILE names the columns of other software (docs/recordings.md)",
        # The frame of the force is not known: a mapping that states one would hide that it is assumed.
        mapping_text(guess._replace(columns={**asked, **guess.columns}, force_frame=None)),
    )


def _columns(header: list[str], rows: list[list[str]], lines: list[int]) -> dict[str, Array]:
    """Return the table by column; lines: of the rows. Raises ValueError if it is no rectangle of numbers."""
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise ValueError(f"column {twice[0]} comes twice: leave one of them out, or give it another name")
    for line, row in zip(lines, rows, strict=False):
        if len(row) != len(header):
            remedy = ""
            if len(row) > len(header):
                remedy = ": is the comma the decimal mark too? Divide the columns by semicolons"
            elif line == lines[-1]:
                remedy = ": is the file still being written, or was it cut short?"
            raise ValueError(
                f"line {line} has {counted(len(row), 'value')}, "
                f"expected {len(header)} as in the header{remedy}"
            )
    try:
        table = np.array(rows, dtype=np.float64)
    except ValueError:
        for line, row in zip(lines, rows, strict=False):
            for name, cell in zip(header, row, strict=True):
                _check_number(line, name, cell)
        raise
    return dict(zip(header, table.T, strict=True))


def _check_number(line: int, name: str, cell: str) -> None:
    try:
        float(cell)
    except ValueError as error:
        expected = "a number; leave out the rows that have none"
        if name == "t":
            expected = f"a number of seconds, or {EXPECTED}"
        raise ValueError(f"line {line}: {name} is {cell!r}, expected {expected}") from error


def _whole_signals(path: Path, column: Mapping[str, Array]) -> dict[str, tuple[str, ...]]:
    """Return the columns of each signal. Raises RecordingError if a part of one is missing."""
    for signal, names in COLUMNS_OF_SIGNAL.items():
        if missing := missing_columns(signal, column):
            found = [name for name in names if name in column]
            raise RecordingError(f"{path}: has {', '.join(found)} but not {', '.join(missing)}")
    return signal_columns(column)

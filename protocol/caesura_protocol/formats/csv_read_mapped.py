"""Reads a csv file of another layout with a mapping.

For each of Caesura's columns the mapping has the source column, unit and factor.

    delimiter = ";"                  # "," unless said
    decimal = ","                    # "." unless said
    wrench_source = "flange_sensor"

    [time]
    column = "Time"
    unit = "ms"                      # s unless said; ms, us, ns

    [columns]
    px = "X"                         # Caesura's column = the file's
    pz = { column = "Z", unit = "mm" }
    fz = { column = "F3", scale = -1.0 }   # the file has the robot's force on the environment

An orientation is `qx qy qz qw`, or else three angles: `rx ry rz` or `roll pitch yaw` (`TURNS`). If the first
row contains only numbers, there is no header: the names of columns are then their numbers, from 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from caesura_protocol import plausibility
from caesura_protocol.columns import missing_columns, signal_columns
from caesura_protocol.formats.calendar_time import is_calendar_time, seconds_of
from caesura_protocol.formats.csv_lines import (
    BLANK,
    cell_of,
    is_comment,
    read_lines,
    rows_of,
    stated_in_comments,
)
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.unvalidated_recording import Array, UnvalidatedRecording
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import METRES, RADIANS
from caesura_protocol.recording import STATED, RecordingError
from caesura_protocol.rotations import quaternions_of_roll_pitch_yaw, quaternions_of_vectors

#: Orientations as controllers have them in place of quaternions: axis times angle, as Universal Robots; turns
#: about x, then y, then z of the base frame, as UFACTORY.
TURNS: Mapping[str, tuple[str, str, str]] = {
    "rotation_vector": ("rx", "ry", "rz"),
    "roll_pitch_yaw": ("roll", "pitch", "yaw"),
}
MOST_RAD = 6.3  # of one of them
_QUATERNIONS = {"rotation_vector": quaternions_of_vectors, "roll_pitch_yaw": quaternions_of_roll_pitch_yaw}

#: A unit in Caesura's, by signal; positions keep the file's own `length_unit` where no unit is said.
UNITS: Mapping[str, Mapping[str, float]] = {
    "t": plausibility.UNITS["time"],
    "pos": METRES,
    "quat": {"1": 1.0},
    **dict.fromkeys(TURNS, RADIANS),
    "q": RADIANS,
    "force": {"N": 1.0, "kN": 1e3},
    "torque": {"Nm": 1.0, "Nmm": 1e-3},
    "tau": {"Nm": 1.0, "Nmm": 1e-3},
    "gripper": METRES,
}
SIGNAL_OF_COLUMN = {
    "t": "t",
    **{column: s for s, names in (*COLUMNS_OF_SIGNAL.items(), *TURNS.items()) for column in names},
}


class ColumnRule(NamedTuple):
    """The source column, unit and factor of one of Caesura's columns."""

    column: str
    source_column: str
    factor: float
    has_unit: bool = False


class CsvTable(NamedTuple):
    """The cells of a csv file as text, by column name."""

    header: list[str]
    rows: list[list[str]]
    numbers: list[int]  # of the rows, as an editor counts lines
    stated: dict[str, str]  # by the comments


def read_mapped_csv(path: Path, mapped: ColumnMapping) -> UnvalidatedRecording:
    """Return the signals that the mapping names.

    Raises RecordingError; for a missing column it names that one and lists the existing ones.
    """
    table = _table(path, mapped)
    options, contradicted = _options(table, mapped)
    rules = rules_of(mapped, options.get("length_unit", "m"))
    used = {rule.source_column for rule in rules}
    assumed: list[str] = []
    column: dict[str, Array] = {}
    if is_dated := _is_dated(table, rules[0]):
        index = table.header.index(rules[0].source_column)
        if "unit" in mapped.section("time"):
            raise mapped.error("[time] has a unit, and the file has times of day: leave out the unit")
        cells = [cell_of(row, index) for row in table.rows]
        times = seconds_of(cells, [f"{path}, line {number}" for number in table.numbers])
        column["t"] = times.t
        assumed.append(times.in_words)
        options = {**options, **times.options}
        rules = rules[1:]
    column |= {rule.column: _numbers(path, mapped, table, rule) * rule.factor for rule in rules}
    arrays = {"t": column["t"]}
    for signal, names in COLUMNS_OF_SIGNAL.items():
        if missing := missing_columns(signal, column):
            raise mapped.error(f"{signal} needs {', '.join(names)}; {', '.join(missing)} is not in [columns]")
    for signal, names in signal_columns(column).items():
        arrays[signal] = np.column_stack([column[name] for name in names])
    arrays |= _turned(mapped, column)
    ignored = [*contradicted, *(name for name in table.header if name not in used)]
    return UnvalidatedRecording(
        arrays,
        options,
        ignored,
        tuple(assumed),
        tuple(table.numbers),
        has_calendar_time=is_dated,
        mapped_units=frozenset(SIGNAL_OF_COLUMN[rule.column] for rule in rules if rule.has_unit),
    )


def _turned(mapped: ColumnMapping, column: Mapping[str, Array]) -> dict[str, Array]:
    """Return the quaternions of three angles.

    Raises RecordingError if they are incomplete or defined twice.
    """
    stated = {signal: names for signal, names in TURNS.items() if set(names) & set(column)}
    if len(stated) + ("qx" in column) > 1:
        there = [*stated.values()] + ([COLUMNS_OF_SIGNAL["quat"]] if "qx" in column else [])
        raise mapped.error(
            f"the orientation is there as {' and as '.join(map(' '.join, there))}: leave one out"
        )
    for signal, names in stated.items():
        if missing := [name for name in names if name not in column]:
            raise mapped.error(f"{signal} needs {', '.join(names)}; {', '.join(missing)} is not in [columns]")
        angles = np.column_stack([column[name] for name in names])
        if (largest := float(np.abs(angles).max(initial=0.0))) > MOST_RAD:
            raise mapped.error(
                f"{' '.join(names)} turn to {largest:.4g} rad, at most {MOST_RAD} rad are plausible: "
                'probably in deg. State unit = "deg" for each of them'
            )
        return {"quat": _QUATERNIONS[signal](angles)}
    return {}


def _options(table: CsvTable, mapped: ColumnMapping) -> tuple[dict[str, str], list[str]]:
    """Return the options of comments and mapping, and the comments that the mapping contradicts.

    The mapping takes precedence.
    """
    stated = {key: value for key, value in table.stated.items() if key in STATED}
    contradicted = [
        f"# {key}: {value}, because {mapped.name} states {mapped.options[key]}"
        for key, value in stated.items()
        if mapped.options.get(key, value) != value
    ]
    return {**stated, **mapped.options}, contradicted


def _is_dated(table: CsvTable, rule: ColumnRule) -> bool:
    """Return whether the times are dates."""
    if rule.source_column not in table.header or not table.rows:
        return False
    return is_calendar_time(cell_of(table.rows[0], table.header.index(rule.source_column)))


def rules_of(mapped: ColumnMapping, length_unit: str = "m") -> list[ColumnRule]:
    """Return the rule of each mapped column, that of `t` first. Raises RecordingError.

    length_unit: the recording's unit of positions.
    """
    time = mapped.section("time")
    if not time:
        raise mapped.error('has no [time], expected for example [time] with column = "t"')
    columns = mapped.section("columns")
    mapped.check_keys("[columns]", columns, [name for name in SIGNAL_OF_COLUMN if name != "t"])
    return [_rule(mapped, column, entry, length_unit) for column, entry in (("t", time), *columns.items())]


def _rule(mapped: ColumnMapping, column: str, entry: Any, length_unit: str) -> ColumnRule:
    where = "[time]" if column == "t" else f"[columns] {column}"
    if isinstance(entry, str | int) and not isinstance(entry, bool):
        return ColumnRule(column, str(entry), 1.0)
    if not isinstance(entry, Mapping) or "column" not in entry:
        raise mapped.error(f"{where} is {entry!r}, expected a column's name or {{ column = …, unit = … }}")
    mapped.check_keys(where, entry, ("column", "unit", "scale"))
    units = UNITS[SIGNAL_OF_COLUMN[column]]
    unit = str(entry.get("unit", next(iter(units))))
    if unit not in units:
        raise mapped.error(f"{where}: unit {unit!r}, expected one of {', '.join(units)}")
    factor = units[unit]
    if "unit" in entry and SIGNAL_OF_COLUMN[column] == "pos":  # the rest of pos may be in another unit
        factor /= METRES[length_unit]
    factor *= _scale(mapped, where, entry.get("scale", 1.0))
    return ColumnRule(column, str(entry["column"]), factor, "unit" in entry)


def _scale(mapped: ColumnMapping, where: str, entry: Any) -> float:
    if isinstance(entry, bool) or not isinstance(entry, int | float) or not np.isfinite(entry) or entry == 0:
        raise mapped.error(f"{where}: scale is {entry!r}, expected a number that is not 0")
    return float(entry)


def _table(path: Path, mapped: ColumnMapping) -> CsvTable:
    delimiter = str(mapped.table.get("delimiter", ","))
    if len(delimiter) != 1:
        raise mapped.error(f"delimiter is {delimiter!r}, expected one character")
    text = read_lines(path)
    kept = [(n, line) for n, line in enumerate(text, 1) if line.strip() and not is_comment(line)]
    rows = rows_of((line for _, line in kept), delimiter)
    if not rows:
        raise RecordingError(f"{path}: no rows, expected at least one sample")
    numbers, stated = [n for n, _ in kept], stated_in_comments(text)
    decimal = str(mapped.table.get("decimal", "."))
    if all(_is_number(cell, decimal) for cell in rows[0]):
        return CsvTable([str(i + 1) for i in range(len(rows[0]))], rows, numbers, stated)
    return CsvTable(rows[0], rows[1:], numbers[1:], stated)


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _numbers(path: Path, mapped: ColumnMapping, table: CsvTable, rule: ColumnRule) -> Array:
    """Return one column as numbers. Raises RecordingError with the column, the line and the value."""
    found = table.header.count(rule.source_column)
    if found != 1:
        what = f"{counted(found, 'column') if found else 'no column'} {rule.source_column!r}"
        raise RecordingError(
            f"{path}: {what}, from which {mapped.name} takes {rule.column}; "
            f"it has {', '.join(map(repr, table.header))}{_hint(table.header)}"
        )
    index, decimal = table.header.index(rule.source_column), str(mapped.table.get("decimal", "."))
    values = np.empty(len(table.rows))
    for i, (number, row) in enumerate(zip(table.numbers, table.rows, strict=True)):
        try:
            values[i] = float(row[index].replace(decimal, "."))
        except (IndexError, ValueError):
            shown = repr(row[index]) if index < len(row) else f"nothing ({counted(len(row), 'value')})"
            dates = ", or a date such as 2026-11-26T14:30:00.250" if rule.column == "t" else ""
            raise RecordingError(
                f"{path}, line {number}: column {rule.source_column!r} has {shown}, expected a number "
                f"with {decimal!r} as its decimal mark{dates}"
            ) from None
    return values


def _hint(header: list[str]) -> str:
    """Return a question on the delimiter if the only column's name contains a separator; otherwise empty."""
    for delimiter in (";", "\t", "|", BLANK):
        if len(header) == 1 and delimiter in header[0]:
            return f"; is the delimiter {delimiter!r}?"
    return ""

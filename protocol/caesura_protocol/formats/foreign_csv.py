"""A csv file in another layout, read by a mapping: column, unit and factor of each of Caesura's columns.

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

Where the first row holds numbers alone there is no header: columns are then called by their number, from 1.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from caesura_protocol import plausibility
from caesura_protocol.formats.column_mapping import ColumnMapping
from caesura_protocol.formats.raw_recording import Array, RawRecording
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.plausibility import METRES, RADIANS
from caesura_protocol.recording import RecordingError

#: A unit in Caesura's, by signal; positions keep the file's own `length_unit` where no unit is said.
UNITS: Mapping[str, Mapping[str, float]] = {
    "t": plausibility.UNITS["time"],
    "pos": METRES,
    "quat": {"1": 1.0},
    "q": RADIANS,
    "force": {"N": 1.0, "kN": 1e3},
    "torque": {"Nm": 1.0, "Nmm": 1e-3},
    "tau": {"Nm": 1.0, "Nmm": 1e-3},
    "gripper": METRES,
}
SIGNAL_OF_COLUMN = {"t": "t", **{column: s for s, names in COLUMNS_OF_SIGNAL.items() for column in names}}


class Rule(NamedTuple):
    """The source of one of Caesura's columns."""

    ours: str
    theirs: str
    factor: float


class CsvTable(NamedTuple):
    """A csv file by column name; text as it stands."""

    header: list[str]
    rows: list[list[str]]
    numbers: list[int]  # of the rows, as an editor counts lines


def read_foreign_csv(path: Path, mapped: ColumnMapping) -> RawRecording:
    """The signals that the mapping names. Raises RecordingError, which names the column and what there is."""
    rules = rules_of(mapped)
    table = _table(path, mapped)
    column = {rule.ours: _numbers(path, mapped, table, rule) * rule.factor for rule in rules}
    arrays = {"t": column["t"]}
    for signal, names in COLUMNS_OF_SIGNAL.items():
        missing = [name for name in names if name not in column]
        if not missing:
            arrays[signal] = np.column_stack([column[name] for name in names])
        elif len(missing) < len(names):
            raise mapped.wrong(f"{signal} needs {', '.join(names)}; {', '.join(missing)} is not in [columns]")
    used = {rule.theirs for rule in rules}
    return RawRecording(arrays, mapped.options, [name for name in table.header if name not in used])


def rules_of(mapped: ColumnMapping) -> list[Rule]:
    """What the mapping says of each column. Raises RecordingError."""
    time = mapped.part("time")
    if not time:
        raise mapped.wrong('has no [time], expected for example [time] with column = "t"')
    columns = mapped.part("columns")
    mapped.known("[columns]", columns, [name for name in SIGNAL_OF_COLUMN if name != "t"])
    return [_rule(mapped, "t", time), *(_rule(mapped, ours, said) for ours, said in columns.items())]


def _rule(mapped: ColumnMapping, ours: str, said: Any) -> Rule:
    where = "[time]" if ours == "t" else f"[columns] {ours}"
    if isinstance(said, str | int) and not isinstance(said, bool):
        return Rule(ours, str(said), 1.0)
    if not isinstance(said, Mapping) or "column" not in said:
        raise mapped.wrong(f"{where} is {said!r}, expected a column's name or {{ column = …, unit = … }}")
    mapped.known(where, said, ("column", "unit", "scale"))
    units = UNITS[SIGNAL_OF_COLUMN[ours]]
    unit = str(said.get("unit", next(iter(units))))
    if unit not in units:
        raise mapped.wrong(f"{where}: unit {unit!r}, expected one of {', '.join(units)}")
    factor = units[unit]
    if "unit" in said and SIGNAL_OF_COLUMN[ours] == "pos":  # the rest of pos may be in another unit
        factor /= METRES[mapped.options.get("length_unit", "m")]
    return Rule(ours, str(said["column"]), factor * _scale(mapped, where, said.get("scale", 1.0)))


def _scale(mapped: ColumnMapping, where: str, said: Any) -> float:
    if isinstance(said, bool) or not isinstance(said, int | float) or not np.isfinite(said) or said == 0:
        raise mapped.wrong(f"{where}: scale is {said!r}, expected a number that is not 0")
    return float(said)


def _table(path: Path, mapped: ColumnMapping) -> CsvTable:
    delimiter = str(mapped.table.get("delimiter", ","))
    if len(delimiter) != 1:
        raise mapped.wrong(f"delimiter is {delimiter!r}, expected one character")
    text = path.read_text(encoding="utf-8-sig").splitlines()
    kept = [(n, line) for n, line in enumerate(text, 1) if line.strip() and not line.startswith("#")]
    rows = list(csv.reader((line for _, line in kept), delimiter=delimiter))
    if not rows:
        raise RecordingError(f"{path}: no rows")
    rows = [[cell.strip() for cell in row] for row in rows]
    numbers = [n for n, _ in kept]
    decimal = str(mapped.table.get("decimal", "."))
    if all(_is_number(cell, decimal) for cell in rows[0]):
        return CsvTable([str(i + 1) for i in range(len(rows[0]))], rows, numbers)
    return CsvTable(rows[0], rows[1:], numbers[1:])


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _numbers(path: Path, mapped: ColumnMapping, table: CsvTable, rule: Rule) -> Array:
    """Return one column. Raises RecordingError, which names the column, the line and the value."""
    found = table.header.count(rule.theirs)
    if found != 1:
        what = f"no column {rule.theirs!r}" if not found else f"{found} columns {rule.theirs!r}"
        raise RecordingError(
            f"{path}: {what}, from which {mapped.name} takes {rule.ours}; "
            f"it has {', '.join(map(repr, table.header))}{_hint(table.header)}"
        )
    index, decimal = table.header.index(rule.theirs), str(mapped.table.get("decimal", "."))
    values = np.empty(len(table.rows))
    for i, (number, row) in enumerate(zip(table.numbers, table.rows, strict=True)):
        try:
            values[i] = float(row[index].replace(decimal, "."))
        except (IndexError, ValueError):
            shown = repr(row[index]) if index < len(row) else f"nothing ({len(row)} values)"
            raise RecordingError(
                f"{path}, line {number}: column {rule.theirs!r} has {shown}, expected a number "
                f"with {decimal!r} as its decimal mark"
            ) from None
    return values


def _hint(header: list[str]) -> str:
    """One column whose name holds separators is a sign of another delimiter."""
    for delimiter in (";", "\t", "|"):
        if len(header) == 1 and delimiter in header[0]:
            return f"; is the delimiter {delimiter!r}?"
    return ""

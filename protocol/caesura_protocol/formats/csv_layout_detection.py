"""Infers delimiter, decimal mark, columns and their probable meaning of a csv file of other software.

A guess is a proposal for an operator to confirm. Names used by other software are in `ALIASES`. A unit
follows from the column's name, such as `Zeit [ms]`, or else it is the one in which the values are plausible.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import islice, takewhile
from pathlib import Path

import numpy as np

from caesura_protocol.columns import signal_columns
from caesura_protocol.formats.csv_aliases import ALIASES, TURN_ALIASES
from caesura_protocol.formats.csv_lines import (
    BLANK,
    encoding_of,
    is_comment,
    read_lines,
    rows_of,
    stated_in_comments,
)
from caesura_protocol.formats.csv_read_mapped import MOST_RAD, SIGNAL_OF_COLUMN, TURNS, UNITS
from caesura_protocol.formats.mapping_file_write import MappingAnswers
from caesura_protocol.formats.sample_checks import is_quaternion
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import METRES, RADIANS, implausible, likely_opening_unit
from caesura_protocol.recording import STATED, RecordingError

DELIMITERS = (";", "\t", "|", ",", BLANK)  # in this order: a comma may be a decimal mark
MOST_ROWS = 2000  # that are looked at
MOST_COLUMNS = 500
MOST_SHOWN = 40  # characters of a line, in an error
FLANGE = ("flange", "flansch")
KNOWN_BY_UNIT = ("force", "torque", "pos")
PLACES = {name for signal in ("pos", "q") for name in COLUMNS_OF_SIGNAL[signal]}
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+([eE][-+]?\d+)?\s*")


@dataclass(frozen=True)
class CsvLayout:
    """The form of a csv file. rows: the first samples, as text; header: numbers from 1 if the file has none.

    stated: options in the file's comments, such as `# wrench_source: flange_sensor`.
    """

    name: str
    delimiter: str
    decimal: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    stated: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_own(self) -> bool:
        """Whether the file has Caesura's own form, which needs no mapping."""
        return has_own_columns(self.header)

    def numbers(self, column: str) -> Array:
        """Return the values of a column among `rows`; NaN for a cell that is not a number."""
        index = self.header.index(column)
        return np.array([_number(row[index], self.decimal) for row in self.rows if index < len(row)])


def has_own_columns(header: Collection[str]) -> bool:
    """Return whether a csv has Caesura's columns; any other one needs a mapping."""
    return "t" in header and bool(PLACES & set(header))


def read_layout(path: Path) -> CsvLayout:
    """Infer the layout from the beginning of a csv file. Raises RecordingError if it contains no table."""
    try:
        with path.open(encoding=encoding_of(path), newline="") as file:
            first = list(islice((line for line in file if line.strip()), MOST_ROWS))
    except OSError as error:
        raise RecordingError(f"{path.name}: not a readable csv file ({error})") from error
    except UnicodeDecodeError:
        first = read_lines(path)  # raises, with the line
    lines = [line for line in first if not is_comment(line)]
    if len(lines) < 2:
        raise RecordingError(
            f"{path.name}: {counted(len(lines), 'row')}, expected a header and at least one sample"
        )
    delimiter = next((one for one in DELIMITERS if _columns_by(lines[:20], one) > 1), ",")
    rows = [tuple(row) for row in rows_of(lines, delimiter)]
    if not 1 < len(rows[0]) <= MOST_COLUMNS:
        raise RecordingError(
            f"{path.name}: the first row, {lines[0].strip()[:MOST_SHOWN]!r}, has "
            f"{counted(len(rows[0]), 'column')}, expected names of 2 to {MOST_COLUMNS}, "
            f"divided by one of {', '.join(map(repr, DELIMITERS))}; "
            "comment lines above them begin with #"
        )
    commas = sum(bool(_DECIMAL_COMMA.fullmatch(cell)) for row in rows[:20] for cell in row)
    decimal = "," if commas and delimiter != "," else "."
    stated = {key: value for key, value in stated_in_comments(first).items() if key in STATED}
    if all(np.isfinite(_number(cell, decimal)) for cell in rows[0]):
        return CsvLayout(path.name, delimiter, decimal, _numbered(len(rows[0])), tuple(rows), stated)
    return CsvLayout(path.name, delimiter, decimal, rows[0], tuple(rows[1:]), stated)


def guessed(layout: CsvLayout) -> MappingAnswers:
    """Return the most likely meaning of the columns; an incomplete signal is left out.

    A signal without a known name may be recognised by its unit: see `_by_unit`.
    """
    found = {column: _called(layout.header, aliases) for column, aliases in ALIASES.items()}
    named = {column: name for column, name in found.items() if name is not None}
    named |= _counted_from_zero(layout, "q") | _counted_from_zero(layout, "tau")
    named = _with_quaternion(layout, named)
    whole = {"t", *(column for names in signal_columns(named).values() for column in names)}
    columns = {column: name for column, name in named.items() if column in whole}
    others = [name for name in layout.header if name not in columns.values()]
    for signal in KNOWN_BY_UNIT:
        if not set(COLUMNS_OF_SIGNAL[signal]) & set(columns):
            columns |= _by_unit(others, signal)
    return MappingAnswers(
        delimiter=layout.delimiter,
        decimal=layout.decimal,
        columns=columns,
        units=likely_units(layout, columns),
    )


def _called(header: Collection[str], aliases: Collection[str]) -> str | None:
    """Return the column with one of these names, the flange's first.

    Else the only one whose path ends with one.

    >>> _called(["tcp_x", "flange_x"], {"tcpx", "flangex"}), _called(["field.pose.position.x"], {"positionx"})
    ('flange_x', 'field.pose.position.x')
    """
    named = [name for name in header if _plain(name) in aliases]
    if named:
        return next((name for name in named if _plain(name).startswith(FLANGE)), named[0])
    ending = [name for name in header if any(_plain(end) in aliases for end in _endings(name))]
    return ending[0] if len(ending) == 1 else None


def _endings(name: str) -> list[str]:
    """Return the suffixes of a path with two or more parts, such as a ROS topic.

    >>> _endings("/ee/pose/position/x")
    ['pose/position/x', 'position/x']
    """
    parts = re.split(r"[/.]", name.strip("/."))
    return ["/".join(parts[first:]) for first in range(1, len(parts) - 1)]


def _counted_from_zero(layout: CsvLayout, signal: str) -> dict[str, str]:
    """Return the columns of a joint signal if the file counts from 0: `q0` is the first joint."""
    plain = {_plain(name): name for name in layout.header}
    columns = COLUMNS_OF_SIGNAL[signal]
    stems = [name[:-1] for name in plain if name.endswith("0") and f"{name[:-1]}1" in ALIASES[columns[0]]]
    if not stems:
        return {}
    names = takewhile(plain.__contains__, (f"{stems[0]}{number}" for number in range(len(columns))))
    return {column: plain[name] for column, name in zip(columns, names, strict=False)}


def _with_quaternion(layout: CsvLayout, named: Mapping[str, str]) -> dict[str, str]:
    """Return the columns without four joints whose squares add up to 1: these are a quaternion.

    `q0 q1 q2 q3` have w first. The order of `q1 q2 q3 q4` is unknown, so they are left out.
    """
    columns = COLUMNS_OF_SIGNAL["q"]
    joints = [named[column] for column in columns if column in named]
    if not is_quaternion(np.column_stack([layout.numbers(name) for name in joints]) if joints else None):
        return dict(named)
    others = {column: name for column, name in named.items() if column not in columns}
    if "qx" in named or _plain(joints[0]) != "q0":
        return others
    return {**others, **dict(zip(("qw", "qx", "qy", "qz"), joints, strict=True))}


def with_turns(layout: CsvLayout, guess: MappingAnswers) -> MappingAnswers:
    """Return a guess with the orientation as three angles, if the names show their convention."""
    if "qx" in guess.columns:
        return guess
    for names in TURNS.values():
        found = [
            next((name for name in layout.header if _plain(name) in TURN_ALIASES[column]), None)
            for column in names
        ]
        if (whole := [name for name in found if name is not None]) == found:
            columns = {**guess.columns, **dict(zip(names, whole, strict=True))}
            return guess._replace(columns=columns, units=likely_units(layout, columns))
    return guess


def likely_units(layout: CsvLayout, columns: Mapping[str, str]) -> dict[str, str]:
    """Return the unit of each signal: stated in its columns' names, or else the one that is plausible."""
    units: dict[str, str] = {}
    for column, name in columns.items():
        signal = SIGNAL_OF_COLUMN[column]
        if (unit := _unit_in(name, UNITS[signal])) is not None:
            units.setdefault(signal, unit)
    values = {column: layout.numbers(name) for column, name in columns.items()}
    if "gripper" in values and (unit := likely_opening_unit(np.max(np.abs(values["gripper"]), initial=0.0))):
        units.setdefault("gripper", unit)
    units = _in_degrees(values) | units
    if "t" not in values or not np.isfinite(values["t"]).all():
        return units
    t = values["t"] * UNITS["t"][units.get("t", "s")]
    signals = {
        signal: np.column_stack([values[name] for name in names])
        for signal, names in signal_columns(values).items()
        if len({values[name].size for name in names} | {t.size}) == 1
    }
    for signal, known in (("pos", METRES), ("q", RADIANS), ("force", UNITS["force"])):
        if signal in signals and signal in units:
            signals[signal] = signals[signal] * known[units[signal]]
    quantities = {"time": "t", "length": "pos", "angle": "q", "force": "force"}
    sure = [quantity for quantity, signal in quantities.items() if signal in units]
    while (wrong := implausible(t, signals, declared=sure)) is not None:
        signal = quantities[wrong.quantity]
        if wrong.likely is not None and wrong.likely in UNITS[signal]:
            units[signal] = wrong.likely
            if signal == "t":
                t = t * UNITS["t"][wrong.likely]
        sure.append(wrong.quantity)
    return units


def _in_degrees(values: Mapping[str, Array]) -> dict[str, str]:
    """Return the unit of three angles, one of which is too large for radians. values: by Caesura's column."""
    return {
        signal: "deg"
        for signal, names in TURNS.items()
        if any(np.abs(values[name]).max(initial=0.0) > MOST_RAD for name in names if name in values)
    }


def _by_unit(header: Collection[str], signal: str) -> dict[str, str]:
    """Return the columns of a signal: the only three in its unit whose names differ only by x, y and z.

    >>> _by_unit(["Sensor X [N]", "Sensor Y [N]", "Sensor Z [N]"], "force")["fy"]
    'Sensor Y [N]'
    """
    plain = {_plain(name): name for name in header if _unit_in(name, UNITS[signal]) is not None}
    triples = [
        [plain[name[:at] + axis + name[at + 1 :]] for axis in "xyz"]
        for name in plain
        for at, letter in enumerate(name)
        if letter == "x" and {f"{name[:at]}{axis}{name[at + 1 :]}" for axis in "yz"} <= set(plain)
    ]
    return dict(zip(COLUMNS_OF_SIGNAL[signal], triples[0], strict=True)) if len(triples) == 1 else {}


def _columns_by(lines: list[str], delimiter: str) -> int:
    """Return the number of columns that the delimiter makes of every line; 1 if lines differ.

    If lines have another delimiter, a blank is not one: it is part of names, as in `Time [s]`.
    """
    if delimiter == BLANK and set(lines[0]) & set(DELIMITERS) - {BLANK}:
        return 1
    widths = {len(row) for row in rows_of(lines, delimiter)}
    return widths.pop() if len(widths) == 1 else 1


def _number(cell: str, decimal: str) -> float:
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return float("nan")


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(str(i + 1) for i in range(count))


_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_INDEX = re.compile(r"[\[(](\d+)[\])]")  # as in q[0]
_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]*)\s*[\])>]")
# As in `x_mm`, `x in mm` and `x/mm`, and not the `s` of `v m/s`.
_TRAILING_UNIT = re.compile(
    r"(?: in)?(?:[ _]|(?<!\bm)(?<!_m)(?<!mm)(?<!rad)(?<!deg)/)"
    r"(ms|us|ns|s|sec|mm|cm|m|rad|deg|N|kN|Nm|Nmm)\s*$"
)


def _plain(name: str) -> str:
    """Return a column's name without its unit, case and separators.

    >>> _plain("TCP_Position.X [mm]"), _plain("time_ms"), _plain("Öffnung")
    ('tcppositionx', 'time', 'oeffnung')
    """
    bare = _BRACKETS.sub("", _INDEX.sub(r"\1", name))
    bare = _TRAILING_UNIT.sub("", bare)
    return re.sub(r"[^a-z0-9]", "", bare.lower().translate(_UMLAUTS))


def _unit_in(name: str, known: Mapping[str, float]) -> str | None:
    """Return the unit in a column's name.

    >>> _unit_in("Zeit [ms]", {"s": 1.0, "ms": 1e-3}), _unit_in("x_mm", {"mm": 1e-3})
    ('ms', 'mm')
    """
    words = [*_BRACKETS.findall(name), *re.split(r"[ _]", name)[1:], *_TRAILING_UNIT.findall(name)]
    return next((word.strip() for word in words if word.strip() in known), None)

"""The layout of a csv file of other software: delimiter, decimal mark, columns, and what each probably is.

A guess is a proposal for a person to confirm. Names that other software uses are in `ALIASES`. A unit is
taken from the column's name, such as `Zeit [ms]`, or else it is the one in which the values are plausible.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np

from caesura_protocol.columns import signal_columns
from caesura_protocol.formats.csv_text import encoding_of, is_comment, read_lines, stated_in_comments
from caesura_protocol.formats.foreign_csv import SIGNAL_OF_COLUMN, UNITS
from caesura_protocol.formats.mapping_text import MappingAnswers
from caesura_protocol.formats.raw_recording import Array
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.plausibility import METRES, RADIANS, implausible, likely_opening_unit
from caesura_protocol.recording import STATED, RecordingError

DELIMITERS = (";", "\t", "|", ",")  # in this order: a comma may be a decimal mark
MOST_ROWS = 2000  # that are looked at
MOST_COLUMNS = 500
MOST_SHOWN = 40  # characters of a line, in an error
KNOWN_BY_UNIT = ("force", "torque", "pos")
PLACES = {name for signal in ("pos", "q") for name in COLUMNS_OF_SIGNAL[signal]}
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+([eE][-+]?\d+)?\s*")


@dataclass(frozen=True)
class CsvLayout:
    """The form of a csv file. rows: the first samples, as text; header: numbers from 1 where it has none.

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
        """Whether it is Caesura's own form, which needs no mapping."""
        return has_own_columns(self.header)

    def numbers(self, column: str) -> Array:
        """Return the values of a column among `rows`; NaN where one is no number."""
        index = self.header.index(column)
        return np.array([_number(row[index], self.decimal) for row in self.rows if index < len(row)])


def has_own_columns(header: Collection[str]) -> bool:
    """Return whether a csv has Caesura's columns; another one needs a mapping."""
    return "t" in header and bool(PLACES & set(header))


def read_layout(path: Path) -> CsvLayout:
    """Look at the beginning of a csv file. Raises RecordingError where it holds no table."""
    try:
        with path.open(encoding=encoding_of(path), newline="") as file:
            first = list(islice((line for line in file if line.strip()), MOST_ROWS))
    except OSError as error:
        raise RecordingError(f"{path.name}: not a readable csv file ({error})") from error
    except UnicodeDecodeError:
        first = read_lines(path)  # raises, with the line
    lines = [line for line in first if not is_comment(line)]
    if len(lines) < 2:
        raise RecordingError(f"{path.name}: {len(lines)} rows, expected a header and at least one sample")
    delimiter = next((one for one in DELIMITERS if _columns_by(lines[:20], one) > 1), ",")
    rows = [tuple(cell.strip() for cell in row) for row in csv.reader(lines, delimiter=delimiter)]
    if not 1 < len(rows[0]) <= MOST_COLUMNS:
        raise RecordingError(
            f"{path.name}: the first row, {lines[0].strip()[:MOST_SHOWN]!r}, has {len(rows[0])} columns, "
            f"expected names of 2 to {MOST_COLUMNS}, divided by one of {', '.join(map(repr, DELIMITERS))}; "
            "# begins a line above them that is for people"
        )
    commas = sum(bool(_DECIMAL_COMMA.fullmatch(cell)) for row in rows[:20] for cell in row)
    decimal = "," if commas and delimiter != "," else "."
    stated = {key: value for key, value in stated_in_comments(first).items() if key in STATED}
    if all(np.isfinite(_number(cell, decimal)) for cell in rows[0]):
        return CsvLayout(path.name, delimiter, decimal, _numbered(len(rows[0])), tuple(rows), stated)
    return CsvLayout(path.name, delimiter, decimal, rows[0], tuple(rows[1:]), stated)


def guessed(layout: CsvLayout) -> MappingAnswers:
    """The most likely meaning of the columns; a signal that is there in part is left out.

    A signal that has no known name may be known by its unit: see `_by_unit`.
    """
    found = {
        column: next((name for name in layout.header if _plain(name) in ALIASES[column]), None)
        for column in SIGNAL_OF_COLUMN
    }
    named = {column: name for column, name in found.items() if name is not None}
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


def likely_units(layout: CsvLayout, columns: Mapping[str, str]) -> dict[str, str]:
    """The unit of each signal: from the names of its columns, or else the one that makes it plausible."""
    units: dict[str, str] = {}
    for column, name in columns.items():
        signal = SIGNAL_OF_COLUMN[column]
        if (unit := _unit_in(name, UNITS[signal])) is not None:
            units.setdefault(signal, unit)
    values = {column: layout.numbers(name) for column, name in columns.items()}
    if "gripper" in values and (unit := likely_opening_unit(np.max(np.abs(values["gripper"]), initial=0.0))):
        units.setdefault("gripper", unit)
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


def _by_unit(header: Collection[str], signal: str) -> dict[str, str]:
    """The columns of a signal: the only three in its unit whose names differ by x, y and z alone.

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
    """How many columns the delimiter makes of every line; 1 where lines differ."""
    widths = {len(row) for row in csv.reader(lines, delimiter=delimiter)}
    return widths.pop() if len(widths) == 1 else 1


def _number(cell: str, decimal: str) -> float:
    try:
        return float(cell.replace(decimal, "."))
    except ValueError:
        return float("nan")


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(str(i + 1) for i in range(count))


_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_BRACKETS = re.compile(r"[\[(<]\s*([^\])>]*)\s*[\])>]")


def _plain(name: str) -> str:
    """A column's name without its unit, its case and its separators.

    >>> _plain("TCP_Position.X [mm]"), _plain("time_ms"), _plain("Öffnung")
    ('tcppositionx', 'time', 'oeffnung')
    """
    bare = _BRACKETS.sub("", name)
    bare = re.sub(r"[ _](ms|us|ns|s|sec|mm|cm|m|rad|deg|N|kN|Nm|Nmm)\s*$", "", bare)
    return re.sub(r"[^a-z0-9]", "", bare.lower().translate(_UMLAUTS))


def _unit_in(name: str, known: Mapping[str, float]) -> str | None:
    """The unit that a column's name states.

    >>> _unit_in("Zeit [ms]", {"s": 1.0, "ms": 1e-3}), _unit_in("x_mm", {"mm": 1e-3})
    ('ms', 'mm')
    """
    words = [*_BRACKETS.findall(name), *re.split(r"[ _]", name)[1:]]
    return next((word.strip() for word in words if word.strip() in known), None)


def _aliases() -> dict[str, frozenset[str]]:
    found: dict[str, set[str]] = {column: {column} for column in SIGNAL_OF_COLUMN}
    found["t"] |= {"time", "timestamp", "zeit", "seconds", "elapsed", "elapsedtime", "stamp", "timestep"}
    found["t"] |= {"zeitstempel", "sekunden", "laufzeit", "messzeit", "sampletime"}
    found["gripper"] |= {"gripperwidth", "width", "gripperopening", "opening", "gripperposition"}
    found["gripper"] |= {"greifer", "greiferoeffnung", "oeffnung", "oeffnungsweite", "greiferweite"}
    found["gripper"] |= {"greiferbreite", "greiferposition", "fingerwidth", "jawopening", "fingerabstand"}
    for i, axis in enumerate("xyz"):
        places: tuple[str, ...] = (
            "{0}",
            "pos{0}",
            "position{0}",
            "{0}pos",
            "tcp{0}",
            "tcppos{0}",
            "tcpposition{0}",
            "ee{0}",
        )
        places += ("eepos{0}", "eeposition{0}", "flange{0}", "poseposition{0}", "positionee{0}")
        places += (
            "flansch{0}",
            "lage{0}",
            "koordinate{0}",
            "{0}koordinate",
            "coordinate{0}",
            "{0}coordinate",
        )
        places += ("{0}position", "tcplage{0}", "tcpkoordinate{0}", "werkzeug{0}", "tool{0}")
        forces: tuple[str, ...] = (
            "force{0}",
            "{0}force",
            "wrenchforce{0}",
            "ftforce{0}",
            "tcpforce{0}",
            "forcetcp{0}",
        )
        forces += ("kraft{0}", "{0}kraft", "tcpkraft{0}", "krafttcp{0}", "kontaktkraft{0}", "contactforce{0}")
        moments: tuple[str, ...] = (
            "t{0}",
            "torque{0}",
            "{0}torque",
            "moment{0}",
            "wrenchtorque{0}",
            "tq{0}",
            "trq{0}",
        )
        moments += ("drehmoment{0}", "{0}drehmoment", "{0}moment", "tcpmoment{0}", "kraftmoment{0}")
        for letter, spellings in (("p", places), ("f", forces), ("m", moments)):
            found[f"{letter}{axis}"] |= {spelling.format(axis) for spelling in spellings}
        # UR's RTDE counts from 0: three of a place, and three and three of a wrench.
        found[f"p{axis}"].add(f"actualtcppose{i}")
        found[f"f{axis}"] |= {f"actualtcpforce{i}", f"f{i + 1}"}
        found[f"m{axis}"].add(f"actualtcpforce{i + 3}")
    for axis in "xyzw":
        found[f"q{axis}"] |= {
            f"quat{axis}",
            f"quaternion{axis}",
            f"orientation{axis}",
            f"poseorientation{axis}",
            f"orientierung{axis}",
        }
    joints: tuple[tuple[str, tuple[str, ...]], ...] = (
        ("q", ("joint{0}", "j{0}", "a{0}", "jointposition{0}", "jointpos{0}", "axis{0}")),
        (
            "q",
            (
                "jointangle{0}",
                "gelenk{0}",
                "gelenkwinkel{0}",
                "gelenkposition{0}",
                "achse{0}",
                "achswinkel{0}",
            ),
        ),
        ("tau", ("jointtorque{0}", "externaltorque{0}", "tauext{0}", "tauj{0}")),
        ("tau", ("gelenkmoment{0}", "achsmoment{0}", "externesmoment{0}", "gelenkdrehmoment{0}")),
    )
    for signal, patterns in joints:
        for i, column in enumerate(COLUMNS_OF_SIGNAL[signal]):
            found[column] |= {pattern.format(i + 1) for pattern in patterns}
            if signal == "q":
                found[column].add(f"actualq{i}")
    return {column: frozenset(names) for column, names in found.items()}


#: Names without case, unit and separators, by Caesura's column.
ALIASES: Mapping[str, frozenset[str]] = _aliases()

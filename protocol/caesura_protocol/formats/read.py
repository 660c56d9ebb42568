"""Read a recording from a file: npz, csv, MCAP or a rosbag2."""

from __future__ import annotations

import csv
import re
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, is_zipfile

import numpy as np

from caesura_protocol.columns import missing_columns, signal_columns
from caesura_protocol.distribution import import_extra
from caesura_protocol.formats.column_mapping import load_mapping
from caesura_protocol.formats.csv_layout import PLACES, guessed, has_own_columns, read_layout
from caesura_protocol.formats.foreign_csv import read_foreign_csv
from caesura_protocol.formats.mapping_text import mapping_text
from caesura_protocol.formats.raw_recording import Array, RawRecording
from caesura_protocol.keys import NAME_PATTERN
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, WRENCH_SOURCES, Quantity
from caesura_protocol.plausibility import UNITS
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import (
    ARRAYS,
    OPTIONS,
    STATED,
    Recording,
    RecordingError,
    UnknownColumnsError,
    contradiction,
    declared_units,
    did_you_mean,
    is_option,
    unit_remedy,
    wrong_option,
)

# What a file that is no recording makes numpy, zipfile and csv raise.
_UNREADABLE = (ValueError, TypeError, OSError, EOFError, RuntimeError, BadZipFile, zlib.error, csv.Error)


def load_recording(
    path: Path,
    *,
    wrench_source: str | None = None,
    hand_on_robot: str | None = None,
    length_unit: str | None = None,
    time_unit: str | None = None,
    angle_unit: str | None = None,
    force_unit: str | None = None,
    mapping: Path | None = None,
    check_units: bool = True,
) -> Recording:
    """Read a recording: npz, csv, our MCAP, or a rosbag2; the arguments override what the file declares.

    Csv files carry one column a component, named as in `columns` (t, px, py, pz, fx, …), and may state
    options in leading comment lines such as `# length_unit: mm`. mapping: a file that says what is what in
    a csv or a rosbag2 of other software (`formats.mapping`).
    time_unit, angle_unit, force_unit: of `t`, `q` and `force` in the file; they become s, rad and N.
    A unit among the arguments is declared: it is believed. check_units: refuse samples which are probably in
    another unit (`caesura_protocol.plausibility`).
    Raises RecordingError for anything that is not a recording, SourceError where an extra is missing.
    """
    stated = declared_units(length=length_unit, time=time_unit, angle=angle_unit, force=force_unit)
    overrides = {
        "wrench_source": wrench_source,
        "hand_on_robot": hand_on_robot,
        "length_unit": length_unit,
    }
    for key, value in overrides.items():
        if value is not None and not is_option(key, value):
            raise RecordingError(wrong_option(key, value, OPTIONS[key]))
    arrays, options, ignored = _read(path, mapping, wrench_source)
    if "t" not in arrays or not {"pos", "q"} & set(arrays):
        names = ", ".join([*arrays, *ignored]) or "no arrays"
        raise RecordingError(f"{path}: has {names}; expected t, and pos (n, 3) or q with a column a joint")
    if "force_base" in arrays:
        arrays["force"], options["force_frame"] = arrays["force_base"], "base"
        if arrays.pop("torque", None) is not None:  # it has the frame of `force`
            ignored = [*ignored, "torque"]
    _check_overrides(path, options, overrides)
    options |= {key: value for key, value in overrides.items() if value is not None}
    ignored = [*ignored, *_without_wrench(arrays, options)]
    for quantity, name in _CONVERTED.items():
        if quantity in stated and name in arrays:
            arrays[name] = arrays[name] * UNITS[quantity][stated[quantity]]
    signals = {s: _as_matrix(arrays[s]) for s in COLUMNS_OF_SIGNAL if s in arrays}
    asked = {key: _asked(path, key, options.pop(key)) for key in CellSettings._fields if key in options}
    recording = Recording(
        arrays["t"],
        signals,
        name=path.name,
        ignored=tuple(ignored),
        declared_units=tuple(stated),
        setting=CellSettings(**asked),
        **options,  # type: ignore[arg-type]
    )
    if check_units and (found := recording.implausible) is not None:
        raise RecordingError(f"{path.name}: {found}. {unit_remedy(found, recording.length_unit)}")
    return recording


def _without_wrench(arrays: Mapping[str, Array], options: dict[str, str]) -> list[str]:
    """State the source `none` where there is no wrench; the source that was stated, with the reason."""
    source = options.get("wrench_source", "none")
    if "force" in arrays or "tau" in arrays or source not in WRENCH_SOURCES:
        return []
    options["wrench_source"] = "none"
    return [] if source == "none" else [f"wrench_source {source}, because there is no force and no tau"]


def _check_overrides(path: Path, options: Mapping[str, str], overrides: Mapping[str, str | None]) -> None:
    """Raise RecordingError where an option of the command line contradicts another one, or the file."""
    stated = {key: value for key, value in overrides.items() if value is not None and key != "length_unit"}
    merged = {**options, **stated}
    wrong = contradiction(merged.get("wrench_source"), merged.get("hand_on_robot", "unknown"))
    if wrong is not None and stated:
        given = " and ".join(f"--{key.replace('_', '-')} {value}" for key, value in stated.items())
        other = f" does not fit {path.name}" if len(stated) == 1 else " do not fit each other"
        raise RecordingError(f"{given}{other}: {wrong}")


def _asked(path: Path, key: str, value: str) -> Any:
    """What a file states of its cell. Raises RecordingError where it is no name, or no number above 0."""
    if key == "robot":
        if not re.fullmatch(NAME_PATTERN, value):
            raise RecordingError(f"{path}: robot is {value!r}, expected a name as of `caesura robots`")
        return value
    try:
        number = float(value)
    except ValueError:
        number = 0.0
    if not 0.0 < number < np.inf:
        raise RecordingError(f"{path}: {key} is {value!r}, expected a number above 0")
    return number


_CONVERTED: Mapping[Quantity, str] = {"time": "t", "angle": "q", "force": "force"}


def _read(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    if not path.exists() and path.suffix.lower() in _READERS:
        raise RecordingError(f"{path}: no such file")
    reader = _READERS.get(path.suffix.lower())
    if path.is_dir():
        reader = _read_rosbag if (path / "metadata.yaml").exists() else None
    if reader is None:
        found = "a directory without metadata.yaml" if path.is_dir() else f"suffix {path.suffix!r}"
        known = ", ".join(_READERS)
        raise RecordingError(f"{path}: {found}, expected one of {known}, or the directory of a rosbag2")
    try:
        return reader(path, mapping, wrench_source)
    except RecordingError:
        raise
    except _UNREADABLE as error:
        why = " ".join(str(error).split())
        kind = f"{path.suffix[1:]} file" if path.is_file() else "rosbag2"
        raise RecordingError(f"{path}: not a readable {kind} ({why})") from error


def _as_matrix(values: Array) -> Array:
    return values[:, None] if values.ndim == 1 else values


def _read_npz(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    _no_mapping(path, mapping)
    if not is_zipfile(path):
        raise ValueError("no archive of arrays, as numpy.savez writes it, or cut short")
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: np.asarray(file[key], dtype=np.float64) for key in ARRAYS if key in file.files}
        options = {key: str(file[key]) for key in STATED if key in file.files}
        ignored = [key for key in file.files if key not in {*ARRAYS, *STATED}]
    return RawRecording(arrays, options, ignored)


def _read_csv(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    if mapping is not None:
        return read_foreign_csv(path, load_mapping(mapping))
    lines = [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines()]
    comments = [line[1:].partition(":") for line in lines if line.startswith("#")]
    stated = {key.strip(): value.strip() for key, separator, value in comments if separator}
    numbers = [number for number, line in enumerate(lines, start=1) if line and not line.startswith("#")]
    rows = list(csv.reader(lines[number - 1] for number in numbers))
    if len(rows) < 2:
        raise ValueError(f"{len(rows)} rows, expected a header and at least one sample")
    header = [name.strip() for name in rows[0]]
    if not has_own_columns(header):
        raise _foreign(path)
    column = _columns(header, rows[1:], numbers[1:])
    arrays = {
        signal: np.column_stack([column[name] for name in names])
        for signal, names in _whole_signals(path, column).items()
    }
    if "t" in column:
        arrays["t"] = column["t"]
    known = {"t", *(name for names in COLUMNS_OF_SIGNAL.values() for name in names)}
    options = {key: value for key, value in stated.items() if key in STATED}
    # Other comments are for people, unless they look like an option.
    mistyped = [key for key in stated if key not in STATED and did_you_mean(key) in STATED]
    return RawRecording(arrays, options, [*mistyped, *(name for name in column if name not in known)])


MOST_NAMED = 20  # columns of a file, in an error


def _foreign(path: Path) -> UnknownColumnsError:
    """The error for a csv with other columns: those that it has, and a mapping of them as an example."""
    layout = read_layout(path)
    header, guess = layout.header, guessed(layout)
    more = f" and {len(header) - MOST_NAMED} more" if len(header) > MOST_NAMED else ""
    asked = dict.fromkeys(("t", *({} if PLACES & set(guess.columns) else ("px", "py", "pz"))), "…")
    return UnknownColumnsError(
        f"{path}: has the columns {', '.join(header[:MOST_NAMED])}{more}; expected t, and px py pz or "
        "q1 to q7. --mapping FILE names the columns of other software (docs/recordings.md)",
        mapping_text(guess._replace(columns={**asked, **guess.columns})),
    )


def _columns(header: list[str], rows: list[list[str]], lines: list[int]) -> dict[str, Array]:
    """The table by column; lines: of the rows. Raises ValueError where it is no rectangle of numbers."""
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise ValueError(f"column {twice[0]} comes twice")
    for line, row in zip(lines, rows, strict=False):
        if len(row) != len(header):
            raise ValueError(f"line {line} has {len(row)} values, expected {len(header)} as in the header")
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
        expected = "a number of seconds" if name == "t" else "a number; leave out the rows that have none"
        raise ValueError(f"line {line}: {name} is {cell!r}, expected {expected}") from error


def _whole_signals(path: Path, column: Mapping[str, Array]) -> dict[str, tuple[str, ...]]:
    """The columns of each signal. Raises RecordingError where a part of one is missing."""
    for signal, names in COLUMNS_OF_SIGNAL.items():
        if missing := missing_columns(signal, column):
            found = [name for name in names if name in column]
            raise RecordingError(f"{path}: has {', '.join(found)} but not {', '.join(missing)}")
    return signal_columns(column)


def _read_mcap(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    """Read Caesura's MCAP, or a rosbag2 that is one file."""
    with import_extra("mcap", path):
        from caesura_protocol.formats.mcap_read import ROS2, profile_of, read_mcap  # noqa: PLC0415 - an extra
    if profile_of(path) == ROS2:
        return _read_rosbag(path, mapping, wrench_source)
    _no_mapping(path, mapping)
    return read_mcap(path)


def _read_rosbag(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    with import_extra("ros2", path):
        from caesura_protocol.formats.rosbag import read_rosbag  # noqa: PLC0415 - an extra
    return read_rosbag(path, None if mapping is None else load_mapping(mapping), wrench_source)


def _no_mapping(path: Path, mapping: Path | None) -> None:
    if mapping is not None:
        raise RecordingError(
            f"--mapping {mapping} is for csv files and rosbag2; {path.name} has the names and units itself"
        )


_Reader = Callable[[Path, Path | None, str | None], RawRecording]
_READERS: Mapping[str, _Reader] = {
    ".npz": _read_npz,
    ".csv": _read_csv,
    ".mcap": _read_mcap,
    ".db3": _read_rosbag,
}

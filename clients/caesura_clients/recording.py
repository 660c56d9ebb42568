"""A recording: everything one robot reported during one demonstration.

The same names are used in npz, csv and MCAP files, on the wire and in a live source, so that a recording and
a live robot have one form for a reader. A signal is a matrix with one row a sample:

    pos (n, 3)   flange position in the base frame, in `length_unit`
    quat (n, 4)  flange orientation in the base frame, x y z w
    q (n, 7)     joint positions [rad]
    force (n, 3) force of the environment on the robot [N], in `force_frame`
    torque (n, 3) its moment [Nm]
    tau (n, 7)   external joint torques [Nm]
    gripper (n, 1) opening between the fingers [m]

At least one of `pos` and `q` must be there; where both are, `pos` is segmented. What else a file holds is
not read, but named in `Recording.ignored`: an option with a typo in it must not pass in silence.

A recording states where its wrench is measured (`wrench_source`) and whether a person guides this robot by
hand (`hand_on_robot`). A source that is not stated is None: the service then assumes that the guiding hand is
in the force, and the results say so.
"""

from __future__ import annotations

import csv
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from zipfile import BadZipFile, is_zipfile

import numpy as np

from caesura_clients.errors import BadSource, CaesuraError
from caesura_clients.formats.content import Array, RawRecording
from caesura_clients.programs.safety import UNSET, CellSettings
from caesura_protocol.distribution import installing
from caesura_protocol.messages import (
    COLUMNS_OF_SIGNAL,
    FORCE_FRAMES,
    HANDS_ON_ROBOT,
    LENGTH_UNITS,
    WRENCH_SOURCES,
    ForceFrame,
    HandOnRobot,
    LengthUnit,
    Quantity,
    WrenchSource,
)
from caesura_protocol.plausibility import UNITS, WIRE_UNIT, Implausible, implausible


class RecordingError(CaesuraError, ValueError):
    """The file is not a recording; the message names the file, the value and what was expected."""


@dataclass(frozen=True)
class Recording:
    """One demonstration.

    t: (n,) [s], in the order of arrival; signals: name → (n, width), names as in the module's table.
    wrench_source: None where it is not stated; hand_on_robot: does a person guide this robot by hand?
    ignored: what else the file holds. declared_units: quantities whose unit a person declared, so that values
    which no robot reports are believed. setting: what its cell asks of the program.
    Raises RecordingError where a shape, a name, a unit or a time is off.
    """

    t: Array
    signals: Mapping[str, Array]
    wrench_source: WrenchSource | None = None
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    name: str = field(default="recording", compare=False)
    ignored: tuple[str, ...] = field(default=(), compare=False)
    hand_on_robot: HandOnRobot = "unknown"
    declared_units: tuple[Quantity, ...] = field(default=(), compare=False)
    setting: CellSettings = UNSET

    def __post_init__(self) -> None:
        object.__setattr__(self, "signals", MappingProxyType(dict(self.signals)))
        if self.t.ndim != 1 or self.t.size == 0:
            raise RecordingError(f"{self.name}: t has shape {self.t.shape}, expected (n,) with n >= 1")
        if not np.isfinite(self.t).all():
            first = int(np.flatnonzero(~np.isfinite(self.t))[0])
            raise RecordingError(
                f"{self.name}: sample {first}: t is {self.t[first]}, expected a finite number"
            )
        if not {"pos", "q"} & set(self.signals):
            raise RecordingError(
                f"{self.name}: has {sorted(self.signals)}, expected at least one of pos and q"
            )
        for signal, values in self.signals.items():
            if signal not in COLUMNS_OF_SIGNAL:
                raise RecordingError(
                    f"{self.name}: unknown signal {signal!r}, known: {list(COLUMNS_OF_SIGNAL)}"
                )
            expected = (self.t.size, len(COLUMNS_OF_SIGNAL[signal]))
            if values.shape != expected:
                raise RecordingError(f"{self.name}: {signal} has shape {values.shape}, expected {expected}")
            if not np.isfinite(values).all():
                row, column = np.argwhere(~np.isfinite(values))[0]
                name = COLUMNS_OF_SIGNAL[signal][column]
                raise RecordingError(
                    f"{self.name}: sample {row}: {name} is {values[row, column]}, expected a finite number"
                )
        self._check_options()

    def _check_options(self) -> None:
        for key, known in OPTIONS.items():
            if not is_option(key, getattr(self, key)):
                raise RecordingError(
                    f"{self.name}: {key} is {getattr(self, key)!r}, expected one of {list(known)}"
                )
        if (wrong := contradiction(self.wrench_source, self.hand_on_robot)) is not None:
            raise RecordingError(f"{self.name}: {wrong}")

    @property
    def has_wrench(self) -> bool:
        """Whether forces or joint torques are there."""
        return "force" in self.signals or "tau" in self.signals

    @property
    def implausible(self) -> Implausible | None:
        """The first quantity that is probably in another unit than the recording states, or None."""
        return implausible(self.t, self.signals, length_unit=self.length_unit, declared=self.declared_units)

    @property
    def stated_options(self) -> dict[str, str]:
        """Options by name, without those that the recording does not state."""
        values = {key: getattr(self, key) for key in OPTIONS}
        asked = {key: repr(value) for key, value in self.setting._asdict().items() if value is not None}
        return {key: value for key, value in values.items() if value not in NOT_STATED} | asked

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of `matrix`, as they stand on the wire."""
        return ("t", *(c for s in self.signals for c in COLUMNS_OF_SIGNAL[s]))

    def matrix(self) -> Array:
        """All samples as one (n, columns) matrix, time first."""
        return np.column_stack([self.t, *self.signals.values()])

    def save(self, path: Path) -> None:
        """Write the recording as npz."""
        arrays = {s: v[:, 0] if v.shape[1] == 1 else v for s, v in self.signals.items()}
        options = {key: np.array(value) for key, value in self.stated_options.items()}
        np.savez_compressed(path, t=self.t, **arrays, **options)  # type: ignore[arg-type]


OPTIONS: Mapping[str, tuple[str, ...]] = {
    "wrench_source": WRENCH_SOURCES,
    "hand_on_robot": HANDS_ON_ROBOT,
    "force_frame": FORCE_FRAMES,
    "length_unit": LENGTH_UNITS,
}
STATED = (*OPTIONS, *CellSettings._fields)  # all that a file may state
NOT_STATED = (None, "unknown")  # values of an option that no file needs to hold


def is_option(key: str, value: str | None) -> bool:
    """Whether an option of this name may have this value; a wrench_source of None is not stated."""
    return value in OPTIONS[key] or (key, value) == ("wrench_source", None)


def contradiction(wrench_source: str | None, hand_on_robot: str) -> str | None:
    """Error text where the wrench source and the statement of the hand contradict each other, else None."""
    if (wrench_source, hand_on_robot) != ("flange_sensor_with_hand", "no"):
        return None
    return (
        "hand_on_robot is 'no', which contradicts wrench_source 'flange_sensor_with_hand': expected "
        "hand_on_robot 'yes' or 'unknown', or wrench_source 'flange_sensor' or 'joint_torque_estimate'"
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
    Raises RecordingError for anything that is not a recording, BadSource where an extra is missing.
    """
    stated = declared_units(length=length_unit, time=time_unit, angle=angle_unit, force=force_unit)
    arrays, options, ignored = _read(path, mapping, wrench_source)
    if "t" not in arrays:
        raise RecordingError(f"{path}: has {sorted(arrays)}, expected t")
    if "force_base" in arrays:
        arrays["force"], options["force_frame"] = arrays["force_base"], "base"
        if arrays.pop("torque", None) is not None:  # it has the frame of `force`
            ignored = [*ignored, "torque"]
    overrides = {
        "wrench_source": wrench_source,
        "hand_on_robot": hand_on_robot,
        "length_unit": length_unit,
    }
    options |= {key: value for key, value in overrides.items() if value is not None}
    if (
        "force" not in arrays
        and "tau" not in arrays
        and options.get("wrench_source", "none") in WRENCH_SOURCES
    ):
        options["wrench_source"] = "none"
    for quantity, name in _CONVERTED.items():
        if quantity in stated and name in arrays:
            arrays[name] = arrays[name] * UNITS[quantity][stated[quantity]]
    signals = {s: _as_matrix(arrays[s]) for s in COLUMNS_OF_SIGNAL if s in arrays}
    asked = {key: _positive(path, key, options.pop(key)) for key in CellSettings._fields if key in options}
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


def _positive(path: Path, key: str, value: str) -> float:
    """A number that a file states. Raises RecordingError where it is none above 0."""
    try:
        number = float(value)
    except ValueError:
        number = 0.0
    if not 0.0 < number < np.inf:
        raise RecordingError(f"{path}: {key} is {value!r}, expected a number above 0")
    return number


_CONVERTED: Mapping[Quantity, str] = {"time": "t", "angle": "q", "force": "force"}


def declared_units(**units: str | None) -> dict[Quantity, str]:
    """Units that were declared, by quantity. Raises RecordingError for one that does not exist."""
    declared: dict[Quantity, str] = {}
    for quantity, known in UNITS.items():
        if (unit := units.get(quantity)) is None:
            continue
        if unit not in known:
            raise RecordingError(f"{quantity}_unit is {unit!r}, expected one of {list(known)}")
        declared[quantity] = unit
    return declared


def unit_remedy(found: Implausible, length_unit: str) -> str:
    """What a user states to have the samples taken, as they are or in the likely unit."""
    option = f"--{found.quantity}-unit"
    stated = length_unit if found.quantity == "length" else WIRE_UNIT[found.quantity]
    believed = f"{option} {stated} if the values are right"
    return f"State {believed}" if found.likely is None else f"State {option} {found.likely}, or {believed}"


def did_you_mean(name: str) -> str | None:
    """The name that an ignored one looks like, if any.

    >>> did_you_mean("length_units"), did_you_mean("vel")
    ('length_unit', None)
    """
    columns = (column for names in COLUMNS_OF_SIGNAL.values() for column in names if len(column) > 2)
    close = get_close_matches(name.lower(), [*_ARRAYS, *STATED, *columns], n=1, cutoff=0.8)
    return close[0] if close else None


_ARRAYS = ("t", *COLUMNS_OF_SIGNAL, "force_base")


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
        arrays = {key: np.asarray(file[key], dtype=np.float64) for key in _ARRAYS if key in file.files}
        options = {key: str(file[key]) for key in STATED if key in file.files}
        ignored = [key for key in file.files if key not in {*_ARRAYS, *STATED}]
    return RawRecording(arrays, options, ignored)


def _read_csv(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    if mapping is not None:
        from caesura_clients.formats.foreign_csv import read_foreign_csv  # noqa: PLC0415 - it imports us
        from caesura_clients.formats.mapping import load_mapping  # noqa: PLC0415

        return read_foreign_csv(path, load_mapping(mapping))
    lines = [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines()]
    comments = [line[1:].partition(":") for line in lines if line.startswith("#")]
    stated = {key.strip(): value.strip() for key, separator, value in comments if separator}
    rows = list(csv.reader(line for line in lines if line and not line.startswith("#")))
    if len(rows) < 2:
        raise ValueError(f"{len(rows)} rows, expected a header and at least one sample")
    column = _columns([name.strip() for name in rows[0]], rows[1:])
    arrays = {
        signal: np.column_stack([column[name] for name in names])
        for signal, names in COLUMNS_OF_SIGNAL.items()
        if _is_whole(names, column)
    }
    if "t" in column:
        arrays["t"] = column["t"]
    known = {"t", *(name for names in COLUMNS_OF_SIGNAL.values() for name in names)}
    options = {key: value for key, value in stated.items() if key in STATED}
    # Other comments are for people, unless they look like an option.
    mistyped = [key for key in stated if key not in STATED and did_you_mean(key) in STATED]
    return RawRecording(arrays, options, [*mistyped, *(name for name in column if name not in known)])


def _columns(header: list[str], rows: list[list[str]]) -> dict[str, Array]:
    """The table by column. Raises ValueError where it is not rectangular or not of numbers."""
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise ValueError(f"column {twice[0]} comes twice")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise ValueError(
                f"sample {number} has {len(row)} values, expected {len(header)} as in the header"
            )
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


def _is_whole(names: Iterable[str], column: Mapping[str, Array]) -> bool:
    """Is the whole signal there? Raises ValueError where a part of it is."""
    missing = [name for name in names if name not in column]
    found = [name for name in names if name in column]
    if found and missing:
        raise ValueError(f"has {', '.join(found)} but not {', '.join(missing)}")
    return not missing


def _read_mcap(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    """Read Caesura's MCAP, or a rosbag2 that is one file."""
    with needing("mcap", path):
        from caesura_clients.formats.mcap_read import ROS2, profile_of, read_mcap  # noqa: PLC0415 - an extra
    if profile_of(path) == ROS2:
        return _read_rosbag(path, mapping, wrench_source)
    _no_mapping(path, mapping)
    return read_mcap(path)


def _read_rosbag(path: Path, mapping: Path | None, wrench_source: str | None) -> RawRecording:
    from caesura_clients.formats.mapping import load_mapping  # noqa: PLC0415 - it imports us

    with needing("ros2", path):
        from caesura_clients.formats.rosbag import read_rosbag  # noqa: PLC0415 - an extra
    return read_rosbag(path, None if mapping is None else load_mapping(mapping), wrench_source)


def _no_mapping(path: Path, mapping: Path | None) -> None:
    if mapping is not None:
        raise RecordingError(f"{path}: says itself what is what; {mapping} is for csv files and rosbag2")


@contextmanager
def needing(extra: str, what: object) -> Iterator[None]:
    """Import what an extra brings. Raises BadSource, which names the extra, where it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in {"caesura_clients", "caesura_protocol"}:
            raise
        raise BadSource(f"{what} needs {error.name}: {installing(extra)}") from error


_Reader = Callable[[Path, Path | None, str | None], RawRecording]
_READERS: Mapping[str, _Reader] = {
    ".npz": _read_npz,
    ".csv": _read_csv,
    ".mcap": _read_mcap,
    ".db3": _read_rosbag,
}

"""A recording: everything one robot reported during one demonstration.

The same names are used in npz files, csv files, on the wire and in a live source, so that a recording
and a live robot are the same thing to whoever reads them. A signal is a matrix with one row a sample:

    pos (n, 3)   flange position in the base frame, in `length_unit`
    quat (n, 4)  flange orientation in the base frame, x y z w
    q (n, 7)     joint positions [rad]
    force (n, 3) force of the environment on the robot [N], in `force_frame`
    torque (n, 3) its moment [Nm]
    tau (n, 7)   external joint torques [Nm]
    gripper (n, 1) opening between the fingers [m]

At least one of `pos` and `q` must be there; where both are, `pos` is segmented.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import (
    COLUMNS_OF_SIGNAL,
    FORCE_FRAMES,
    LENGTH_UNITS,
    WRENCH_SOURCES,
    ForceFrame,
    LengthUnit,
    WrenchSource,
)

Array = NDArray[np.float64]


class RecordingError(ValueError):
    """The file is not a recording; the message names the file, the value and what was expected."""


@dataclass(frozen=True)
class Recording:
    """One demonstration.

    t: (n,) [s], in the order of arrival; signals: name → (n, width), names as in the module's table.
    Raises RecordingError where a shape, a name or a unit is off.
    """

    t: Array
    signals: Mapping[str, Array]
    wrench_source: WrenchSource = "flange_sensor"
    force_frame: ForceFrame = "base"
    length_unit: LengthUnit = "m"
    name: str = field(default="recording", compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "signals", MappingProxyType(dict(self.signals)))
        if self.t.ndim != 1 or self.t.size == 0:
            raise RecordingError(f"{self.name}: t has shape {self.t.shape}, expected (n,) with n >= 1")
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
        for key, known in _OPTIONS.items():
            if getattr(self, key) not in known:
                raise RecordingError(
                    f"{self.name}: {key} is {getattr(self, key)!r}, expected one of {list(known)}"
                )

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
        options = {key: np.array(getattr(self, key)) for key in _OPTIONS}
        np.savez_compressed(path, t=self.t, **arrays, **options)  # type: ignore[arg-type]


_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "wrench_source": WRENCH_SOURCES,
    "force_frame": FORCE_FRAMES,
    "length_unit": LENGTH_UNITS,
}


def load_recording(
    path: Path, *, wrench_source: str | None = None, length_unit: str | None = None
) -> Recording:
    """Read a recording from an npz or csv file; the arguments override what the file declares.

    Csv files carry one column a component, named as in `columns` (t, px, py, pz, fx, …), and may state
    options in leading comment lines such as `# length_unit: mm`.
    Raises RecordingError for anything that is not a recording.
    """
    readers = {".npz": _read_npz, ".csv": _read_csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(f"{path}: suffix {path.suffix!r}, expected one of {list(readers)}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        arrays, options = reader(path)
        arrays = {name: np.asarray(values, dtype=np.float64) for name, values in arrays.items()}
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        raise RecordingError(f"{path}: not a readable {path.suffix[1:]} file ({error})") from error
    if "t" not in arrays:
        raise RecordingError(f"{path}: has {sorted(arrays)}, expected t")
    if "force_base" in arrays:
        arrays["force"], options["force_frame"] = arrays["force_base"], "base"
    overrides = {"wrench_source": wrench_source, "length_unit": length_unit}
    options |= {key: value for key, value in overrides.items() if value is not None}
    if "force" not in arrays and "tau" not in arrays:
        options["wrench_source"] = "none"
    signals = {s: _as_matrix(arrays[s]) for s in COLUMNS_OF_SIGNAL if s in arrays}
    return Recording(arrays["t"], signals, name=path.name, **options)  # type: ignore[arg-type]


def _as_matrix(values: Array) -> Array:
    return values[:, None] if values.ndim == 1 else values


def _read_npz(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: file[key] for key in file.files}
    options = {key: str(arrays.pop(key)) for key in _OPTIONS if key in arrays}
    return arrays, options


def _read_csv(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line[1:].partition(":") for line in lines if line.startswith("#")]
    options = {key.strip(): value.strip() for key, _, value in comments if key.strip() in _OPTIONS}
    rows = list(csv.reader(line for line in lines if line and not line.startswith("#")))
    if len(rows) < 2:
        raise ValueError(f"{len(rows)} rows, expected a header and at least one sample")
    header = [name.strip() for name in rows[0]]
    table = np.array(rows[1:], dtype=np.float64)
    if table.shape[1] != len(header):
        raise ValueError(f"{table.shape[1]} values a row, expected {len(header)} as in the header")
    column = dict(zip(header, table.T, strict=True))
    arrays = {
        signal: np.column_stack([column[name] for name in names])
        for signal, names in COLUMNS_OF_SIGNAL.items()
        if set(names) <= set(column)
    }
    if "t" in column:
        arrays["t"] = column["t"]
    return arrays, options

"""Reads Caesura's npz: one array per signal, one text per option. Objects are never unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.description_texts import DESCRIBED
from caesura_protocol.formats.calendar_time import seconds_of_array
from caesura_protocol.formats.unvalidated_recording import Array, UnvalidatedRecording
from caesura_protocol.recording import (
    ARRAYS,
    ASSUMED_ORDER,
    OF_FILE,
    QUATERNION_ORDER,
    QUATERNION_ORDERS,
    RecordingError,
)
from caesura_protocol.up_direction import UP, up_text

NPZ_STATED = (*OF_FILE, QUATERNION_ORDER)


def read_npz(path: Path) -> UnvalidatedRecording:
    """Return arrays and options of a file.

    Raises RecordingError, or ValueError if it is no archive of arrays.
    """
    if not is_zipfile(path):
        raise ValueError("no archive of arrays, as numpy.savez writes it, or cut short")
    with np.load(path, allow_pickle=False) as file:
        found = {key: _loaded(file, key) for key in (*ARRAYS, *NPZ_STATED) if key in file.files}
        ignored = [key for key in file.files if key not in {*ARRAYS, *NPZ_STATED}]
    several = [key for key in DESCRIBED if key in found and found[key].size != 1]  # of other software
    ignored += several
    assumed: list[str] = []
    t = found.get("t", np.empty(0))
    times = None
    if has_calendar_time := t.dtype.kind in "mM" and t.ndim == 1 and t.size > 0:
        times = seconds_of_array(t)
        found["t"] = times.t
        assumed.append(times.in_words)
    arrays = {key: _as_numbers(path, key, found[key]) for key in ARRAYS if key in found}
    options = {key: _as_text(path, key, found[key]) for key in NPZ_STATED if key in {*found} - {*several}}
    options |= {} if times is None else times.options
    order = options.pop(QUATERNION_ORDER, None)
    if "quat" in arrays:
        assumed += _in_order(path, arrays, order)
    return UnvalidatedRecording(arrays, options, ignored, tuple(assumed), has_calendar_time=has_calendar_time)


def _in_order(path: Path, arrays: dict[str, Array], order: str | None) -> list[str]:
    """Convert quaternions to the order x y z w; return text on the assumed order if none is stated."""
    if order is None:
        return [ASSUMED_ORDER]
    if order not in QUATERNION_ORDERS:
        expected = ", ".join(QUATERNION_ORDERS)
        raise RecordingError(f"{path}: {QUATERNION_ORDER} is {order!r}, expected one of {expected}")
    if arrays["quat"].shape[1:] == (4,):
        arrays["quat"] = arrays["quat"][:, [order.index(axis) for axis in "xyzw"]]
    return []


def _loaded(file: Any, key: str) -> NDArray[Any]:
    """Return an array of an npz file. Objects are never unpickled."""
    try:
        return np.asarray(file[key])
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        raise RecordingError(
            f"{file.zip.filename}: {key} is an array of Python objects, which are never loaded: save it as "
            "numbers, for example by numpy.asarray(…, dtype=float), or as a text"
        ) from error


def _as_numbers(path: Path, key: str, values: NDArray[Any]) -> Array:
    if values.dtype.kind not in "biuf":
        remedy = f"save its real part, {key}.real" if values.dtype.kind == "c" else f"save {key} as float64"
        raise RecordingError(f"{path}: {key} holds {values.dtype}, expected real numbers: {remedy}")
    return np.asarray(values, dtype=np.float64)


def _as_text(path: Path, key: str, values: NDArray[Any]) -> str:
    if key == "up" and values.ndim == 1 and values.dtype.kind in "iuf" and values.size == len(UP):
        return up_text(values.tolist())
    if values.size != 1:
        raise RecordingError(f"{path}: {key} has {values.size} values, expected one")
    value = values.reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

"""Read a recording from a file: npz, csv, MCAP or a rosbag2."""

from __future__ import annotations

import csv
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from caesura_protocol.description_texts import DESCRIBED, parse_description
from caesura_protocol.errors import CaesuraError
from caesura_protocol.formats.csv_read import read_csv
from caesura_protocol.formats.csv_read_mapped import read_mapped_csv
from caesura_protocol.formats.mapping_file_read import load_mapping
from caesura_protocol.formats.npz_read import read_npz
from caesura_protocol.formats.sample_checks import (
    check_clock,
    check_time_steps,
    check_values,
    is_flag,
    leaping_places,
    left_out,
    stray_places,
)
from caesura_protocol.formats.unvalidated_recording import Array, UnvalidatedRecording, UserStatements
from caesura_protocol.keys import NAME_PATTERN
from caesura_protocol.lost_samples import Loss, parse_losses
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, FORCE_FRAMES, WRENCH_SOURCES, Quantity
from caesura_protocol.package_version_and_extras import import_extra
from caesura_protocol.plausibility import UNITS, WIRE_UNIT
from caesura_protocol.pose_update_rate import slow_pose
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import (
    ASSUMED_FLAG,
    ASSUMED_FRAME,
    BEGAN,
    CHANGES,
    LOST,
    OPTIONS,
    Recording,
    RecordingError,
    contradiction,
    declared_units,
    is_option,
    unit_remedy,
    wrong_option,
)
from caesura_protocol.robots import robot_description
from caesura_protocol.session_time_display import is_of_day
from caesura_protocol.up_direction import parse_up, up_text
from caesura_protocol.wrench_faults import read_wrench

MOST_NAMED = 20  # files of a directory, in an error
BAG_METADATA = "metadata.yaml"  # of a rosbag2, in its directory
# What a file that is no recording makes numpy, zipfile and csv raise.
_UNREADABLE = (ValueError, TypeError, OSError, EOFError, RuntimeError, BadZipFile, zlib.error, csv.Error)


def load_recording(
    path: str | Path,
    *,
    wrench_source: str | None = None,
    hand_on_robot: str | None = None,
    force_frame: str | None = None,
    length_unit: str | None = None,
    time_unit: str | None = None,
    angle_unit: str | None = None,
    force_unit: str | None = None,
    up: str | None = None,
    robot: str | None = None,
    mapping: Path | None = None,
    check_units: bool = True,
    as_stated: bool = False,
) -> Recording:
    """Read a recording: npz, csv, Caesura's MCAP, or a rosbag2; the arguments override the file's statements.

    force_frame: of a file that states none; one that contradicts the file is refused. up: the direction away
    from gravity in the base frame, as `x,y,z` or an axis such as `-z`. robot: the arm, by its name or the
    path of its description.

    Csv files have one column per component, named as in `columns` (t, px, py, pz, fx, …), and may state
    options in leading comment lines such as `# length_unit: mm`. mapping: a file that maps the names of a csv
    or a rosbag2 of other software (`formats.mapping_file_read`). time_unit, angle_unit, force_unit: of `t`,
    `q` and `force` in the file; they become s, rad and N. A unit among the arguments is declared, and not
    questioned. check_units: refuse samples that are probably in another unit
    (`caesura_protocol.plausibility`), and times that go back. as_stated: keep a wrench that cannot be used
    (`caesura_protocol.wrench_faults`), for a copy of the file; otherwise its source is `none` or its torque
    is left out, and `Recording.cautions` has the reason. Raises RecordingError for anything that is not a
    recording, SourceError for a missing extra, RobotError for an unknown robot.
    """
    path = Path(path)
    stated = declared_units(length=length_unit, time=time_unit, angle=angle_unit, force=force_unit)
    overrides = {
        "wrench_source": wrench_source,
        "hand_on_robot": hand_on_robot,
        "force_frame": force_frame,
        "length_unit": length_unit,
    }
    for key, value in overrides.items():
        if value is not None and not is_option(key, value):
            raise RecordingError(wrong_option(key, value, OPTIONS[key]))
    of_cell = _stated_up(up) | ({} if robot is None else {"robot": robot_description(robot).name})
    raw = _read(path, mapping, UserStatements(wrench_source, force_frame, robot))
    arrays, options, ignored = raw.arrays, raw.options, raw.ignored
    if "t" not in arrays or not {"pos", "q"} & set(arrays):
        names = ", ".join([*arrays, *ignored]) or "no arrays"
        raise RecordingError(
            f"{path}: has {names}; expected the times t, and pos (the flange's x, y and z at each time) "
            "or q (the joint angles, a column for each joint)"
        )
    if "force_base" in arrays:
        arrays["force"], options["force_frame"] = arrays["force_base"], "base"
        if arrays.pop("torque", None) is not None:  # it has the frame of `force`
            ignored = [*ignored, "torque, because it has the frame of force, and force_base is read"]
    _check_frame(path, arrays, options.get("force_frame"), force_frame)
    _check_overrides(path, options, overrides)
    in_file, asked_for = dict(options), {key: v for key, v in (overrides | of_cell).items() if v is not None}
    options |= asked_for
    ignored = [*ignored, *_without_wrench(arrays, options), *_without_force(arrays, force_frame)]
    where = "the file" if mapping is None else "the file or its mapping"
    overridden = tuple(_overridden(in_file, {key: options[key] for key in asked_for}, where))
    _convert(path, raw, stated)
    lost, changes, began_s = _losses(path, options, stated), _changes(path, options), _began_s(path, options)
    description, undescribed = parse_description(options)
    options = {key: value for key, value in options.items() if key not in DESCRIBED}
    signals = {s: _as_matrix(arrays[s]) for s in COLUMNS_OF_SIGNAL if s in arrays}
    assumes_frame = "force" in signals and "force_frame" not in options
    asked = {key: _asked(path, key, options.pop(key)) for key in CellSettings._fields if key in options}
    recording = Recording(
        arrays["t"],
        signals,
        name=path.name,
        ignored=(*ignored, *undescribed),
        declared_units=tuple(stated),
        setting=CellSettings(**asked),
        assumed=(*raw.assumed, *_assumed_of(signals, assumes_frame=assumes_frame)),
        lines=raw.lines,
        lost=lost,
        changes=changes,
        began_s=began_s,
        description=description,
        **options,  # type: ignore[arg-type]
    )
    _check_samples(recording, check_units=check_units)
    slow = slow_pose(recording.t, recording.signals)
    of_places = filter(None, (slow, stray_places(recording), leaping_places(recording)))
    cautions = (*overridden, *recording.beyond_samples, *left_out(recording), *of_places)
    recording = replace(recording, cautions=cautions)
    return recording if as_stated else _with_usable_wrench(recording)


def _check_samples(recording: Recording, *, check_units: bool) -> None:
    """Check times, units and values. Raises RecordingError."""
    if check_units:
        check_time_steps(recording)
        if (found := recording.implausible) is not None:
            raise RecordingError(f"{recording.name}: {found}. {unit_remedy(found, recording.length_unit)}")
    check_values(recording)
    if check_units:
        check_clock(recording)


def _assumed_of(signals: Mapping[str, Array], *, assumes_frame: bool) -> Iterator[str]:
    """Yield sentences on assumptions that no file states: the frame, and a gripper's flag."""
    if assumes_frame:
        yield ASSUMED_FRAME
    if "gripper" in signals and is_flag(signals["gripper"][:, 0]):
        yield ASSUMED_FLAG


def _convert(path: Path, raw: UnvalidatedRecording, stated: Mapping[Quantity, str]) -> None:
    """Convert arrays to Caesura's units, in place.

    Raises RecordingError for a unit of times of day, and for one of a signal whose unit the mapping states.
    Caesura's own unit may be stated of such a signal: it confirms the converted values.
    """
    if raw.has_calendar_time and "time" in stated:
        raise RecordingError(
            f"{path}: --time-unit {stated['time']} is for times that are numbers, and this file has times of "
            "day: leave it out"
        )
    for quantity, name in (*_CONVERTED.items(), ("length", "pos")):
        if stated.get(quantity, WIRE_UNIT[quantity]) != WIRE_UNIT[quantity] and name in raw.mapped_units:
            raise RecordingError(
                f"--{quantity}-unit {stated[quantity]} does not fit {path.name}: the mapping states the unit "
                f"of {name}, which is converted. Leave the option out, or mend the mapping"
            )
    for quantity, name in _CONVERTED.items():
        if quantity in stated and name in raw.arrays:
            raw.arrays[name] = raw.arrays[name] * UNITS[quantity][stated[quantity]]


def _changes(path: Path, options: dict[str, str]) -> int:
    """Remove the number of changes from a file's options and return it. Raises RecordingError."""
    count = options.pop(CHANGES, "0")
    if re.fullmatch("[0-9]{1,9}", count) is None:
        raise RecordingError(f"{path}: {CHANGES} is {count!r}, expected the number of changes")
    return int(count)


def _began_s(path: Path, options: dict[str, str]) -> float | None:
    """Remove the time of day at time 0 from a file's options and return it [s]. Raises RecordingError."""
    if BEGAN not in options:
        return None
    text = options.pop(BEGAN)
    try:
        began_s = float(text)
    except ValueError:
        began_s = np.nan
    if not is_of_day(began_s):
        raise RecordingError(f"{path}: {BEGAN} is {text!r}, expected a time of day [s] since 1970 (UTC)")
    return began_s


def _losses(path: Path, options: dict[str, str], stated: Mapping[Quantity, str]) -> tuple[Loss, ...]:
    """Remove the losses from a file's options and return them in s. Raises RecordingError."""
    if LOST not in options:
        return ()
    seconds = UNITS["time"][stated.get("time", "s")]
    try:
        return tuple((seconds * t0, seconds * tn) for t0, tn in parse_losses(options.pop(LOST)))
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from error


def _with_usable_wrench(recording: Recording) -> Recording:
    """Return the recording with the findings on its wrench; an unusable part is left out."""
    reading = read_wrench(
        recording.t,
        recording.signals,
        recording.wrench_source,
        length_unit=recording.length_unit,
        believed="force" in recording.declared_units,
    )
    if not reading.found:
        return recording
    signals = {
        name: values for name, values in recording.signals.items() if name != "torque" or reading.uses_torque
    }
    return replace(
        recording,
        signals=signals,
        wrench_source=reading.source,
        cautions=(*recording.cautions, *reading.found),
    )


def _without_wrench(arrays: Mapping[str, Array], options: dict[str, str]) -> list[str]:
    """State the source `none` if there is no wrench; return text on a stated source, with the reason."""
    source = options.get("wrench_source", "none")
    if "force" in arrays or "tau" in arrays or source not in WRENCH_SOURCES:
        return []
    options["wrench_source"] = "none"
    return [] if source == "none" else [f"wrench_source {source}, because there is no force and no tau"]


def _without_force(arrays: Mapping[str, Array], force_frame: str | None) -> list[str]:
    """Return text on a frame of the command line if there is no force, with the reason; else none."""
    if force_frame is None or "force" in arrays:
        return []
    return [f"--force-frame {force_frame}, because there is no force"]


def _check_frame(path: Path, arrays: Mapping[str, Array], in_file: str | None, stated: str | None) -> None:
    """Raise RecordingError if the command line states another frame of the force than the file."""
    if stated is None or in_file not in FORCE_FRAMES or in_file == stated:
        return
    why = (
        "force_base is read, which is in the base frame" if "force_base" in arrays else f"it states {in_file}"
    )
    raise RecordingError(f"--force-frame {stated} does not fit {path.name}: {why}. Leave the option out")


def _check_overrides(path: Path, options: Mapping[str, str], overrides: Mapping[str, str | None]) -> None:
    """Raise RecordingError if an option of the command line contradicts another one, or the file."""
    stated = {key: value for key, value in overrides.items() if value is not None and key in _OF_HAND}
    merged = {**options, **stated}
    wrong = contradiction(merged.get("wrench_source"), merged.get("hand_on_robot", "unknown"))
    if wrong is not None and stated:
        given = " and ".join(f"--{key.replace('_', '-')} {value}" for key, value in stated.items())
        other = f" does not fit {path.name}" if len(stated) == 1 else " do not fit each other"
        raise RecordingError(f"{given}{other}: {wrong}")


def _overridden(in_file: Mapping[str, str], used: Mapping[str, str], where: str) -> Iterator[str]:
    """Yield a sentence on each statement in a file that an option of the command line replaces."""
    for key, value in used.items():
        if key in in_file and _normal(key, in_file[key]) != value:
            option = f"--{key.replace('_', '-')}"
            yield f"{key} {in_file[key]!r:.80} of {where} is not used: {option} states {value}"


def _normal(key: str, text: str) -> str:
    """Return a statement of a file in the form of the command line; an invalid one is returned unchanged."""
    try:
        return up_text(parse_up(text)) if key == "up" else text
    except ValueError:
        return text


def _stated_up(up: str | None) -> dict[str, str]:
    """Return the direction of the command line as an option of a file. Raises RecordingError."""
    try:
        return {} if up is None else {"up": up_text(parse_up(up))}
    except ValueError as error:
        raise RecordingError(f"--{error}") from error


def _asked(path: Path, key: str, value: str) -> Any:
    """Return the parsed value of the cell's setting `key` that a file states.

    Raises RecordingError for an invalid name or direction, and for a number that is not above 0.
    """
    if key == "robot":
        if not re.fullmatch(NAME_PATTERN, value):
            raise RecordingError(f"{path}: robot is {value!r}, expected a name as of `caesura robots`")
        return value
    if key == "up":
        try:
            return parse_up(value)
        except ValueError as error:
            raise RecordingError(f"{path}: {error}") from error
    try:
        number = float(value)
    except ValueError:
        number = 0.0
    if not 0.0 < number < np.inf:
        raise RecordingError(f"{path}: {key} is {value!r}, expected a number above 0")
    return number


_OF_HAND = ("wrench_source", "hand_on_robot")  # options that may contradict each other
_CONVERTED: Mapping[Quantity, str] = {"time": "t", "angle": "q", "force": "force"}


def is_bag(path: Path) -> bool:
    """Return whether a path is the directory of a rosbag2, and so one recording."""
    return (path / BAG_METADATA).is_file()


def is_there_as_recording(path: Path) -> bool:
    """Return whether there is a file or a rosbag2 with the form of a recording, by its name."""
    return path.exists() and _reader_of(path) is not None


def is_rosbag(path: Path) -> bool:
    """Return whether `load_recording` reads a path as a rosbag2; False if it cannot read it at all."""
    reader = _reader_of(path)
    try:
        return reader is _read_rosbag or (reader is _read_mcap and _has_ros_profile(path))
    except (*_UNREADABLE, CaesuraError):
        return False


def recordings_of(paths: Iterable[Path]) -> list[Path]:
    """Return the named recordings, each once.

    A directory that is no rosbag2 names all its recordings, sorted. Raises RecordingError for a directory
    without one.
    """
    found: list[Path] = []
    for path in paths:
        inside = [path]
        if path.is_dir() and not is_bag(path):
            inside = sorted(one for one in path.iterdir() if one.suffix.lower() in _READERS or is_bag(one))
            if not inside:
                raise RecordingError(f"{path}: {_unknown(path)}")
        found += inside
    return list(dict.fromkeys(found))


def _read(path: Path, mapping: Path | None, stated: UserStatements) -> UnvalidatedRecording:
    if not path.exists() and path.suffix.lower() in _READERS:
        raise RecordingError(f"{path}: no such file")
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise RecordingError(f"{path}: not a regular file: copy its content to one")
    reader = _reader_of(path)
    if reader is None:
        raise RecordingError(f"{path}: {_unknown(path)}")
    try:
        with _unchanged(path):
            return reader(path, mapping, stated)
    except RecordingError:
        raise
    except _UNREADABLE as error:
        why = " ".join(str(error).split())
        kind = f"{path.suffix[1:]} file" if path.is_file() else "rosbag2"
        raise RecordingError(f"{path}: not a readable {kind} ({why})") from error


def _reader_of(path: Path) -> _Reader | None:
    if path.is_dir():
        return _read_rosbag if is_bag(path) else None
    return _READERS.get(path.suffix.lower())


def _unknown(path: Path) -> str:
    """Return text on a path that no reader accepts, and on the accepted formats."""
    expected = f"expected one of {', '.join(_READERS)}, or the directory of a rosbag2"
    if not path.is_dir():
        return f"suffix {path.suffix!r}, {expected}{'' if path.exists() else '; and there is no such file'}"
    inside = sorted(one.name for one in path.iterdir() if one.suffix.lower() in _READERS)
    if any(name.endswith((".db3", ".mcap")) for name in inside):
        why = "a rosbag2 has it when its recording has ended: end it, or run ros2 bag reindex"
        return f"a directory without metadata.yaml; {why}"
    more = f"; it has {', '.join(inside[:MOST_NAMED])}: name one of them" if inside else ""
    return f"a directory without metadata.yaml, {expected}{more}"


@contextmanager
def _unchanged(path: Path) -> Iterator[None]:
    """Raise RecordingError if the file grows or is replaced while it is read, instead of any other error."""
    before = path.stat()
    try:
        yield
    finally:
        after = path.stat() if path.exists() else None
        if path.is_file() and (
            after is None or (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns)
        ):
            size = "was removed" if after is None else f"went from {before.st_size} to {after.st_size} bytes"
            raise RecordingError(
                f"{path}: {size} while it was read: it is being written, read it when it is complete"
            )


def _as_matrix(values: Array) -> Array:
    return values[:, None] if values.ndim == 1 else values


def _read_npz(path: Path, mapping: Path | None, stated: UserStatements) -> UnvalidatedRecording:
    _no_mapping(path, mapping)
    return read_npz(path)


def _read_csv(path: Path, mapping: Path | None, stated: UserStatements) -> UnvalidatedRecording:
    return read_csv(path) if mapping is None else read_mapped_csv(path, load_mapping(mapping))


def _read_mcap(path: Path, mapping: Path | None, stated: UserStatements) -> UnvalidatedRecording:
    """Read Caesura's MCAP, or a rosbag2 that is one file."""
    if _has_ros_profile(path):
        return _read_rosbag(path, mapping, stated)
    from caesura_protocol.formats.mcap_read import read_mcap  # noqa: PLC0415 - an extra

    _no_mapping(path, mapping)
    return read_mcap(path)


def _has_ros_profile(path: Path) -> bool:
    """Return whether an MCAP file is a rosbag2. Raises ValueError for one of other software, SourceError."""
    with import_extra("mcap", path):
        from caesura_protocol.formats.mcap_read import ROS2, profile_of  # noqa: PLC0415 - an extra
    return profile_of(path) == ROS2


def _read_rosbag(path: Path, mapping: Path | None, stated: UserStatements) -> UnvalidatedRecording:
    with import_extra("ros2", path):
        from caesura_protocol.formats.rosbag import read_rosbag  # noqa: PLC0415 - an extra
    return read_rosbag(path, None if mapping is None else load_mapping(mapping), stated)


def _no_mapping(path: Path, mapping: Path | None) -> None:
    if mapping is not None:
        raise RecordingError(
            f"--mapping {mapping} is for csv files and rosbag2; {path.name} has the names and units itself"
        )


_Reader = Callable[[Path, Path | None, UserStatements], UnvalidatedRecording]
_READERS: Mapping[str, _Reader] = {
    ".npz": _read_npz,
    ".csv": _read_csv,
    ".mcap": _read_mcap,
    ".db3": _read_rosbag,
}

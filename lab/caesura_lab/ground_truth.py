"""Ground truth from annotations: by eye for real recordings, from the state for simulated ones.

The truth of a recording `x.npz` is in `x.ann.json` in the same folder. Points of level `major` must be found;
`optional` ones count neither as a miss nor as a false alarm. Segments are annotated only where the class is
clear.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import WRENCH_SOURCES
from caesura_protocol.number_words import fixed, interval
from caesura_protocol.validation_words import not_one_of

T = TypeVar("T")
Stretch = TypeVar("Stretch", "TrueSegment", "MeasuredQuantity", "ScrewStroke")

KINDS = ("motion", "steady", "contact", "transport", "hold", "sliding", "turning")
LEVELS = ("major", "optional")
# What happens at a changepoint; decay and the gripper's two are of simulated people. One may name none.
POINT_KINDS = ("start", "stop", "contact_on", "contact_off", "corner", "dip", "decay", "grasp", "release")
HAND_ON_ROBOT = ("yes", "no", "unknown")
SHA256_DIGITS = 64
SUFFIX = ".ann.json"
ROUNDING_S = 0.001  # of times


class TruthError(CaesuraError, ValueError):
    """There is no usable truth; the message states the file, the value and the expected content."""


@dataclass(frozen=True)
class TrueChangepoint:
    """A boundary at t [s], known to within tolerance_s; kind: the event (start, contact_on, …).

    t_alt: a second accepted time [s], the other end of a slow event; None if there is one time.
    """

    t: float
    tolerance_s: float
    optional: bool = False
    kind: str = "boundary"
    t_alt: float | None = None

    @property
    def accepted_s(self) -> tuple[float, ...]:
        """Return the accepted times [s], `t` first."""
        return (self.t,) if self.t_alt is None else (self.t, self.t_alt)

    def nearest_s(self, t: float) -> float:
        """Return the accepted time [s] that is nearest to t [s]."""
        return min(self.accepted_s, key=lambda accepted: abs(accepted - t))


@dataclass(frozen=True)
class TrueSegment:
    """A segment from t0 to t1 [s]; kind is one of `KINDS`, or the name of a phase."""

    t0: float
    t1: float
    kind: str


@dataclass(frozen=True)
class MeasuredQuantity:
    """A load [kg] or a force [N] that held from t0 to t1 [s]."""

    t0: float
    t1: float
    value: float


@dataclass(frozen=True)
class ScrewStroke:
    """A stroke that drove a screw from t0 to t1 [s]: its axis (base frame), its advance in one turn [m]."""

    t0: float
    t1: float
    axis: tuple[float, float, float]
    pitch_m: float


@dataclass(frozen=True)
class RecordingSource:
    """The recording that an annotation belongs to: file name, SHA-256, where it comes from, its licence."""

    file: str
    sha256: str
    source: str = ""
    licence: str = ""

    @property
    def demonstration(self) -> str:
        """Return `source` without the part of its file, as `:left` for one of two arms; "" if unstated."""
        return re.sub(r":\w+$", "", self.source)


@dataclass(frozen=True)
class Truth:
    """The truth of one recording. Nothing outside of the window [s] is judged.

    phases: runs of segments that form one skill, in order and without overlap, each with the skill's name.
    robot: groups recordings in the results, "" if unstated. wrench_source, hand_on_robot: the annotator's
    declarations, None if unstated. source: the recording, None for an annotation that names none. screws:
    strokes that drive a screw.
    """

    name: str
    window: tuple[float, float]
    points: tuple[TrueChangepoint, ...]
    spans: tuple[TrueSegment, ...] = ()
    loads: tuple[MeasuredQuantity, ...] = ()
    forces: tuple[MeasuredQuantity, ...] = ()
    hand_in_wrench: bool | None = None
    robot: str = ""
    wrench_source: str | None = None
    hand_on_robot: str | None = None
    source: RecordingSource | None = None
    phases: tuple[TrueSegment, ...] = ()
    screws: tuple[ScrewStroke, ...] = ()

    def within(self, low: float, high: float) -> Truth:
        """Return the truth between two times [s]; segments across one of them are cut there.

        A point with two accepted times stays if one of them lies between.
        """
        return self._changed(
            (max(low, self.window[0]), min(high, self.window[1])),
            tuple(point for point in self.points if any(low <= t <= high for t in point.accepted_s)),
            lambda t0, t1: (max(t0, low), min(t1, high)) if t0 < high and t1 > low else None,
        )

    def at_times(self, time_of: Callable[[float], float]) -> Truth:
        """Return the same truth with each time [s] mapped to another, in the same order."""
        points = (
            replace(one, t=time_of(one.t), t_alt=None if one.t_alt is None else time_of(one.t_alt))
            for one in self.points
        )
        first, last = self.window
        return self._changed(
            (time_of(first), time_of(last)), tuple(points), lambda t0, t1: (time_of(t0), time_of(t1))
        )

    def _changed(
        self,
        window: tuple[float, float],
        points: tuple[TrueChangepoint, ...],
        ends_of: Callable[[float, float], tuple[float, float] | None],
    ) -> Truth:
        """Return the truth with another window, other points, and other segment ends; None leaves one out."""

        def stretches(given: Sequence[Stretch]) -> tuple[Stretch, ...]:
            ends = ((one, ends_of(one.t0, one.t1)) for one in given)
            return tuple(replace(one, t0=found[0], t1=found[1]) for one, found in ends if found is not None)

        return replace(
            self,
            window=window,
            points=points,
            spans=stretches(self.spans),
            loads=stretches(self.loads),
            forces=stretches(self.forces),
            phases=stretches(self.phases),
            screws=stretches(self.screws),
        )


@dataclass(frozen=True)
class ToleranceOptions:
    """The additional tolerance of true points: slack_s [s] is added to each; least_s [s] is the minimum."""

    slack_s: float = 0.0
    least_s: float = 0.0

    def apply_to(self, truth: Truth) -> Truth:
        """Return the truth with every point's tolerance widened."""
        points = (
            replace(point, tolerance_s=max(point.tolerance_s + self.slack_s, self.least_s))
            for point in truth.points
        )
        return replace(truth, points=tuple(points))


def sha256_of(recording: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits: by it an annotation names its recording."""
    return hashlib.sha256(recording.read_bytes()).hexdigest()


def truth_file(recording: Path) -> Path:
    """Return the path of a recording's truth: `x.npz` → `x.ann.json`."""
    return recording.with_suffix(SUFFIX)


def read_truth(recording: Path) -> Truth:
    """Read the truth of a recording. Raises TruthError if there is none, or it cannot be read."""
    path = truth_file(recording)
    if not recording.exists():
        raise TruthError(f"{recording}: no such file")
    if not path.is_file():
        raise TruthError(f"{recording}: not annotated, expected its truth in {path}")
    return read_annotation(path)


def read_annotation(path: Path) -> Truth:
    """Read an annotation. Raises TruthError for anything else."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TruthError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise TruthError(f"{path}: not a readable annotation ({error})") from error
    return truth_of(content, str(path))


def truth_of(content: Mapping[str, Any], name: str) -> Truth:
    """Return the truth in an annotation's content. Raises TruthError, which states the invalid value."""
    try:
        if not isinstance(content, Mapping):
            raise ValueError(f"is a {type(content).__name__}, expected an object")
        content = {"segments": (), "loads": (), "forces": (), "phases": (), "screws": (), **content}
        window = _window(content["window"])
        point_within = partial(_point, window=window)
        return Truth(
            name=name,
            window=window,
            points=tuple(sorted(_each(content, "changepoints", point_within), key=lambda point: point.t)),
            spans=_each(content, "segments", _span),
            loads=_each(content, "loads", partial(_quantity, unit="kg")),
            forces=_each(content, "forces", partial(_quantity, unit="newton")),
            hand_in_wrench=_flag(content, "hand_force_in_wrench"),
            robot=_text(content, "robot"),
            wrench_source=_choice(content, "wrench_source", WRENCH_SOURCES),
            hand_on_robot=_choice(content, "hand_on_robot", HAND_ON_ROBOT),
            source=_source(content.get("recording")),
            phases=_phases(content),
            screws=_each(content, "screws", _screw_stroke),
        )
    except KeyError as error:
        raise TruthError(
            f"{name}: {error.args[0]!r} is missing; docs/annotation.md, The file, has an example"
        ) from error
    except ValueError as error:
        raise TruthError(f"{name}: {error}") from error


def _each(content: Mapping[str, Any], what: str, read: Callable[[Mapping[str, Any]], T]) -> tuple[T, ...]:
    """Return all items of a list, converted by `read`.

    Raises ValueError, which states the invalid one, KeyError.
    """
    entries = content[what]
    if not isinstance(entries, list | tuple):
        raise ValueError(f"{what} is {entries!r}, expected a list")
    found = []
    for index, entry in enumerate(entries):
        if not isinstance(entry, Mapping):
            raise ValueError(f"{what}[{index}] is {entry!r}, expected an object")
        try:
            found.append(read(entry))
        except KeyError as error:
            raise KeyError(f"{what}[{index}].{error.args[0]}") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{what}[{index}]: {error}") from error
    return tuple(found)


def _flag(content: Mapping[str, Any], name: str) -> bool | None:
    """Return True or False; None if it is not stated."""
    value = content.get(name)
    if value is not None and not isinstance(value, bool):
        raise ValueError(f"{name} is {value!r}, expected true or false")
    return value


def _number(entry: Mapping[str, Any], name: str) -> float:
    value = entry[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, expected a finite number")
    return float(value)


def _text(entry: Mapping[str, Any], name: str) -> str:
    value = entry.get(name)
    if value is not None and not isinstance(value, str):
        raise ValueError(f"{name} is {value!r}, expected text")
    return value or ""


def _choice(entry: Mapping[str, Any], name: str, known: Sequence[str]) -> str | None:
    value: str | None = entry.get(name)
    if value is not None and value not in known:
        raise ValueError(not_one_of(name, value, known))
    return value


def _source(entry: Any) -> RecordingSource | None:
    """Return the recording that an annotation names. Raises ValueError, KeyError."""
    if entry is None:
        return None
    if not isinstance(entry, Mapping):
        raise ValueError(f"recording is {entry!r}, expected an object with file and sha256")
    try:
        file, sha256 = entry["file"], entry["sha256"]
    except KeyError as error:
        raise KeyError(f"recording.{error.args[0]}") from error
    if not isinstance(file, str) or not file or Path(file).name != file:
        raise ValueError(f"recording.file is {file!r}, expected a file name without a directory")
    if not isinstance(sha256, str) or not re.fullmatch(rf"[0-9a-f]{{{SHA256_DIGITS}}}", sha256):
        raise ValueError(f"recording.sha256 is {sha256!r}, expected {SHA256_DIGITS} lower-case hex digits")
    return RecordingSource(file, sha256, _text(entry, "source"), _text(entry, "licence"))


def _window(values: Any) -> tuple[float, float]:
    if not (isinstance(values, list | tuple) and len(values) == 2):
        raise ValueError(f"window is {values!r}, expected its first and last second")
    ends = dict(zip(("window[0]", "window[1]"), values, strict=True))
    first, last = (_number(ends, name) for name in ends)
    if not first < last:
        raise ValueError(f"window is [{first:g}, {last:g}], expected it to have a length")
    return first, last


def _point(mark: Mapping[str, Any], window: tuple[float, float]) -> TrueChangepoint:
    level = mark["level"]
    if level not in LEVELS:
        raise ValueError(not_one_of("level", level, LEVELS))
    tolerance = _number(mark, "tol")
    if not tolerance >= 0.0:
        raise ValueError(f"tol is {tolerance}, expected 0 s or more")
    t = _number_within(mark, "t", window)
    t_alt = None if mark.get("t_alt") is None else _number_within(mark, "t_alt", window)
    kind = _choice(mark, "kind", POINT_KINDS) or level
    return TrueChangepoint(t, tolerance, level == "optional", kind, t_alt)


def _number_within(mark: Mapping[str, Any], name: str, window: tuple[float, float]) -> float:
    """Return a time [s] in the window, whose ends are rounded to milliseconds."""
    t, (first, last) = _number(mark, name), window
    if not first - ROUNDING_S <= t <= last + ROUNDING_S:
        limits = interval(first, last, 3, " to ")
        raise ValueError(f"{name} is {fixed(t, 3)} s, expected a time within the window from {limits} s")
    return t


def _span(segment: Mapping[str, Any]) -> TrueSegment:
    kind = segment["cls"]
    if kind not in KINDS:
        raise ValueError(not_one_of("cls", kind, KINDS))
    return TrueSegment(*_ends(segment), kind)


def _phases(content: Mapping[str, Any]) -> tuple[TrueSegment, ...]:
    """Read the phases in order of time. Raises ValueError where two overlap, KeyError."""
    phases = tuple(sorted(_each(content, "phases", _phase), key=lambda phase: phase.t0))
    for before, after in pairwise(phases):
        if after.t0 < before.t1:
            raise ValueError(
                f"phases: {after.kind!r} begins at {after.t0:g} s, expected {before.t1:g} s or later, "
                f"where {before.kind!r} ends"
            )
    return phases


def _phase(entry: Mapping[str, Any]) -> TrueSegment:
    name = entry["name"]
    if not isinstance(name, str) or not name.strip():
        raise ValueError(f"name is {name!r}, expected text")
    return TrueSegment(*_ends(entry), name)


def _quantity(entry: Mapping[str, Any], unit: str) -> MeasuredQuantity:
    value = _number(entry, unit)
    if value < 0.0:
        raise ValueError(f"{unit} is {value:g}, expected 0 or more")
    return MeasuredQuantity(*_ends(entry), value)


def _screw_stroke(entry: Mapping[str, Any]) -> ScrewStroke:
    axis = entry["axis"]
    if not (isinstance(axis, list | tuple) and len(axis) == 3):
        raise ValueError(f"axis is {axis!r}, expected three numbers")
    x, y, z = (_number({f"axis[{i}]": value}, f"axis[{i}]") for i, value in enumerate(axis))
    if not math.hypot(x, y, z) > 0.0:
        raise ValueError(f"axis is {axis!r}, expected a direction")
    return ScrewStroke(*_ends(entry), (x, y, z), _number(entry, "pitch_m"))


def _ends(entry: Mapping[str, Any]) -> tuple[float, float]:
    first, last = _number(entry, "t0"), _number(entry, "t1")
    if last < first:
        raise ValueError(f"t0 is {first:g} and t1 is {last:g}, expected it to end after it begins")
    return first, last

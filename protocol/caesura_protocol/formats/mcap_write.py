"""Writes a demonstration as an MCAP file for Foxglove and Rerun. Needs the extra `mcap`.

Every message is JSON with a JSON Schema. Its log time is the session time converted to the time of day; the
offset is in the file's metadata, with the station, the preset and the units. A segment, a phase, a
changepoint and a gap have the time of their start, the program that of the end, the path that of the
beginning.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from caesura_protocol.formats.mcap_schemas import (
    BASE,
    CHANNELS,
    FLANGE,
    RobotState,
    TaskProgram,
    Wrench,
    schema_of,
)
from caesura_protocol.formats.write import whole_file
from caesura_protocol.messages import Changepoint, Gap, Message, Phase, Segment
from caesura_protocol.package_version_and_extras import installed_version
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]

NS = 10**9
TRANSFORM_S, PATH_S = 0.01, 0.1  # between two frames that are drawn, and two points of the path
METADATA = "caesura"  # the name of the file's metadata record
UPRIGHT = (0.0, 0.0, 0.0, 1.0)  # where no orientation is known


class Poses(NamedTuple):
    """Poses of the flange: times (n,) [s], positions (n, 3) [m], orientations (n, 4) x y z w, base frame."""

    t: Array
    positions: Array
    orientations: Array


NO_POSES = Poses(np.empty(0), np.empty((0, 3)), np.empty((0, 4)))


@dataclass(frozen=True)
class McapContent:
    """The content of an MCAP file: samples, results and metadata of one session."""

    station: str
    session: str
    preset: str
    recording: Recording
    began_s: float  # [s] time of day at the session's time 0
    columns: tuple[str, ...]  # as they were sent
    poses: Poses = NO_POSES
    segments: tuple[Segment, ...] = ()
    phases: tuple[Phase, ...] = ()
    changepoints: tuple[Changepoint, ...] = ()
    gaps: tuple[Gap, ...] = ()
    program: TaskProgram = field(default_factory=TaskProgram)
    wrench_note: str = ""
    more: dict[str, str] = field(default_factory=dict)  # the caller's metadata


class McapMessage(NamedTuple):
    """A message with its topic and time."""

    t: float  # [s] session clock
    topic: str
    fields: dict[str, Any]


def write_mcap(path: Path, content: McapContent) -> int:
    """Write the file, completely or not at all; return the number of messages. Raises OSError."""
    with whole_file(path) as part, part.open("wb") as stream:
        return _write(stream, content)


def entries(content: McapContent) -> Iterator[McapMessage]:
    """Yield every message in order of time."""
    points = decimate(content.poses.t, PATH_S)
    path = [path_of(Poses(*(of[points] for of in content.poses)), content.began_s)] if points else []
    return heapq.merge(sample_entries(content), path, _results(content), key=itemgetter(0))


def sample_entries(content: McapContent) -> Iterator[McapMessage]:
    """Yield the messages of the samples, and of the resulting flange poses."""
    streams = (
        _samples(content, "/state", RobotState),
        _samples(content, "/wrench", Wrench),
        _frames(content),
    )
    return heapq.merge(*streams, key=itemgetter(0))


def poses_of(recording: Recording) -> Poses:
    """Return the recorded poses of the flange, at least TRANSFORM_S apart.

    They are NO_POSES, which is empty, if only joints are recorded.
    """
    position = recording.signals.get("pos")
    if position is None:
        return NO_POSES
    metres = position * {"m": 1.0, "cm": 1e-2, "mm": 1e-3}[recording.length_unit]
    turned = recording.signals.get("quat", np.tile(UPRIGHT, (recording.t.size, 1)))
    kept = decimate(recording.t, TRANSFORM_S)
    return Poses(recording.t[kept], metres[kept], turned[kept])


def decimate(times: Array, step_s: float) -> list[int]:
    """Return the indices of samples at least step_s [s] apart, in order of time, the first included."""
    kept: list[int] = []
    due = -np.inf
    for index, t in enumerate(times.tolist()):
        if t >= due:
            kept.append(index)
            due = t + step_s - 1e-6  # a robot at this very rate is not to lose a sample to rounding
    return kept


def _write(stream: IO[bytes], content: McapContent) -> int:
    writer = Writer(stream)
    writer.start(profile="", library=f"caesura {installed_version()}")
    channels = {topic: _channel(writer, topic) for topic in CHANNELS}
    writer.add_metadata(METADATA, _metadata(content))
    count = 0
    for entry in entries(content):
        when = nanoseconds(entry.t, content.began_s)
        data = json.dumps(entry.fields, separators=(",", ":"), allow_nan=False).encode()
        writer.add_message(channels[entry.topic], when, data, publish_time=when, sequence=count)
        count += 1
    writer.finish()  # type: ignore[no-untyped-call]
    return count


def _assumed_orientation(content: McapContent) -> dict[str, str]:
    """Return the statement that drawn frames have no recorded orientation; nothing where they have one."""
    is_drawn = bool(content.poses.t.size) and bool((content.poses.orientations == UPRIGHT).all())
    if not is_drawn or "quat" in content.recording.signals:
        return {}
    return {"orientation": "not recorded: /tf and /path show the axes of the base"}


def _channel(writer: Writer, topic: str) -> int:
    schema = json.dumps(schema_of(topic)).encode()
    registered = writer.register_schema(name=CHANNELS[topic][0], encoding="jsonschema", data=schema)
    return writer.register_channel(topic=topic, message_encoding="json", schema_id=registered)


def _metadata(content: McapContent) -> dict[str, str]:
    recording = content.recording
    return {
        "station": content.station,
        "session": content.session,
        "preset": content.preset,
        "complete": json.dumps(content.program.complete),
        "wrench_note": content.wrench_note,
        **recording.file_statements,
        "columns": " ".join(content.columns),
        "units": "/state and /wrench as sent: pos in length_unit, q rad, force N in force_frame, torque and "
        "tau Nm; everything else: s, m, N, kg in the base frame",
        "clock": "log time is began_s + t; t is the session's own clock",
        "began_s": repr(content.began_s),
        **_assumed_orientation(content),
        **content.more,
    }


# --- messages -------------------------------------------------------------------------------------------


def _samples(content: McapContent, topic: str, model: type[Message]) -> Iterator[McapMessage]:
    """Yield a message for each sample, in order of arrival, with the fields of a model that the session has.

    Nothing is yielded if it has none of them.
    """
    signals = {name: content.recording.signals.get(name) for name in model.model_fields}
    columns = {name: _values(values) for name, values in signals.items() if values is not None}
    if not columns:
        return
    times = np.maximum.accumulate(content.recording.t)  # in the order of the merge; `t` is as it came
    rows = zip(times.tolist(), content.recording.t.tolist(), *columns.values(), strict=True)
    for when, t, *row in rows:
        yield McapMessage(when, topic, {"t": t, **dict(zip(columns, row, strict=True))})


def _values(signal: Array) -> list[Any]:
    """Return the numbers of a signal with one column, else lists of them."""
    return (signal[:, 0] if signal.shape[1] == 1 else signal).tolist()  # type: ignore[no-any-return]


def _results(content: McapContent) -> list[McapMessage]:
    end = float(content.recording.t.max())
    said: Iterable[tuple[float, str, Message]] = (
        *((one.t0, "/segments", one) for one in content.segments),
        *((one.t0, "/phases", one) for one in content.phases),
        *((one.t, "/changepoints", one) for one in content.changepoints),
        *((one.t0, "/gaps", one) for one in content.gaps),
        (end, "/program", content.program),
    )
    return sorted((result_of(*one) for one in said), key=itemgetter(0))


def result_of(t: float, topic: str, message: Message) -> McapMessage:
    """Return a result as a message of a topic."""
    return McapMessage(t, topic, message.model_dump(mode="json", exclude_none=True))


def _frames(content: McapContent) -> Iterator[McapMessage]:
    """Yield the poses of the flange's frame."""
    for t, position, orientation in zip(*(of.tolist() for of in content.poses), strict=True):
        stamp = _stamp(t, content.began_s)
        yield McapMessage(t, "/tf", _transform(stamp, _xyz(position), _xyzw(orientation)))


def path_of(poses: Poses, began_s: float) -> McapMessage:
    """Return the path through at least one pose."""
    pairs = zip(poses.positions.tolist(), poses.orientations.tolist(), strict=True)
    points = [{"position": _xyz(position), "orientation": _xyzw(turned)} for position, turned in pairs]
    start = float(poses.t[0])
    return McapMessage(
        start, "/path", {"timestamp": _stamp(start, began_s), "frame_id": BASE, "poses": points}
    )


def _transform(stamp: dict[str, int], position: Any, rotation: Any) -> dict[str, Any]:
    return {
        "timestamp": stamp,
        "parent_frame_id": BASE,
        "child_frame_id": FLANGE,
        "translation": position,
        "rotation": rotation,
    }


def _xyz(vector: list[float]) -> dict[str, float]:
    return dict(zip("xyz", vector, strict=True))


def _xyzw(quaternion: list[float]) -> dict[str, float]:
    return dict(zip("xyzw", quaternion, strict=True))


# --- time -----------------------------------------------------------------------------------------------


def nanoseconds(t: float, began_s: float) -> int:
    """Return the time of day [ns] of a session time [s]. began_s: time of day [s] of its time 0.

    Both are rounded separately: their sum would lose precision below 0.2 µs.
    """
    return _whole_ns(began_s) + _whole_ns(t)


def _whole_ns(seconds: float) -> int:
    """Return seconds in [ns]. A product of a time of day and 10⁹ would be up to 128 ns off."""
    whole = math.floor(seconds)
    return whole * NS + round((seconds - whole) * NS)


def _stamp(t: float, began_s: float) -> dict[str, int]:
    sec, nsec = divmod(nanoseconds(t, began_s), NS)
    return {"sec": sec, "nsec": nsec}

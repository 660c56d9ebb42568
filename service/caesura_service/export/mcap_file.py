"""A session as an MCAP file, which Foxglove and Rerun open. Needs the extra `mcap`.

Every message is JSON with a JSON Schema beside it. Its log time is the session's clock set on the time of
day (`taught`); both are in the file's metadata, with the station, the preset and the units. A segment, a
changepoint and a gap stand where they begin, the program at the end, the path at the beginning.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterable, Iterator
from importlib.metadata import PackageNotFoundError, version
from operator import itemgetter
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from caesura_protocol.messages import Message
from caesura_service.export.channels import BASE, CHANNELS, FLANGE, State, TaskProgram, Wrench, schema_of
from caesura_service.export.taught import Taught
from caesura_service.session.pipeline import layout_of
from caesura_service.signals import Layout
from caesura_service.signals.flange import columns_of, flange_rows

Array = NDArray[np.float64]

NS = 10**9
TRANSFORM_S, PATH_S = 0.01, 0.1  # between two frames that are drawn, and two points of the path
UPRIGHT = (0.0, 0.0, 0.0, 1.0)  # where no orientation is known


class Entry(NamedTuple):
    """A message and where it goes."""

    t: float  # [s] session clock
    topic: str
    fields: dict[str, Any]


def write_mcap(path: Path, taught: Taught) -> int:
    """Write the file, all of it or none; returns the number of messages. Raises OSError."""
    unfinished = path.with_name(path.name + ".part")
    try:
        with unfinished.open("wb") as stream:
            count = _write(stream, taught)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return count


def entries(taught: Taught) -> Iterator[Entry]:
    """Every message in order of time."""
    streams = [_samples(taught, "/state", State), _samples(taught, "/wrench", Wrench), *_drawn(taught)]
    return heapq.merge(*streams, _results(taught), key=itemgetter(0))


def _write(stream: IO[bytes], taught: Taught) -> int:
    writer = Writer(stream)
    writer.start(profile="", library=f"caesura {_version()}")
    channels = {topic: _channel(writer, topic) for topic in CHANNELS}
    writer.add_metadata("caesura", _metadata(taught))
    count = 0
    for entry in entries(taught):
        when = _nanoseconds(entry.t, taught.began_s)
        data = json.dumps(entry.fields, separators=(",", ":"), allow_nan=False).encode()
        writer.add_message(channels[entry.topic], when, data, publish_time=when, sequence=count)
        count += 1
    writer.finish()  # type: ignore[no-untyped-call]
    return count


def _channel(writer: Writer, topic: str) -> int:
    schema = json.dumps(schema_of(topic)).encode()
    registered = writer.register_schema(name=CHANNELS[topic][0], encoding="jsonschema", data=schema)
    return writer.register_channel(topic=topic, message_encoding="json", schema_id=registered)


def _metadata(taught: Taught) -> dict[str, str]:
    opening, wrench = taught.opening, taught.view.wrench
    return {
        "station": taught.station,
        "session": opening.session,
        "preset": opening.preset or "",
        "complete": json.dumps(taught.complete),
        "wrench_source": opening.wrench_source,
        "wrench_note": wrench.note,
        "force_frame": opening.force_frame,
        "length_unit": opening.length_unit,
        "columns": " ".join(opening.columns),
        "units": "/state and /wrench as sent: pos in length_unit, q rad, force N in force_frame, torque and "
        "tau Nm; everything else: s, m, N, kg in the base frame",
        "clock": "log time is began_s + t; t is the session's own clock",
        "began_s": repr(taught.began_s),
    }


# --- messages -------------------------------------------------------------------------------------------


def _samples(taught: Taught, topic: str, model: type[Message]) -> Iterator[Entry]:
    """What of a model's fields the session has, sample by sample, in order of arrival."""
    signals = {name: taught.recording.signals.get(name) for name in model.model_fields}
    columns = {name: _values(values) for name, values in signals.items() if values is not None}
    if not columns:
        return
    times = np.maximum.accumulate(taught.recording.t)  # in the order of the merge; `t` is as it came
    rows = zip(times.tolist(), taught.recording.t.tolist(), *columns.values(), strict=True)
    for when, t, *row in rows:
        yield Entry(when, topic, {"t": t, **dict(zip(columns, row, strict=True))})


def _values(signal: Array) -> list[Any]:
    """Numbers of a signal with one column, else lists of them."""
    return (signal[:, 0] if signal.shape[1] == 1 else signal).tolist()  # type: ignore[no-any-return]


def _results(taught: Taught) -> list[Entry]:
    view, end = taught.view, float(taught.recording.t.max())
    program = TaskProgram(complete=taught.complete, apps=view.apps, notes=taught.notes)
    said: Iterable[tuple[float, str, Message]] = (
        *((one.t0, "/segments", one) for one in view.segments),
        *((one.t, "/changepoints", one) for one in view.changepoints),
        *((one.t0, "/gaps", one) for one in view.gaps),
        (end, "/program", program),
    )
    made = [Entry(t, topic, message.model_dump(mode="json", exclude_none=True)) for t, topic, message in said]
    return sorted(made, key=itemgetter(0))


def _drawn(taught: Taught) -> tuple[list[Entry], list[Entry]]:
    """The flange's frame as it goes, and its whole path."""
    times, positions, orientations = _poses(taught)
    if not times.size:
        return [], []
    poses = [(_xyz(p), _xyzw(o)) for p, o in zip(positions.tolist(), orientations.tolist(), strict=True)]
    frames = [
        Entry(t, "/tf", _transform(_stamp(t, taught.began_s), *pose))
        for t, pose in zip(times.tolist(), poses, strict=True)
    ]
    points = [{"position": p, "orientation": o} for p, o in (poses[i] for i in _every(times, PATH_S))]
    stamp = _stamp(float(times[0]), taught.began_s)
    path = Entry(float(times[0]), "/path", {"timestamp": stamp, "frame_id": BASE, "poses": points})
    return frames, [path]


def _poses(taught: Taught) -> tuple[Array, Array, Array]:
    """Times (n,) [s], positions (n, 3) [m] and orientations (n, 4), base frame, TRANSFORM_S apart or more."""
    opening = taught.opening.model_copy(update={"columns": taught.recording.columns})
    layout = layout_of(opening)
    times, values = _read(layout, taught.recording.matrix())
    kept = _every(times, TRANSFORM_S)
    if not kept:
        return times, np.empty((0, 3)), np.empty((0, 4))
    rows = np.concatenate(flange_rows(layout, values[kept], None), axis=1)
    columns = columns_of(layout)
    upright = np.tile(UPRIGHT, (len(kept), 1))
    turned = upright if columns.orientation is None else rows[:, columns.orientation]
    return times[kept], rows[:, columns.position], turned


def _read(layout: Layout, samples: Array) -> tuple[Array, Array]:
    """Times and columns in use, without the samples that the service refused."""
    try:
        return layout.read(samples)
    except ValueError:
        good = [row for row in np.split(samples, len(samples)) if _is_possible(layout, row)]
        return layout.read(np.concatenate(good or [samples[:0]]))


def _is_possible(layout: Layout, sample: Array) -> bool:
    try:
        layout.read(sample)
    except ValueError:
        return False
    return True


def _every(times: Array, step_s: float) -> list[int]:
    """Samples at least so far apart, in order of time, the first one among them."""
    kept: list[int] = []
    due = -np.inf
    for index, t in enumerate(times.tolist()):
        if t >= due:
            kept.append(index)
            due = t + step_s
    return kept


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


def _nanoseconds(t: float, began_s: float) -> int:
    """Time of day of a session time. The two apart: together they would lose what is below 0.2 µs."""
    return round(began_s * NS) + round(t * NS)


def _stamp(t: float, began_s: float) -> dict[str, int]:
    sec, nsec = divmod(_nanoseconds(t, began_s), NS)
    return {"sec": sec, "nsec": nsec}


def _version() -> str:
    try:
        return version("caesura")
    except PackageNotFoundError:
        return "0+unknown"

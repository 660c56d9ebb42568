"""Reads Caesura's MCAP files: the samples as they were sent, bit for bit. Needs the extra `mcap`.

JSON writes a float in the shortest form that reads as the same float, so no precision is lost. Messages are
read in the order of the file, which is that of arrival. Results and drawings are not read, because they
follow from the samples.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from zstandard import ZstdError

from caesura_protocol.formats.mcap_schemas import RobotState, Wrench
from caesura_protocol.formats.mcap_write import METADATA
from caesura_protocol.formats.unvalidated_recording import Array, UnvalidatedRecording
from caesura_protocol.messages import Message
from caesura_protocol.number_words import counted
from caesura_protocol.recording import BEGAN, OF_FILE, assumed_by_writer
from caesura_protocol.session_time_display import OF_DAY_S

ROS2 = "ros2"  # the profile of a rosbag2
T = TypeVar("T")
_TOPICS: Mapping[str, type[Message]] = {"/state": RobotState, "/wrench": Wrench}


def read_mcap(path: Path) -> UnvalidatedRecording:
    """Return the samples of a file that Caesura wrote. Raises ValueError for any other."""
    with path.open("rb") as stream:
        return _translated(_content, stream)


def profile_of(path: Path) -> str:
    """Return `ros2` for a rosbag2, `""` for Caesura's. Raises ValueError for any other file."""
    with path.open("rb") as stream:
        return _translated(_profile, stream)


def metadata_of(reader: McapReader) -> Mapping[str, str]:
    """Return Caesura's metadata of the session. Raises ValueError if other software wrote the file."""
    for record in reader.iter_metadata():
        if record.name == METADATA:
            return record.metadata
    topics = sorted(channel.topic for channel in _channels(reader))
    raise ValueError(
        f"has no metadata {METADATA!r}, so it is neither Caesura's nor a rosbag2 (profile {ROS2!r}); "
        f"its topics: {', '.join(topics) or 'none'}"
    )


def _translated(read: Callable[[IO[bytes]], T], stream: IO[bytes]) -> T:
    try:
        return read(stream)
    except (McapError, ZstdError, struct.error, KeyError) as error:
        what = f"{type(error).__name__}: {error}".removesuffix(": ")
        raise ValueError(f"{what}; is it still being written, or was it cut short?") from error


def _profile(stream: IO[bytes]) -> str:
    return str(make_reader(stream).get_header().profile)


def _channels(reader: McapReader) -> list[Any]:
    summary = reader.get_summary()
    return [] if summary is None else list(summary.channels.values())


def _content(stream: IO[bytes]) -> UnvalidatedRecording:
    reader = make_reader(stream, validate_crcs=True)
    said = metadata_of(reader)
    arrays: dict[str, Array] = {}
    for topic, rows in _rows(reader).items():
        for name, values in _columns(topic, rows):
            if name != "t" or "t" not in arrays:
                arrays[name] = values
            elif not np.array_equal(arrays["t"], values):
                raise ValueError(
                    f"{topic} has {counted(len(values), 'sample')} at other times than /state has"
                )
    options = {key: said[key] for key in OF_FILE if key in said}
    if float(options.get(BEGAN, 0.0)) < OF_DAY_S:  # it was not known, or the samples have the time of day
        options.pop(BEGAN, None)
    return UnvalidatedRecording(arrays, options, [], assumed_by_writer(said))


def _rows(reader: McapReader) -> dict[str, list[dict[str, Any]]]:
    """Return the messages of each topic with samples, in the order of the file."""
    rows: dict[str, list[dict[str, Any]]] = {topic: [] for topic in _TOPICS}
    for _, channel, message in reader.iter_messages(topics=list(_TOPICS), log_time_order=False):
        rows[channel.topic].append(json.loads(message.data))
    return rows


def _columns(topic: str, rows: list[dict[str, Any]]) -> Iterator[tuple[str, Array]]:
    """Yield the signals of a topic by name. Raises ValueError if a sample has other fields than the first."""
    if not rows:
        return
    names = [name for name in _TOPICS[topic].model_fields if name in rows[0]]
    for index, row in enumerate(rows):
        if row.keys() != rows[0].keys():
            found, expected = (", ".join(sorted(one)) for one in (row, rows[0]))
            raise ValueError(f"{topic}, sample {index}: has {found}, expected {expected}")
    for name in names:
        yield name, np.array([row[name] for row in rows], dtype=np.float64)

"""A rosbag2, mcap or sqlite3, as a recording. Needs the extra `ros2`.

Times are those of the message headers, not of the recorder. What is read of which topic: `ros_plan`; how
several topics become one matrix: `joining`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError

from caesura_protocol.codec import signals_of
from caesura_protocol.formats.column_mapping import ColumnMapping
from caesura_protocol.formats.raw_recording import RawRecording
from caesura_protocol.formats.ros_messages import TopicRule, definitions_of, stamp_of, topic_rules
from caesura_protocol.formats.ros_types import READ, typestore
from caesura_protocol.formats.signal_aligner import Row, SignalAligner
from caesura_protocol.formats.topic_selection import Topic, TopicSelection, select_topics
from caesura_protocol.recording import RecordingError

TYPE_NAME = re.compile(r"[A-Za-z]\w*(?:/(?:msg|srv|action))?/[A-Za-z]\w*", re.ASCII)
FIRST_MESSAGES = 50  # messages of a topic, to find its signals: joint states may come from several nodes


def read_rosbag(path: Path, mapped: ColumnMapping | None, wrench_source: str | None) -> RawRecording:
    """A rosbag2's directory, or one of its files. Raises RecordingError, or ValueError for no rosbag2."""
    rules = topic_rules(mapped)
    store = typestore(definitions_of(rules, path))
    try:
        _check_types(path)
        with AnyReader([path], default_typestore=store) as reader:
            topics = _topics(reader, rules, path)
            plan = select_topics(list(_first_messages(reader, topics)), mapped, wrench_source)
            return _content(path, reader, topics, plan)
    except (AnyReaderError, ReaderError, AssertionError, KeyError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _check_types(path: Path) -> None:
    """Refuse names that are none before rosbags makes classes of them, for which it compiles what it read."""
    with Reader(path) as reader:
        for connection in reader.connections:
            if not TYPE_NAME.fullmatch(connection.msgtype):
                raise RecordingError(
                    f"{path}: {connection.topic!r} has the type {connection.msgtype[:100]!r}, "
                    "expected package/msg/Name"
                )


def _topics(reader: AnyReader, rules: Mapping[str, TopicRule], path: Path) -> dict[str, Topic]:
    """The topics to read: those of the mapping, or else all of a type that is read."""
    available = {connection.topic: connection for connection in reader.connections}
    missing = sorted(set(rules) - set(available))
    if missing:
        raise RecordingError(
            f"{path}: no topic {missing[0]!r}, which the mapping names; it has {_listed(available)}"
        )
    wanted = [name for name in (rules or available) if available[name].msgtype in READ]
    if not wanted:
        raise RecordingError(
            f"{path}: no topic of a type that is read; it has {_listed(available)}, "
            f"expected {', '.join(READ)}"
        )
    return {
        name: Topic(name, available[name].msgtype, rules.get(name, TopicRule(name)))
        for name in wanted
        if available[name].msgcount
    }


def _listed(available: Mapping[str, Connection]) -> str:
    return ", ".join(f"{name} ({connection.msgtype})" for name, connection in available.items()) or "none"


def _messages(reader: AnyReader, topics: Mapping[str, Topic], *only: str) -> Iterator[tuple[Topic, Any]]:
    wanted = [c for c in reader.connections if c.topic in (only or topics)]
    for connection, _, raw in reader.messages(connections=wanted):
        yield topics[connection.topic], reader.deserialize(raw, connection.msgtype)


def _first_messages(reader: AnyReader, topics: Mapping[str, Topic]) -> Iterator[tuple[Topic, Any]]:
    for name in topics:
        yield from islice(_messages(reader, topics, name), FIRST_MESSAGES)


def _content(
    path: Path, reader: AnyReader, topics: Mapping[str, Topic], plan: TopicSelection
) -> RawRecording:
    joiner = SignalAligner(plan.signals, joints=plan.joints)
    used = {name: topics[name] for name in topics if name in plan.topic_of.values()}
    rows: list[Row] = []
    for topic, message in _messages(reader, used):
        rows += joiner.push(stamp_of(message, f"{path}: {topic.name}"), plan.select_values(topic, message))
    rows += joiner.flush()
    if not rows:
        raise RecordingError(
            f"{path}: no time at which all of {', '.join(plan.signals)} have a value; do their stamps agree?"
        )
    matrix = np.array(rows, dtype=np.float64)
    unread = sorted({c.topic for c in reader.connections} - set(used))
    arrays = {"t": matrix[:, 0].copy(), **signals_of(joiner.columns, matrix)}
    return RawRecording(arrays, dict(plan.options), unread)

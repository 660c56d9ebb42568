"""Reads a rosbag2, mcap or sqlite3, as a recording. Needs the extra `ros2`.

Times are those of the message headers, not of the recorder. `topic_selection` selects the topic of each
signal; `signal_aligner` joins several topics to one matrix.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError

from caesura_protocol.codec import signals_of
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.ros_messages import TopicRule, definitions_of, stamp_of, topic_rules
from caesura_protocol.formats.ros_types import READ, typestore
from caesura_protocol.formats.signal_aligner import MAX_AGE_S, Row, SignalAligner
from caesura_protocol.formats.topic_selection import (
    Topic,
    TopicSelection,
    select_topics,
    with_arm_joints,
)
from caesura_protocol.formats.unvalidated_recording import UnvalidatedRecording, UserStatements
from caesura_protocol.messages import COLUMNS_OF_SIGNAL
from caesura_protocol.recording import RecordingError

INCOMPLETE = "is it still being recorded, or was it cut short? End the recording, or run ros2 bag reindex"
TYPE_NAME = re.compile(r"[A-Za-z]\w*(?:/(?:msg|srv|action))?/[A-Za-z]\w*", re.ASCII)
SLOWER = 2  # times as many values of the leading signal: the other one is held, and that is stated
FIRST_MESSAGES = 50  # messages of a topic, to find its signals: joint states may come from several nodes


def read_rosbag(path: Path, mapped: ColumnMapping | None, stated: UserStatements) -> UnvalidatedRecording:
    """Read a rosbag2's directory, or one of its files.

    Raises RecordingError, or ValueError for another file.
    """
    rules = topic_rules(mapped)
    store = typestore(definitions_of(rules, path))
    try:
        _check_types(path)
        with AnyReader([path], default_typestore=store) as reader:
            topics = _topics(reader, rules, path)
            first = with_arm_joints(list(_first_messages(reader, topics)), mapped, stated)
            topics |= {topic.name: topic for topic, _ in first}
            plan = select_topics(first, mapped, stated)
            return _content(path, reader, topics, plan, named=bool(rules))
    except (AnyReaderError, ReaderError, AssertionError, KeyError) as error:
        raise ValueError(f"{type(error).__name__}: {error}; {INCOMPLETE}") from error


def _check_types(path: Path) -> None:
    """Refuse invalid type names before rosbags makes classes of them, for which it compiles text."""
    with Reader(path) as reader:
        for connection in reader.connections:
            if not TYPE_NAME.fullmatch(connection.msgtype):
                raise RecordingError(
                    f"{path}: {connection.topic!r} has the type {connection.msgtype[:100]!r}, "
                    "expected package/msg/Name"
                )


def _topics(reader: AnyReader, rules: Mapping[str, TopicRule], path: Path) -> dict[str, Topic]:
    """Return the topics to read: those of the mapping, or else all of a supported type."""
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
    path: Path, reader: AnyReader, topics: Mapping[str, Topic], plan: TopicSelection, *, named: bool
) -> UnvalidatedRecording:
    """Return the content of a plan's topics, aligned in time. named: whether a mapping names the topics.

    Raises RecordingError if the signals have no time in common.
    """
    joiner = SignalAligner(plan.signals, joints=plan.joints)
    used = {name: topics[name] for name in topics if name in plan.topic_of.values()}
    rows: list[Row] = []
    counts: Counter[str] = Counter()  # of the values of each signal
    for topic, message in _messages(reader, used):
        values = plan.select_values(topic, message)
        counts.update(values.keys())
        rows += joiner.push(stamp_of(message, f"{path}: {topic.name}"), values)
    rows += joiner.flush()
    if not rows:
        raise RecordingError(
            f"{path}: no time at which all of {', '.join(plan.signals)} have a value; do their stamps agree?"
        )
    matrix = np.array(rows, dtype=np.float64)
    unread = sorted({c.topic for c in reader.connections} - set(used))
    arrays = {"t": matrix[:, 0].copy(), **signals_of(joiner.columns, matrix)}
    assumed = [*(() if named else _of_topics(plan.topic_of)), *_of_rates(plan, joiner, counts, len(rows))]
    return UnvalidatedRecording(arrays, dict(plan.options), unread, tuple(assumed))


def _of_topics(topic_of: Mapping[str, str]) -> Iterator[str]:
    """Yield a sentence on topics that were combined by their types: they may come from several robots."""
    signals = [signal for signal in COLUMNS_OF_SIGNAL if signal in topic_of]
    names = [*dict.fromkeys(topic_of[signal] for signal in signals)]
    if len(names) < 2:
        return
    taken = [f"{', '.join(one for one in signals if topic_of[one] == name)} from {name}" for name in names]
    yield (
        f"Topics are taken as those of one robot, by their types: {'; '.join(taken)}. A mapping with "
        "[topics] names others."
    )


def _of_rates(plan: TopicSelection, joiner: SignalAligner, counts: Counter[str], rows: int) -> Iterator[str]:
    """Yield sentences on signals held between their values, and on rows left out for lack of one."""
    leads = counts[joiner.leader]
    for name in sorted(set(plan.topic_of.values())):
        slow = [
            signal
            for signal in plan.signals
            if plan.topic_of[signal] == name and signal != "gripper" and SLOWER * counts[signal] <= leads
        ]
        if slow:
            yield (
                f"{', '.join(slow)} of {name} have {counts[slow[0]]} values where {joiner.leader} has "
                f"{leads}: each is held until the next."
            )
    if joiner.skipped:
        yield (
            f"{joiner.skipped} of {joiner.skipped + rows} values of {joiner.leader} are left out: another "
            f"signal has no value within {MAX_AGE_S:g} s before them."
        )

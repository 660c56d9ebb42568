"""What reading a robot costs a bridge: time per sample of each source, without robot and network.

    python tests/bench/source_cost.py

A robot at 1 kHz leaves 1000 µs a sample. Prints; asserts nothing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from caesura_clients.bridge.sources.libfranka_state import FrankaSource, state_of
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.ros_messages import TopicRule, stamp_of
from caesura_protocol.formats.ros_types import FRANKA_STATE, POSE, WRENCH, decoder
from caesura_protocol.formats.signal_aligner import SignalAligner
from caesura_protocol.formats.topic_selection import Topic, TopicSelection
from clients.fake_franka import GUIDING, FrankaScript, fake_libfranka, state
from harness import ros
from harness.demonstrations import guided

SAMPLES = 1000


def franka() -> float:
    """[s] per sample, from libfranka's state to the chunk."""
    script = FrankaScript([state(i) for i in range(SAMPLES)])
    robot = fake_libfranka(script).Robot("", None)
    raw = iter([robot.read_once() for _ in range(SAMPLES)])
    source = FrankaSource("bench", lambda: state_of(next(raw), guiding=GUIDING))
    begun, count = time.perf_counter(), 0
    try:
        for chunk in source.chunks():
            count += len(chunk)
    except SourceError:
        pass
    return (time.perf_counter() - begun) / count


def live(messages: list[ros.Message], signals: dict[str, str]) -> float:
    """[s] per row, from CDR to the row."""
    kinds = {topic: kind for topic, kind, _, _ in messages}
    topics = {topic: Topic(topic, kind, TopicRule(topic)) for topic, kind in kinds.items()}
    payloads = [(topics[topic], ros.cdr(message, kind)) for topic, kind, _, message in messages]
    plan, joiner, read = TopicSelection(signals, {}), SignalAligner(tuple(signals), patience_s=0.1), decoder()
    begun, rows = time.perf_counter(), 0
    for topic, payload in payloads:
        message = read.read(topic.type, payload)
        rows += len(joiner.push(stamp_of(message, topic.name), plan.select_values(topic, message)))
    return (time.perf_counter() - begun) / max(rows, 1)


def ros_franka() -> float:
    """A FrankaRobotState that tells everything."""
    made = guided()
    n = min(SAMPLES, made.t.size)
    reported = {
        "pos": made.signals["pos"][:n],
        "quat": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        "q": np.ones((n, 7)),
        "force": made.signals["force"][:n],
        "torque": np.ones((n, 3)),
        "tau": np.ones((n, 7)),
    }
    messages = list(ros.franka_topic(replace(made, t=made.t[:n], signals=reported)))
    topic = messages[0][0]
    assert messages[0][1] == FRANKA_STATE
    return live(messages, dict.fromkeys(reported, topic))


def ros_sensor() -> float:
    """A pose and a wrench of their own."""
    messages = list(ros.sensor_topics(guided()))
    assert {kind for _, kind, _, _ in messages} == {POSE, WRENCH}
    return live(messages, {"pos": "/pose", "force": "/ft/wrench"})


CASES: dict[str, Callable[[], float]] = {
    "franky, panda: libfranka's state to a sample": franka,
    "ros2: FrankaRobotState, CDR to a row": ros_franka,
    "ros2: PoseStamped and WrenchStamped, CDR to a row": ros_sensor,
}


def main() -> None:
    """Median of five runs each."""
    for name, measure in CASES.items():
        measure()
        print(f"{name:52s} {1e6 * float(np.median([measure() for _ in range(5)])):7.1f} µs")


if __name__ == "__main__":
    main()

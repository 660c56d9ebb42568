"""Live ROS 2 over a real Zenoh router: CDR in both layouts of keys gives the segments of the npz."""

from __future__ import annotations

import json
import re
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import zenoh

from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources import Mark
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_clients.bridge.sources.ros2 import LostStretches, Ros2Source, parse_key
from caesura_protocol.errors import SourceError
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.ros_types import FRANKA_STATE, JOINT_STATE, POSE, WRENCH
from caesura_protocol.recording import Recording
from caesura_protocol.robots import robot_description
from caesura_protocol.transport.zenoh_transport import SETTINGS, ZenohTransport
from caesura_service.offline_segmentation import segment_recording
from clients.bridging import QUICK
from clients.fake_service import FakeService
from harness import ros
from harness.demonstrations import guided
from harness.processes import eventually

SENSOR = "flange_sensor"
EARLIER_S, MUCH_LATER_S = 100, 50.0  # what is repeated until it is found, and the rest counted from it
MAPPING = {
    "wrench_source": SENSOR,
    "topics": {
        "/pose": {"type": POSE, "signals": ["pos"]},
        "/ft/wrench": {"type": WRENCH, "signals": ["force"]},
    },
}


@pytest.fixture(scope="module")
def demonstration() -> Recording:
    made = guided()
    return replace(made, t=ros.in_seconds(made))


def rmw_zenoh(topic: str, kind: str) -> str:
    package, _, name = kind.split("/")
    return f"0{topic}/{package}::msg::dds_::{name}_/{ros.STORE.hash_rihs01(kind)}"


def ros2dds(topic: str, kind: str) -> str:
    return topic[1:]


LAYOUTS = {"rmw_zenoh": rmw_zenoh, "ros2dds": ros2dds}


class RosNode:
    """A node of ROS 2, as far as Zenoh sees it."""

    def __init__(self, session: zenoh.Session, layout: str) -> None:
        self._session = session
        self._layout = layout
        self._count = 0

    def put(self, topic: str, kind: str, stamp: int, message: object) -> None:
        self.put_raw(LAYOUTS[self._layout](topic, kind), ros.cdr(message, kind), stamp)

    def put_raw(self, key: str, payload: bytes, stamp: int = 0) -> None:
        self._count += 1
        attachment = None
        if self._layout == "rmw_zenoh":  # number, time, and a gid of 16 bytes behind its length: 33 bytes
            attachment = struct.pack("<qqB16s", self._count, stamp, 16, bytes(range(16)))
            assert len(attachment) == 33
        self._session.put(
            key, payload, attachment=attachment, congestion_control=zenoh.CongestionControl.BLOCK
        )


@contextmanager
def publisher(router, layout: str) -> Iterator[RosNode]:
    config = zenoh.Config()
    own = {"mode": "client", "connect/endpoints": [router.endpoint]}
    for key, value in {**SETTINGS, **own}.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield RosNode(session, layout)


@contextmanager
def opened(router, node: RosNode, first: list[ros.Message], **options) -> Iterator[Ros2Source]:
    """A source that has found its topics: what it looks for is repeated until it has."""
    found, over = threading.Event(), threading.Event()

    def repeat() -> None:
        while not found.wait(0.02):
            for message in first:
                node.put(*message)

    thread = threading.Thread(target=repeat)
    thread.start()
    try:
        source = Ros2Source(router.transport(), over=over, **options)
    finally:
        found.set()
        thread.join()
    try:
        yield source
    finally:
        source.close()


def early(messages: list[ros.Message]) -> list[ros.Message]:
    """The first message of each topic, long before: too early to be joined with the rest."""
    topics = {}
    for topic, kind, _, message in messages:
        topics.setdefault(topic, (topic, kind, message))
    return [(topic, kind, 0, _before(message)) for topic, kind, message in topics.values()]


def _before(message):
    kind = message.__msgtype__
    copy = ros.STORE.deserialize_cdr(ros.cdr(message, kind), kind)
    copy.header.stamp.sec -= EARLIER_S
    return copy


def rows_of(source: Ros2Source, node: RosNode, messages: list[ros.Message], count: int) -> np.ndarray:
    """All rows of a source once so many have come."""
    for message in messages:
        node.put(*message)
    rows, reported = [], 0
    for chunk in source.chunks():
        rows.append(chunk)
        reported += int((chunk[:, 0] > MUCH_LATER_S).sum())
        if reported >= count:
            source._over.set()
    return np.concatenate(rows)


def recording_of(source: Ros2Source, rows: np.ndarray) -> Recording:
    column = dict(zip(source.columns, rows.T, strict=True))
    pos = np.column_stack([column[name] for name in ("px", "py", "pz")])
    force = np.column_stack([column[name] for name in ("fx", "fy", "fz")])
    return Recording(column["t"] - column["t"][0], {"pos": pos, "force": force}, source.wrench_source)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_topics_of_their_own_give_the_segments_of_the_npz(router, demonstration, layout):
    messages = list(ros.sensor_topics(demonstration))
    mapped = ColumnMapping("map.toml", {**MAPPING, "up": "-z"})
    with (
        publisher(router, layout) as node,
        opened(router, node, early(messages), mapped=mapped) as source,
    ):
        rows = rows_of(source, node, messages, demonstration.t.size)
    found = recording_of(source, rows[rows[:, 0] > MUCH_LATER_S])
    assert (source.dropped, source.setting.up) == (0, (0.0, 0.0, -1.0))
    for name, values in demonstration.signals.items():
        assert np.array_equal(found.signals[name], values)
    np.testing.assert_allclose(found.t, demonstration.t, atol=1e-9)
    exact = replace(found, t=demonstration.t)
    assert segment_recording(exact).segments == segment_recording(demonstration).segments


def test_what_was_dropped_is_named_with_its_time(router, demonstration, monkeypatch):
    """Only the number of the messages was named, which part to teach again was unknown."""
    monkeypatch.setattr("caesura_clients.bridge.sources.ros2.INBOX", 16)
    messages = list(ros.franka_topic(franka_recording(demonstration, 400)))
    with publisher(router, "rmw_zenoh") as node, opened(router, node, early(messages)) as source:
        before = source.dropped
        for message in messages:
            node.put(*message)
        eventually(lambda: source.dropped - before >= len(messages) - source._inbox.capacity)
        source._over.set()  # `chunks` ends with what is still there
        times = np.concatenate(list(source.chunks()))[:, 0]
        said = re.fullmatch(r": samples are missing at (\S+)–(\S+) s", source.lost_words)
    hole = int(np.diff(times).argmax())
    assert said is not None
    assert [float(one) for one in said.groups()] == pytest.approx(times[hole : hole + 2], abs=0.02)


def test_the_newest_stretches_in_which_messages_were_lost_are_named():
    lost = LostStretches()
    assert str(lost) == ""
    rows = [0.9, 1.0, 1.1, 1.5, 2.0, 2.1]
    for dropped, (before_s, after_s) in zip([0, 2, 5, 5, 5], pairwise(rows), strict=True):
        lost.look(dropped, before_s, after_s)
    assert str(lost) == "1.00–2.00 s"
    for t in (4, 6, 8):
        lost.look(t + 2, float(t), None)
        lost.look(t + 2, float(t), t + 1.0)
    assert str(lost) == "…, 4.00–5.00 s, 6.00–7.00 s, 8.00–9.00 s"
    lost.look(99, 9.5, 9.5)
    assert str(lost).endswith("8.00–9.00 s, from 9.50 s on")


def franka_recording(demonstration: Recording, n: int) -> Recording:
    reported = {
        "pos": demonstration.signals["pos"][:n],
        "quat": np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        "q": np.ones((n, 7)),
        "force": demonstration.signals["force"][:n],
        "torque": np.full((n, 3), 0.5),
        "tau": np.ones((n, 7)),
    }
    return Recording(demonstration.t[:n], reported)


def test_franka_is_found_by_its_type_alone(router, demonstration):
    n = 60
    recording = franka_recording(demonstration, n)
    messages = list(ros.franka_topic(recording))
    messages[-1][-1].robot_mode = 3  # guiding
    with publisher(router, "rmw_zenoh") as node, opened(router, node, early(messages)) as source:
        said = (source.wrench_source, source.hand_on_robot, source.force_frame, source.can_wait)
        assert said == ("joint_torque_estimate", "unknown", "base", False)
        assert source.button_pressed is False
        rows = rows_of(source, node, messages, n)
        assert source.button_pressed is True
    column = dict(zip(source.columns, rows[rows[:, 0] > MUCH_LATER_S].T, strict=True))
    assert np.array_equal(column["pz"], recording.signals["pos"][:, 2])
    assert np.array_equal(column["fz"], recording.signals["force"][:, 2])
    assert column["mz"].tolist() == [0.5] * n
    assert column["tau7"].tolist() == [1.0] * n


def test_joints_named_as_those_of_the_stated_robot_need_no_mapping(router):
    joints = {name: (i + 1) / 10 for i, name in enumerate(reversed(robot_description("ur5e").joints))}
    messages = [
        ("/joint_states", JOINT_STATE, 0, ros.joints(ros.BEGAN_NS + i * 10**7, joints)) for i in range(60)
    ]
    with (
        publisher(router, "rmw_zenoh") as node,
        opened(router, node, early(messages), robot="ur5e") as source,
    ):
        rows = rows_of(source, node, messages, len(messages))
    assert source.columns == ("t", "q1", "q2", "q3", "q4", "q5", "q6")
    assert rows[:, 1:].tolist() == [[0.6, 0.5, 0.4, 0.3, 0.2, 0.1]] * len(rows)


def test_a_pedal_on_a_topic_marks_where_the_robot_is(router, demonstration, memory):
    messages = list(ros.sensor_topics(demonstration))[:80]
    topics = {**MAPPING["topics"], "/pedal": {"mark": True}}
    mapped = ColumnMapping("map.toml", {**MAPPING, "topics": topics})
    with (
        publisher(router, "ros2dds") as node,
        opened(router, node, early(messages), mapped=mapped) as source,
    ):
        for message in messages:
            node.put(*message)
        node.put_raw("pedal", b"")
        rows, marks = [], []
        for reported in source.chunks():
            (marks if isinstance(reported, Mark) else rows).append(reported)
            if marks:
                source._over.set()
    (mark,) = marks
    assert mark.t == np.concatenate(rows)[-1, 0]


def test_the_bridge_makes_the_marks_of_its_source(memory):
    marked = []

    class Pedal:
        columns = ("t", "px", "py", "pz")
        wrench_source, force_frame, length_unit, can_wait = "none", "base", "m", False

        def chunks(self):
            yield np.array([[0.0, 0, 0, 0], [0.1, 0, 0, 0]])
            yield Mark(0.05)
            yield np.array([[0.2, 0, 0, 0]])

    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", Pedal(), settings=QUICK) as bridge,
    ):
        bridge.mark = marked.append
        bridge.run()
    assert marked == [0.05]
    assert bridge.unmarked == []
    assert service.rows() == 3


@pytest.mark.parametrize(
    ("key", "payload", "message"),
    [
        (
            rmw_zenoh("/pose", POSE),
            b"\x00\x01\x00\x00junk",
            r"/pose: no CDR of geometry_msgs/msg/PoseStamped in 8",
        ),
        (rmw_zenoh("/pose", POSE), b"", "no CDR of .* in 0 bytes"),
        (rmw_zenoh("/pose", POSE)[:-3] + "000", b"", r"another definition there \(RIHS01_.*000\) than here"),
        ("pose", b"", r'its key does not contain its type.*\[topics."/pose"\] with type ='),
    ],
)
def test_what_cannot_be_read_names_the_topic(router, demonstration, key, payload, message):
    messages = list(ros.sensor_topics(demonstration))[:2]
    untyped = {**MAPPING, "topics": {"/pose": {}, "/ft/wrench": {"signals": ["force"]}}}
    mapped = ColumnMapping("map.toml", untyped)
    with (
        publisher(router, "rmw_zenoh") as node,
        opened(router, node, early(messages), mapped=mapped) as source,
    ):
        node.put_raw(key, payload)
        with pytest.raises(SourceError, match=message):
            list(source.chunks())


def test_no_publisher_says_what_it_listened_to(router):
    with pytest.raises(SourceError, match=r"no message of /ft/wrench, /pose within 0\.2 s; received nothing"):
        Ros2Source(router.transport(), ColumnMapping("map.toml", MAPPING), discover_s=0.2)
    with pytest.raises(SourceError, match="no message of franka_msgs/msg/FrankaRobotState or"):
        Ros2Source(router.transport(), discover_s=0.2)


def test_a_source_of_its_own_connection_is_closed(router, demonstration, monkeypatch):
    closed, close = [], ZenohTransport.close
    monkeypatch.setattr(ZenohTransport, "close", lambda self: (closed.append(self.endpoint), close(self)))
    messages = early(list(ros.sensor_topics(demonstration)))
    found = threading.Event()
    with publisher(router, "rmw_zenoh") as node:

        def repeat() -> None:
            while not found.wait(0.02):
                for message in messages:
                    node.put(*message)

        thread = threading.Thread(target=repeat)
        thread.start()
        try:
            source = open_source(
                "ros2", SourceOptions(ros=router.endpoint, wrench_source=SENSOR, hand_on_robot="no")
            )
        finally:
            found.set()
            thread.join()
    assert source.columns[:4] == ("t", "px", "py", "pz")
    assert (source.wrench_source, source.hand_on_robot) == (SENSOR, "no")
    assert closed == []
    source.close()
    assert closed == [router.endpoint]


@pytest.mark.parametrize("kind", [FRANKA_STATE, JOINT_STATE])
def test_keys_state_topic_type_and_definition(kind):
    assert parse_key(rmw_zenoh("/left/arm/state", kind)) == (
        "/left/arm/state",
        kind,
        ros.STORE.hash_rihs01(kind),
    )
    assert parse_key("left/arm/state") == ("/left/arm/state", None, None)

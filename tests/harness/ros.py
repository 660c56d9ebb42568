"""ROS 2 messages and bags made of a recording, with rosbags' own writer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin, Writer

from caesura_protocol.formats.ros_types import FRANKA_STATE, JOINT_STATE, POSE, WRENCH, typestore
from caesura_protocol.recording import Recording

STORE = typestore()
BEGAN_NS = 1_773_480_413_250_000_000
ARM = tuple(f"fr3_joint{i}" for i in range(1, 8))
FINGERS = ("fr3_finger_joint1", "fr3_finger_joint2")
Message = tuple[str, str, int, Any]  # topic, type, stamp [ns], message


def blank(name: str) -> Any:
    """A message in which everything is 0 or empty."""
    return _maker((Nodetype.NAME, name))()


@cache
def _maker(kind: Any) -> Callable[[], Any]:
    """What makes a blank value of a kind: looked up once, for a bag has thousands of messages."""
    node, what = kind
    if node == Nodetype.BASE:
        value = {"string": "", "bool": False}.get(what[0], 0.0 if "float" in what[0] else 0)
        return lambda: value
    if node == Nodetype.NAME:
        made, fields = STORE.types[what], [_maker(kind) for _, kind in STORE.fielddefs[what][1]]
        return lambda: made(*[make() for make in fields])
    inner, length = what
    if inner[0] == Nodetype.BASE and inner[1][0] != "string":
        return lambda: np.zeros(length or 0, dtype=inner[1][0])
    return lambda: [_maker(inner)() for _ in range(length or 0)]


def stamped(name: str, stamp: int, frame: str = "") -> Any:
    message = blank(name)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.header.frame_id = frame
    return message


def put_xyz(target: Any, values: Iterable[float]) -> None:
    for axis, value in zip("xyzw", values, strict=False):
        setattr(target, axis, float(value))


def pose(stamp: int, position: Any, orientation: Any = (0, 0, 0, 1), frame: str = "fr3_link0") -> Any:
    message = stamped(POSE, stamp, frame)
    put_xyz(message.pose.position, position)
    put_xyz(message.pose.orientation, orientation)
    return message


def wrench(stamp: int, force: Any, torque: Any = (0, 0, 0), frame: str = "fr3_link0") -> Any:
    message = stamped(WRENCH, stamp, frame)
    put_xyz(message.wrench.force, force)
    put_xyz(message.wrench.torque, torque)
    return message


def joints(stamp: int, by_name: Mapping[str, float]) -> Any:
    message = stamped(JOINT_STATE, stamp)
    message.name = list(by_name)
    message.position = np.array(list(by_name.values()))
    return message


def franka(stamp: int, position: Any, orientation: Any, q: Any, force: Any, torque: Any, tau: Any) -> Any:
    """As franka_ros2 has it: wrench and torques of the robot on the environment."""
    message = stamped(FRANKA_STATE, stamp, "fr3_link0")
    message.o_t_ee = pose(stamp, position, orientation)
    put_xyz(message.f_t_ee.pose.orientation, (0, 0, 0, 1))
    message.measured_joint_state.name = list(ARM)
    message.measured_joint_state.position = np.array(q, dtype=float)
    message.o_f_ext_hat_k = wrench(stamp, -np.asarray(force), -np.asarray(torque))
    message.tau_ext_hat_filtered.name = list(ARM)
    message.tau_ext_hat_filtered.effort = -np.array(tau, dtype=float)
    return message


def stamps(recording: Recording) -> list[int]:
    return [BEGAN_NS + round(t * 1e9) for t in recording.t.tolist()]


def in_seconds(recording: Recording) -> np.ndarray:
    """The times that stamps in whole nanoseconds can tell."""
    ns = np.array(stamps(recording))
    return (ns - ns[0]) / 1e9


def sensor_topics(recording: Recording) -> Iterator[Message]:
    """A pose and a wrench of their own."""
    rows = zip(stamps(recording), recording.signals["pos"], recording.signals["force"], strict=True)
    for stamp, position, force in rows:
        yield "/ft/wrench", WRENCH, stamp, wrench(stamp, force)
        yield "/pose", POSE, stamp, pose(stamp, position)


def franka_topic(recording: Recording) -> Iterator[Message]:
    """Everything in one topic."""
    signals = recording.signals
    names = ("pos", "quat", "q", "force", "torque", "tau")
    for stamp, *row in zip(stamps(recording), *(signals[name] for name in names), strict=True):
        yield "/franka_robot_state_broadcaster/robot_state", FRANKA_STATE, stamp, franka(stamp, *row)


def write_bag(path: Path, messages: Iterable[Message], storage: str) -> Path:
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as bag:
        connections: dict[str, Any] = {}
        for count, (topic, kind, _, message) in enumerate(messages):
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=STORE)
            bag.write(connections[topic], BEGAN_NS + count, cdr(message, kind))  # not when it was measured
    return path


def cdr(message: Any, kind: str) -> bytes:
    return bytes(STORE.serialize_cdr(message, kind))

"""Converts the content of ROS 2 messages to Caesura's names, units and signs.

Signs. libfranka's O_F_ext_hat_K counts forces of the robot on the environment as positive (robot_state.h:
"Forces applied by the robot to the environment are positive, while forces applied by the environment on the
robot are negative"; frankarobotics/libfranka issue 26 has the measurement), and tau_ext_hat_filtered, of
which it is the (Jᵀ)⁻¹ (issue 112 there), goes with it. Caesura's force is the environment's on the robot,
so both are negated; franka_ros2 passes them on as they are. Its moment is about the stiffness frame K, which
`ee_t_k` places on the end effector; it is moved to the flange. A WrenchStamped does not state its sign:
`force_of` in a mapping does, with the environment's force as the default.

The pose of a FrankaRobotState is that of the end effector. The message states its transform on the flange
(`f_t_ee`), which is removed. A PoseStamped counts as the flange in the base frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from caesura_protocol.flange_pose import Transform, flange_of, moved_wrench, point_in_base
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.ros_types import FRANKA_STATE, JOINT_STATE, POSE, READ, WRENCH
from caesura_protocol.formats.signal_aligner import NS
from caesura_protocol.messages import COLUMNS_OF_SIGNAL, JOINTS, JOINTS_MOST
from caesura_protocol.recording import RecordingError
from caesura_protocol.validation_words import not_one_of

Values = Mapping[str, Sequence[float]]
FORCE_OF = {"environment": 1.0, "robot": -1.0}
_ARM_JOINT = re.compile(r"(?<!finger_)joint_?([1-7])")
_BASE_FRAME = re.compile(r"(^|[_/])(base(_link)?|link0|world)$")


@dataclass(frozen=True)
class TopicRule:
    """A mapping's rule for one topic; every field is optional."""

    topic: str = ""
    type: str | None = None
    signals: tuple[str, ...] | None = None  # of all its signals, only these
    joints: tuple[str, ...] | None = None  # names of all of the arm, from the base on
    gripper: tuple[str, ...] | None = None  # names of the fingers' joints, whose positions add up
    force_of: str | None = None  # whose force on the other: environment, robot
    mark: bool = False  # every message is a mark, whatever it says
    definition: str | None = None  # the .msg file of its type


def topic_rules(mapped: ColumnMapping | None) -> dict[str, TopicRule]:
    """Return the rules of a mapping by topic. Raises RecordingError."""
    found = {} if mapped is None else mapped.section("topics")
    return {topic: _rule(mapped, topic, entry) for topic, entry in found.items() if mapped is not None}


def _rule(mapped: ColumnMapping, topic: str, entry: Any) -> TopicRule:
    where = f'[topics."{topic}"]'
    if not isinstance(entry, Mapping):
        raise mapped.error(f"{where} is {entry!r}, expected a table")
    mapped.check_keys(where, entry, [name for name in TopicRule.__dataclass_fields__ if name != "topic"])
    lists = {key: tuple(value) for key, value in entry.items() if isinstance(value, list)}
    rule = TopicRule(topic, **{**entry, **lists})
    if rule.force_of not in {None, *FORCE_OF}:
        raise mapped.error(f"{where}: force_of is {rule.force_of!r}, expected {' or '.join(FORCE_OF)}")
    if rule.type not in {None, *READ} and not rule.mark:
        raise mapped.error(not_one_of(f"{where}: type", rule.type, READ))
    if rule.joints is not None and not 1 <= len(rule.joints) <= JOINTS_MOST:
        raise mapped.error(f"{where}: joints has {len(rule.joints)} names, expected 1 to {JOINTS_MOST}")
    mapped.check_keys(f"{where} signals", rule.signals or (), COLUMNS_OF_SIGNAL)
    return rule


def definitions_of(rules: Mapping[str, TopicRule], beside: Path | None = None) -> list[tuple[str, str]]:
    """Return the message definitions that rules name: (type, .msg text). Raises RecordingError."""
    found = []
    for rule in rules.values():
        if rule.definition is not None and rule.type is not None:
            where = Path(rule.definition)
            where = where if where.is_absolute() or beside is None else beside.parent / where
            try:
                found.append((rule.type, where.read_text(encoding="utf-8")))
            except OSError as error:
                raise RecordingError(f"{rule.topic}: definition {where}: {error.strerror}") from error
    return found


def stamp_of(message: Any, where: str) -> int:
    """Return the header's stamp [ns]. Raises RecordingError if it was never set."""
    stamp = message.header.stamp
    if not (stamp.sec or stamp.nanosec):
        raise RecordingError(f"{where}: its header has no time stamp, without which samples have no time")
    return int(stamp.sec) * NS + int(stamp.nanosec)


def values_of(message_type: str, message: Any, rule: TopicRule) -> Values:
    """Return the values of a message, by signal. Raises RecordingError if joints are missing."""
    reported = _READERS[message_type](message, rule)
    return reported if rule.signals is None else {s: reported[s] for s in rule.signals if s in reported}


def frame_of(message_type: str, message: Any) -> str | None:
    """Return the frame of a message's forces; None if it is unknown.

    It is `base` for a FrankaRobotState, and if the header's frame_id names a base frame.
    """
    if message_type == FRANKA_STATE:
        return "base"
    name = str(message.header.frame_id)
    return "base" if _BASE_FRAME.search(name) else None


def _franka_state(message: Any, rule: TopicRule) -> Values:
    sign = FORCE_OF[rule.force_of or "robot"]
    effector = _pose(message.o_t_ee.pose)
    flange = flange_of(effector, _pose(message.f_t_ee.pose))
    stiffness = point_in_base(effector, _pose(message.ee_t_k.pose).position)
    at_stiffness = _wrench(message.o_f_ext_hat_k.wrench, sign)
    wrench = moved_wrench([*at_stiffness["force"], *at_stiffness["torque"]], stiffness, flange.position)
    torques = message.tau_ext_hat_filtered
    return {
        "pos": flange.position,
        "quat": flange.orientation,
        "q": _joints(message.measured_joint_state, rule),
        "force": wrench[:3],
        "torque": wrench[3:],
        "tau": [sign * value for value in _in_order(torques.name, torques.effort, rule)],
    }


def _wrench_stamped(message: Any, rule: TopicRule) -> Values:
    return _wrench(message.wrench, FORCE_OF[rule.force_of or "environment"])


def _joint_state(message: Any, rule: TopicRule) -> Values:
    reported: dict[str, Sequence[float]] = {}
    if _wanted("q", rule) and _has_arm(message, rule):
        reported["q"] = _joints(message, rule)
    fingers = _fingers(message, rule)
    if fingers:
        reported["gripper"] = (sum(fingers) * (2.0 if len(fingers) == 1 else 1.0),)
    return reported


def _wanted(signal: str, rule: TopicRule) -> bool:
    return rule.signals is None or signal in rule.signals


def _has_arm(message: Any, rule: TopicRule) -> bool:
    """Return whether a message has joints of the arm.

    Other nodes of the topic may publish those of the gripper alone.
    """
    if rule.joints is not None:
        return any(name in rule.joints for name in message.name)
    return any(_arm_joint(name) for name in message.name)


def _pose_stamped(message: Any, rule: TopicRule) -> Values:
    pose = _pose(message.pose)
    return {"pos": pose.position, "quat": pose.orientation}


_READERS: Mapping[str, Callable[[Any, TopicRule], Values]] = {
    FRANKA_STATE: _franka_state,
    WRENCH: _wrench_stamped,
    JOINT_STATE: _joint_state,
    POSE: _pose_stamped,
}


def _pose(pose: Any) -> Transform:
    p, o = pose.position, pose.orientation
    return Transform((p.x, p.y, p.z), (o.x, o.y, o.z, o.w))


def _wrench(wrench: Any, sign: float) -> dict[str, Sequence[float]]:
    f, m = wrench.force, wrench.torque
    return {
        "force": (sign * f.x, sign * f.y, sign * f.z),
        "torque": (sign * m.x, sign * m.y, sign * m.z),
    }


def _joints(message: Any, rule: TopicRule) -> Sequence[float]:
    return _in_order(message.name, message.position, rule)


def _arm_joint(name: str) -> int | None:
    found = None if "finger" in name else _ARM_JOINT.search(name)
    return None if found is None else int(found[1])


def _in_order(names: Sequence[str], values: Sequence[float], rule: TopicRule) -> list[float]:
    """Return the joints, from the base on: by the rule's names, or seven by the numbers in their names."""
    if not names and len(values) == (JOINTS if rule.joints is None else len(rule.joints)):
        return [float(value) for value in values]
    by_name = dict(zip(names, values, strict=True)) if len(names) == len(values) else {}
    if rule.joints is not None:
        joint_names = list(rule.joints)
    else:
        numbered = [(number, name) for name in by_name if (number := _arm_joint(name)) is not None]
        joint_names = [name for _, name in sorted(numbered)]
        if [number for number, _ in sorted(numbered)] != list(range(1, JOINTS + 1)):
            joint_names = []
    missing = [name for name in joint_names if name not in by_name]
    if not joint_names or missing:
        what = f"no joint {missing[0]!r}" if missing else f"joints that are not one arm's 1 to {JOINTS}"
        raise RecordingError(
            f"{rule.topic}: {what}; it has {', '.join(names) or 'none'} with {len(values)} values: "
            "name all of the arm, from the base on, as joints in a mapping"
        )
    return [float(by_name[name]) for name in joint_names]


def _fingers(message: Any, rule: TopicRule) -> list[float]:
    joint_names = rule.gripper or [name for name in message.name if "finger" in name]
    by_name = dict(zip(message.name, message.position, strict=False))
    if rule.gripper and not set(joint_names) <= by_name.keys():
        return []
    return [float(by_name[name]) for name in joint_names if name in by_name]

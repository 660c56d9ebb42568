"""Selects the topic of each signal, by type or by a mapping.

Of two topics with the same signal the better one is selected (`_RANK`): a sensor's wrench before the robot's
estimate, the robot's complete state before joints and poses from other nodes. Two of the same type are an
error that names both, because only the user can choose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from caesura_protocol.columns import JOINT_SIGNALS
from caesura_protocol.formats.mapping_file_read import ColumnMapping
from caesura_protocol.formats.ros_messages import TopicRule, Values, frame_of, values_of
from caesura_protocol.formats.ros_types import FRANKA_STATE, JOINT_STATE, POSE, WRENCH
from caesura_protocol.formats.unvalidated_recording import UserStatements
from caesura_protocol.messages import ESTIMATE, JOINTS
from caesura_protocol.recording import RecordingError
from caesura_protocol.robots import robot_description

_RANK = {FRANKA_STATE: 3, POSE: 2, JOINT_STATE: 1, WRENCH: 4}


class Topic(NamedTuple):
    """Topic whose messages are read."""

    name: str
    type: str
    rule: TopicRule


@dataclass(frozen=True)
class TopicSelection:
    """Topic of each signal, and the options of the recording."""

    topic_of: Mapping[str, str]  # by signal
    options: Mapping[str, str]  # of the recording
    joints: int = JOINTS  # of the arm

    @property
    def signals(self) -> tuple[str, ...]:
        """Return the names of the signals in a row."""
        return tuple(self.topic_of)

    def select_values(self, topic: Topic, message: Any) -> Values:
        """Return the selected values of a message, by signal."""
        reported = values_of(topic.type, message, topic.rule)
        return {s: values for s, values in reported.items() if self.topic_of.get(s) == topic.name}


def with_arm_joints(
    messages: Sequence[tuple[Topic, Any]], mapped: ColumnMapping | None, stated: UserStatements
) -> list[tuple[Topic, Any]]:
    """Return the messages; the rule of a topic that has every joint of the stated arm names these joints.

    The arm is the user's, or else the mapping's. A rule that names joints stays. Raises RobotError for an
    unknown arm.
    """
    robot = stated.robot or ({} if mapped is None else mapped.options).get("robot")
    if robot is None:
        return list(messages)
    joints = robot_description(robot).joints
    named = {
        topic.name: topic._replace(rule=replace(topic.rule, joints=joints))
        for topic, message in messages
        if topic.type == JOINT_STATE and topic.rule.joints is None and {*joints} <= {*message.name}
    }
    return [(named.get(topic.name, topic), message) for topic, message in messages]


def select_topics(
    messages: Sequence[tuple[Topic, Any]], mapped: ColumnMapping | None, stated: UserStatements
) -> TopicSelection:
    """Select the topics and signals by some first messages of every topic. Raises RecordingError."""
    topics = {topic.name: topic for topic, _ in messages}
    reported: dict[str, set[str]] = {}
    for topic, message in messages:
        for signal in values_of(topic.type, message, topic.rule):
            reported.setdefault(signal, set()).add(topic.name)
    topic_of = {signal: _best(signal, names, topics) for signal, names in reported.items()}
    if not {"pos", "q"} & topic_of.keys():
        for topic, message in messages:
            if topic.type == JOINT_STATE and topic.rule.joints is None and len(message.name):
                raise RecordingError(
                    f"{topic.name}: which of its joints are the arm's? It has {', '.join(message.name)}. "
                    "State the arm with --robot; if its description has other names, name all of the arm, "
                    f'from the base on, as joints below [topics."{topic.name}"] in a mapping too'
                )
        raise RecordingError(
            f"no topic carries the pose or the joints of the robot; "
            f"there are {_listed(topics.values())}, expected one of {FRANKA_STATE}, {POSE}, {JOINT_STATE}"
        )
    if "pos" in topic_of and topic_of.get("quat") not in {None, topic_of["pos"]}:
        del topic_of["quat"]
    rules = (topics[name].rule.joints for name in map(topic_of.get, JOINT_SIGNALS) if name is not None)
    joints = next((len(names) for names in rules if names is not None), JOINTS)
    return TopicSelection(topic_of, _options(topic_of, messages, mapped, stated), joints)


def _best(signal: str, names: set[str], topics: Mapping[str, Topic]) -> str:
    ranked = sorted(names, key=lambda name: _RANK[topics[name].type], reverse=True)
    best = [name for name in ranked if _RANK[topics[name].type] == _RANK[topics[ranked[0]].type]]
    if len(best) > 1:
        raise RecordingError(
            f"{' and '.join(sorted(best))} both carry {signal}: name the one that is meant in a mapping, "
            f'for example [topics."{min(best)}"]'
        )
    return best[0]


def _options(
    topic_of: Mapping[str, str],
    messages: Sequence[tuple[Topic, Any]],
    mapped: ColumnMapping | None,
    stated: UserStatements,
) -> dict[str, str]:
    said = {} if mapped is None else mapped.options
    of = topic_of.get("force") or topic_of.get("tau")
    if of is None:
        return {"wrench_source": "none", **said}
    topic, message = next((topic, message) for topic, message in messages if topic.name == of)
    return {
        **{key: said[key] for key in ("hand_on_robot", "robot", "up") if key in said},
        "wrench_source": said.get("wrench_source") or stated.wrench_source or _source_of(topic),
        "force_frame": said.get("force_frame") or _frame_of(topic, message, stated.force_frame),
    }


def _source_of(topic: Topic) -> str:
    if topic.type == FRANKA_STATE:
        return ESTIMATE
    raise RecordingError(
        f"{topic.name}: where is this wrench measured? State wrench_source in a mapping or --wrench-source: "
        "flange_sensor, flange_sensor_with_hand or joint_torque_estimate"
    )


def _frame_of(topic: Topic, message: Any, stated: str | None) -> str:
    frame = frame_of(topic.type, message) or stated
    if frame is None:
        raise RecordingError(
            f"{topic.name}: is the frame {message.header.frame_id!r} that of the flange or that of the base? "
            "State force_frame in a mapping or --force-frame: base or flange"
        )
    return frame


def _listed(topics: Any) -> str:
    return ", ".join(f"{topic.name} ({topic.type})" for topic in topics) or "none"

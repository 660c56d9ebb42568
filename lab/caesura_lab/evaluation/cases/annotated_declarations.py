"""The declarations of a session for a recording: those that it states, else those of its annotation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from caesura_lab.ground_truth import Truth
from caesura_protocol.recording import Recording

WITH_HAND = "flange_sensor_with_hand"


def with_annotated_declarations(recording: Recording, truth: Truth) -> Recording:
    """Add the annotation's declarations on wrench and hand if the recording states none.

    An annotation with the hand in the wrench turns `flange_sensor`, stated or not, into
    `flange_sensor_with_hand`. An annotation without the hand in the wrench declares `flange_sensor` if no
    source is stated, and that no hand is on the robot if the wrench is an estimate.
    """
    source: str | None = recording.wrench_source or truth.wrench_source
    hand: str = recording.hand_on_robot
    if hand == "unknown" and truth.hand_on_robot is not None:
        hand = truth.hand_on_robot
    if truth.hand_in_wrench and source in {None, "flange_sensor"}:
        source = WITH_HAND
    elif truth.hand_in_wrench is False and source is None:
        source = "flange_sensor"
    elif truth.hand_in_wrench is False and source == "joint_torque_estimate" and hand == "unknown":
        hand = "no"
    declared: dict[str, Any] = {"wrench_source": source, "hand_on_robot": hand}
    return replace(recording, **declared)

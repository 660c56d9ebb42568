"""Wrench sources in words, as the form of a recording and the line of a session state them."""

from __future__ import annotations

from collections.abc import Mapping

from caesura_protocol.messages import WrenchReport, WrenchSource

WRENCH_SOURCE_WORDS: Mapping[WrenchSource, str] = {
    "flange_sensor": "a sensor that the guiding hand does not touch",
    "flange_sensor_with_hand": "a sensor that measures the hand too",
    "joint_torque_estimate": "estimated from joint torques",
    "none": "there is no wrench",
}


def wrench_words(wrench: WrenchReport) -> str:
    """Return text on the wrench source in use; the program's notes state the consequences."""
    return f"wrench: {WRENCH_SOURCE_WORDS[wrench.source]}{'' if wrench.stated else ' (assumed)'}"

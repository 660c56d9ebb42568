"""The models that a wrench supports, by the place of its measurement and by whether a hand is on the robot.

A sensor below the guiding hand measures the environment alone. A sensor above it measures the hand as well.
An estimate from joint torques contains the force of a hand, if there is one, and the error of the robot's
model. A session states its source and the hand; without a statement the conservative source is assumed, and
the note states "assumed".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

FORCE_FRAMES = ("base", "flange")
WRENCH_SOURCES = ("flange_sensor", "flange_sensor_with_hand", "joint_torque_estimate", "none")
HANDS_ON_ROBOT = ("yes", "no", "unknown")

ASSUMED = "assumed: the recording does not state its wrench source"
ASSUMED_NONE = "assumed: no wrench source is stated and there are no force columns"
STATE_IT = "State the wrench source."


@dataclass(frozen=True)
class WrenchCapabilities:
    """The models that a wrench supports, and the way in which its bias is estimated."""

    contact_models: bool  # can contact and free space be distinguished?
    transport_models: bool  # can a load be weighed?
    noise_n: float  # [N] scale of the static noise on each axis
    tare_speed_m_per_s: float  # up to which the force at the start is taken for bias
    bias: Literal["tare", "mixture"]  # taken once at the start, or tracked by the causal mixture
    reason: str  # the source in use and what it measures, for operators
    advice: str = ""  # a further sentence for operators
    limiting_preset: str = ""  # the preset that lacks a model which the wrench supports
    up: str = ""  # the stated direction away from gravity, in words; "" where the base's z axis is assumed

    def with_preset(self, name: str, *, contact: bool, load: bool) -> WrenchCapabilities:
        """Return the capabilities without those for which the preset has no model.

        contact, load: whether the preset has models of contact and load.
        """
        if not self.contact_models or (contact and load):
            return self
        return replace(self, contact_models=contact, transport_models=load, limiting_preset=name)

    @property
    def note(self) -> str:
        """The source in use and which models are on, in a sentence or two for operators."""
        states: dict[str, list[str]] = {"on": [], "off": []}
        for name, is_on in (("contact", self.contact_models), ("load", self.transport_models)):
            states["on" if is_on else "off"].append(name)
        found = ", ".join(
            f"{' and '.join(names)} {'are' if len(names) > 1 else 'is'} {state}"
            for state, names in states.items()
            if names
        )
        if self.transport_models:
            found += f", with {self.up} upwards" if self.up else ", for a base whose z axis points up"
        if self.limiting_preset:
            found += f": preset {self.limiting_preset} has no model of {' or '.join(states['off'])}"
        return f"{self.reason}; {found}. {self.advice}".rstrip()


@lru_cache
def wrench_capabilities(source: str, hand_on_robot: str, *, stated: bool) -> WrenchCapabilities:
    """Return the capabilities of a wrench from `source`, with or without a hand on the robot.

    source: one of WRENCH_SOURCES; hand_on_robot: one of HANDS_ON_ROBOT; stated: False where the source is an
    assumption (`assumed_source`): contact and load are then off. Raises ValueError for an unknown value, and
    where a stated source contradicts the statement of the hand.
    """
    _check(source, hand_on_robot, stated=stated)
    found = _OF_ESTIMATE[hand_on_robot] if source == "joint_torque_estimate" else _CAPABILITIES[source]
    if stated:
        return replace(found, reason=f"Wrench source {source}: {found.reason}")
    reason, advice = (ASSUMED_NONE, "") if source == "none" else (ASSUMED, STATE_IT)
    return replace(
        found,
        contact_models=False,
        transport_models=False,
        bias="tare",
        reason=f"Wrench source {source}, {reason}",
        advice=advice,
    )


def assumed_source(*, has_force: bool) -> str:
    """Return the conservative source of a wrench without a statement: it may contain the guiding hand."""
    return "flange_sensor_with_hand" if has_force else "none"


def _check(source: str, hand_on_robot: str, *, stated: bool) -> None:
    if source not in WRENCH_SOURCES:
        raise ValueError(f"wrench_source is {source!r}, expected one of {', '.join(WRENCH_SOURCES)}")
    if hand_on_robot not in HANDS_ON_ROBOT:
        raise ValueError(f"hand_on_robot is {hand_on_robot!r}, expected one of {', '.join(HANDS_ON_ROBOT)}")
    if stated and source == "flange_sensor_with_hand" and hand_on_robot == "no":
        raise ValueError(
            "hand_on_robot is 'no', which contradicts wrench_source 'flange_sensor_with_hand': expected "
            "hand_on_robot 'yes' or 'unknown', or wrench_source 'flange_sensor' or 'joint_torque_estimate'"
        )


_FLANGE_SENSOR = WrenchCapabilities(
    contact_models=True,
    transport_models=True,
    noise_n=0.2,
    tare_speed_m_per_s=0.25,  # slower movement does not show in the force
    bias="tare",
    reason="the sensor measures the environment, not the guiding hand",
)
_WITH_HAND = WrenchCapabilities(
    contact_models=False,
    transport_models=False,
    noise_n=0.2,
    tare_speed_m_per_s=0.01,
    bias="tare",
    reason="the guiding hand is in the force",
)
_ESTIMATE = WrenchCapabilities(
    contact_models=False,
    transport_models=False,
    noise_n=0.5,
    tare_speed_m_per_s=0.01,
    bias="tare",
    reason="the guiding hand and about 3 N of model error are in the estimate",
)
_NONE = replace(_WITH_HAND, noise_n=0.0, reason="no force is used")

_CAPABILITIES = {
    "flange_sensor": _FLANGE_SENSOR,
    "flange_sensor_with_hand": _WITH_HAND,
    "none": _NONE,
}
_OF_ESTIMATE = {
    "yes": _ESTIMATE,
    "unknown": replace(
        _ESTIMATE,
        reason="a hand may be on the robot, and its force in the estimate",
        advice="If there is none, state that.",
    ),
    "no": replace(
        _ESTIMATE,
        contact_models=True,
        transport_models=True,
        bias="mixture",
        reason="no hand is on the robot, and the bias of the estimate is tracked",
    ),
}

"""What a wrench is worth, by where it is measured.

A force reading differs by where it is taken: below the hand that guides, it is the environment's alone;
above, the guiding hand is in it; from joint torques, so is the error of the robot's model. The table says
what follows. Nothing here guesses: a session declares its source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

FORCE_FRAMES = ("base", "flange")


@dataclass(frozen=True)
class WrenchSource:
    """What a kind of wrench can carry."""

    contact_models: bool  # can contact and free space be told apart?
    transport_models: bool  # can a load be weighed?
    noise_n: float  # [N] scale of the static noise on each axis
    tare_speed_m_per_s: float  # up to which the force at the start is taken for bias
    note: str  # for whoever reads the results


WRENCH_SOURCES: Mapping[str, WrenchSource] = {
    "flange_sensor": WrenchSource(
        contact_models=True,
        transport_models=True,
        noise_n=0.2,
        tare_speed_m_per_s=0.25,  # it feels no movement as slow as this
        note="Force sensor below the guiding hand: it feels the environment only.",
    ),
    "flange_sensor_with_hand": WrenchSource(
        contact_models=False,
        transport_models=False,
        noise_n=0.2,
        tare_speed_m_per_s=0.01,
        note="The guiding hand is in the force: contact and load cannot be told from it and stay off.",
    ),
    "joint_torque_estimate": WrenchSource(
        contact_models=False,
        transport_models=False,
        noise_n=0.5,
        tare_speed_m_per_s=0.01,
        note="Force estimated from joint torques: the guiding hand and 3 N of model error in motion "
        "are in it; contact and load are off.",
    ),
    "none": WrenchSource(
        contact_models=False,
        transport_models=False,
        noise_n=0.0,
        tare_speed_m_per_s=0.01,
        note="No force was recorded: contact and load are off.",
    ),
}

"""What the core takes of samples is what readers of files and `doctor` expect of it."""

from __future__ import annotations

from caesura_protocol import sample_limits
from caesura_service.constants import TARED_BIAS_N
from caesura_service.signals import grid_resampler, sample_layout
from caesura_service.signals.conditioning import ConditioningParameters


def test_the_core_and_the_protocol_have_the_same_limits():
    parameters = ConditioningParameters()
    assert {
        "LATEST_S": sample_layout.LIMITS["t"][0],
        "HOLD_S": parameters.hold_limit_s,
        "HOLE_S": parameters.gap_limit_s,
        "LEAP_S": grid_resampler.LEAP_LIMIT_S,
        "TARE_S": parameters.tare_window_s,
        "WIDEST_M": sample_layout.LIMITS["gripper"][0],
        "NORM_TOLERANCE": sample_layout.QUATERNION_NORM_TOLERANCE,
        "TARED_BIAS_N": TARED_BIAS_N,
    } == {name: value for name, value in vars(sample_limits).items() if name.isupper()}

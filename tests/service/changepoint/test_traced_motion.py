"""Lines that are traced slowly, while the tool sticks and slips."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.recording import Recording, WrenchSource
from harness.segmentations import segmented

LINE_S, REST_S, HZ = 5.0, 1.0, 500.0
LINES = 3
APPROACH_S, RAMP_S, PRESS_N, FRICTION = 1.0, 0.1, 8.0, 0.3


def traced_lines(mean_m_per_s: float, slips_hz: float) -> tuple[Recording, list[float]]:
    """Lines along a square, with a rest after each; the boundaries between lines and rests [s].

    The speed varies between 0 and twice its mean, with so many slips a second.
    """
    t = np.arange(0.0, LINE_S, 1.0 / HZ)
    way = mean_m_per_s * (t - np.sin(2.0 * np.pi * slips_hz * t) / (2.0 * np.pi * slips_hz))
    rest = np.zeros((round(REST_S * HZ), 3))
    parts, place, boundaries, now = [rest], np.zeros(3), list[float](), REST_S
    for angle in 0.5 * np.pi * np.arange(LINES):
        line = place + np.outer(way, [np.cos(angle), np.sin(angle), 0.0])
        place = line[-1]
        parts += [line, rest + place]
        boundaries += [now, now + LINE_S]
        now += LINE_S + REST_S
    pos = np.concatenate(parts)
    pos += np.random.default_rng(0).normal(0.0, 1e-5, pos.shape)
    return Recording(t=np.arange(len(pos)) / HZ, signals={"pos": pos}), boundaries


@pytest.mark.parametrize("mean_m_per_s", [0.008, 0.01, 0.015])
@pytest.mark.parametrize("slips_hz", [3.0, 3.7])
def test_a_line_along_which_a_tool_sticks_and_slips_is_one_movement(mean_m_per_s: float, slips_hz: float):
    """Such a line was one rest with the rests beside it, or many short movements."""
    recording, boundaries = traced_lines(mean_m_per_s, slips_hz)
    found = segmented(recording, "default").segments
    kinds = [segment.kind for segment in found]
    assert kinds == ["steady", *["motion", "steady"] * LINES]
    np.testing.assert_allclose([segment.t0 for segment in found[1:]], boundaries, atol=0.35)
    less = segmented(recording, "without_traced_motion").segments
    assert [segment.kind for segment in less] != kinds


def traced_in_contact(mean_m_per_s: float, slips_hz: float, source: WrenchSource) -> Recording:
    """The same lines pressed on a surface, after an approach and before a retreat.

    Friction opposes each line. No hand is on a robot whose wrench is estimated.
    """
    lines, boundaries = traced_lines(mean_m_per_s, slips_hz)
    pos = lines.signals["pos"]
    t = np.arange(0.0, APPROACH_S, 1.0 / HZ)
    share = t / APPROACH_S
    height = 0.1 * (1.0 - (10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5))
    approach, rest = np.outer(height, [0.0, 0.0, 1.0]), np.zeros((round(REST_S * HZ), 3))
    begin = REST_S + APPROACH_S
    every = [rest + approach[0], approach, pos, pos[-1] + approach[::-1], pos[-1] + approach[0] + rest]
    path = np.concatenate(every)
    now = np.arange(len(path)) / HZ
    end = begin + len(pos) / HZ
    pressed = PRESS_N * np.clip(np.minimum(now - begin, end + RAMP_S - now) / RAMP_S, 0.0, 1.0)
    force = np.outer(pressed, [0.0, 0.0, 1.0])
    for i, angle in enumerate(0.5 * np.pi * np.arange(LINES)):
        inside = (now >= begin + boundaries[2 * i]) & (now < begin + boundaries[2 * i + 1])
        slip = 1.0 + FRICTION * np.sin(2.0 * np.pi * slips_hz * now[inside])
        force[inside, :2] -= FRICTION * PRESS_N * np.outer(slip, [np.cos(angle), np.sin(angle)])
    force += np.random.default_rng(1).normal(0.0, 0.3, force.shape)
    return Recording(
        t=now,
        signals={"pos": path, "force": force},
        wrench_source=source,
        hand_on_robot="no" if source == "joint_torque_estimate" else "yes",
    )


@pytest.mark.slow
@pytest.mark.parametrize("source", ["joint_torque_estimate", "flange_sensor"])
@pytest.mark.parametrize("mean_m_per_s", [0.01, 0.02])
@pytest.mark.parametrize("slips_hz", [3.0, 4.0])
def test_a_line_that_sticks_and_slips_in_contact_slides(
    mean_m_per_s: float, slips_hz: float, source: WrenchSource
):
    """An arm that is driven from afar lost all three lines in one contact."""
    found = segmented(traced_in_contact(mean_m_per_s, slips_hz, source), "default").segments
    kinds = [segment.kind for segment in found]
    assert kinds == ["steady", "motion", "contact", *["sliding", "contact"] * LINES, "motion", "steady"]

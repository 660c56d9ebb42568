"""Lines that are traced slowly, while the tool sticks and slips."""

from __future__ import annotations

import numpy as np
import pytest

from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import segment_recording

LINE_S, REST_S, HZ = 5.0, 1.0, 500.0
LINES = 3


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
    found = segment_recording(recording, "default").segments
    kinds = [segment.kind for segment in found]
    assert kinds == ["steady", *["motion", "steady"] * LINES]
    np.testing.assert_allclose([segment.t0 for segment in found[1:]], boundaries, atol=0.35)
    less = segment_recording(recording, "without_traced_motion").segments
    assert [segment.kind for segment in less] != kinds

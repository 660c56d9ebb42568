"""Results do not depend on where the base is, when a clock began, which units are used, or a tool's axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import Recording
from caesura_service.segmentation.pipeline_interface import PipelineView
from harness.segmentations import segmented

DATA = Path(__file__).parents[3] / "data"
A_DAY_S = 86400.0


@cache
def recorded(name: str) -> Recording:
    """A recording of poses alone: joints would state the place of the base again."""
    recording = load_recording(DATA / f"{name}.npz")
    return replace(recording, signals={k: v for k, v in recording.signals.items() if k != "q"})


def changed(recording: Recording, signal: str, values: np.ndarray, **also: object) -> Recording:
    return replace(recording, signals={**recording.signals, signal: values}, **also)


def elsewhere(recording: Recording) -> Recording:
    return changed(recording, "pos", recording.signals["pos"] + (0.7, -1.1, 0.4))


def a_day_later(recording: Recording) -> Recording:
    return replace(recording, t=recording.t + A_DAY_S)


def in_millimetres(recording: Recording) -> Recording:
    return changed(recording, "pos", 1000.0 * recording.signals["pos"], length_unit="mm")


def with_other_tool_axes(recording: Recording) -> Recording:
    """The flange's axes are turned by a constant rotation; wrench and position are of the base's axes."""
    turned = Rotation.from_quat(recording.signals["quat"]) * Rotation.from_rotvec((0.4, -1.0, 2.0))
    return changed(recording, "quat", turned.as_quat())


def said(view: PipelineView, begun_s: float = 0.0) -> tuple[list[str], list[float], list[float]]:
    changepoints = view.changepoints
    return (
        [segment.kind for segment in view.segments],
        [changepoint.t - begun_s for changepoint in changepoints],
        [changepoint.probability for changepoint in changepoints],
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pick_and_place", "wiping"])
@pytest.mark.parametrize(
    "change", [elsewhere, a_day_later, in_millimetres, with_other_tool_axes], ids=lambda one: one.__name__
)
def test_the_segments_are_the_same(change: Callable[[Recording], Recording], name: str) -> None:
    recording = recorded(name)
    kinds, times, probabilities = said(segmented(recording))
    other = change(recording)
    again = said(segmented(other), float(other.t[0] - recording.t[0]))
    assert len(times) > 5
    assert again[0] == kinds
    assert again[1] == pytest.approx(times, abs=1e-6)
    assert again[2] == pytest.approx(probabilities, abs=1e-4)

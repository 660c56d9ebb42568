"""The reproduced path of each movement against every sample of its demonstration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from caesura_protocol.formats.read import load_recording
from caesura_protocol.reproduced_path import TOLERANCE_M, curve_of
from caesura_service.program import Paths
from harness.segmentations import segmented

DATA = Path(__file__).parents[3] / "data"
SAMPLED_M = 1e-4  # a hand moves off the curve between two observations


@pytest.mark.parametrize("name", ["pick_and_place", "dispenser", "three_point", "parkour"])
def test_a_path_uses_half_of_its_tolerance(name: str) -> None:
    recording = load_recording(DATA / f"{name}.npz")
    paths = [app for app in segmented(recording).apps if app.path is not None]
    furthest_m = []
    for app in paths:
        assert app.path is not None
        inside = (recording.t >= app.path.start.t) & (recording.t <= app.path.tn)
        shown, reproduced = recording.signals["pos"][inside], curve_of(app).sampled(200)[:, :3]
        furthest_m += [cKDTree(a).query(b)[0].max() for a, b in ((shown, reproduced), (reproduced, shown))]
        assert app.path.deviation_m <= 0.5 * TOLERANCE_M == 0.5 * app.path.tolerance_m
    assert max(furthest_m) <= 0.5 * TOLERANCE_M + SAMPLED_M
    assert max(furthest_m) > 0.2 * TOLERANCE_M, "a path leads through fewer places than it was seen at"


def poses_between(t0: float, tn: float) -> tuple[Any, Any]:
    times = np.arange(round(10 * t0), round(10 * tn) + 1) / 10.0
    return times, np.column_stack([times, 0.0 * times, 0.0 * times])


def test_between_two_times_near_one_observation_there_is_no_path() -> None:
    """A tool that hits, bounces and lands ends Move To Contact at the first observation of its movement."""
    paths = Paths(poses_between)
    assert paths.between(15.26, 15.34) is None
    path = paths.between(15.26, 15.36)
    assert path is not None
    assert (path.start.t, path.tn) == (15.3, 15.4)


def test_a_speed_that_is_not_settled_any_more_is_not_known() -> None:
    """Segments may merge again. A program that was made anew then had none, and the one that grew had one."""
    paths = Paths(poses_between, settled_until=2.0)
    assert paths.speeds_at(1.0) == pytest.approx((1.0, 0.0))
    paths.settled_until = 0.5
    assert paths.speeds_at(1.0) is None

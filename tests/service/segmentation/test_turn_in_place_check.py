"""Movements that the rotation explains are turns in place, and other movements are not."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from caesura_protocol.recording import Recording
from caesura_service.constants import TURN_SHARE
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.screw_motion_fit import Course
from caesura_service.segmentation.turn_in_place_check import is_turn_in_place, sway_of

Array = NDArray[np.float64]

DURATION_S = 2.0
LEVER = np.array([0.02, -0.03, 0.09])  # 9.7 cm from the centre


def smooth(count: int) -> Array:
    """(n,) from 0 to 1 by minimum jerk."""
    s = np.linspace(0.0, 1.0, count)
    rise: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return rise


def turn(
    angle: float = 1.5, sway_m: float = 0.0, lever: float = 1.0, shift_m: float = 0.0, count: int = 21
) -> Course:
    """A turn about the vertical.

    sway_m: by how much the centre leaves its place and returns; lever: times `LEVER`; shift_m: by how much
    the centre goes along the axis. A shift across the axis would be a turn about another centre.
    """
    share = smooth(count)
    turned = angle * share[:, None] * np.array([0.0, 0.0, 1.0])
    centre = np.zeros((count, 3))
    centre[:, 0], centre[:, 2] = sway_m * np.sin(np.pi * share), shift_m * share
    rotations = Rotation.from_rotvec(turned)
    positions = centre + rotations.apply(lever * LEVER)
    return Course(positions, rotations.as_quat(), turned, np.zeros((count, 3)), None)


def is_turn(course: Course, duration_s: float = DURATION_S) -> bool:
    return is_turn_in_place(course, duration_s, TURN_SHARE)


@pytest.mark.parametrize("sway_m", [0.0, 0.005, 0.01])
def test_a_turn_whose_centre_sways_by_millimetres_is_a_turn_in_place(sway_m: float) -> None:
    assert is_turn(turn(sway_m=sway_m))


def test_a_turn_about_the_reported_point_itself_is_a_turn_in_place() -> None:
    assert is_turn(turn(lever=0.0, sway_m=0.003))


@pytest.mark.parametrize(
    "course",
    [
        pytest.param(turn(shift_m=0.08), id="the centre goes along the axis"),
        pytest.param(turn(sway_m=0.05), id="the centre sways by centimetres"),
        pytest.param(turn(lever=5.0), id="an arc about a far centre"),
        pytest.param(turn(angle=0.15), id="no faster than a rest may turn"),
        pytest.param(turn(angle=0.0, shift_m=0.1), id="no rotation"),
        pytest.param(turn(count=3), id="three poses"),
    ],
)
def test_what_a_rotation_does_not_explain_is_a_movement(course: Course) -> None:
    assert not is_turn(course)


def test_the_sway_is_what_the_centre_does() -> None:
    """A centre beside the true one takes up some of a sway, and nothing where there is none."""
    course, share = turn(sway_m=0.004), smooth(21)
    expected = np.diff(0.004 * np.sin(np.pi * share))
    found = sway_of(course, np.diff(course.positions, axis=0))
    assert np.abs(found - expected[:, None] * [1.0, 0.0, 0.0]).max() < 0.0007
    still = turn()
    assert np.abs(sway_of(still, np.diff(still.positions, axis=0))).max() < 1e-5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_neither_base_frame_nor_tool_frame_matters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    base, tool = Rotation.random(rng=rng), Rotation.random(rng=rng)
    course = turn(sway_m=0.01)
    moved = Course(
        base.apply(course.positions) + rng.normal(size=3),
        (base * Rotation.from_quat(course.orientations) * tool).as_quat(),
        base.apply(course.turned),
        course.forces,
        None,
    )
    steps, moved_steps = (np.diff(one.positions, axis=0) for one in (course, moved))
    assert np.abs(sway_of(moved, moved_steps) - base.apply(sway_of(course, steps))).max() < 1e-9


def swaying_recording(*, orientation: bool = True) -> Recording:
    """A rest, a turn whose centre sways by 12 mm, and a rest, at 100 Hz."""
    rate_hz, rest = 100, 150
    course = turn(angle=1.6, sway_m=0.012, count=200)
    rng = np.random.default_rng(0)
    held = [np.pad(values, ((rest, rest), (0, 0)), mode="edge") for values in course[:2]]
    positions = held[0] + 1e-5 * rng.normal(size=held[0].shape)
    signals = {"pos": positions, **({"quat": held[1]} if orientation else {})}
    times = np.arange(len(positions)) / rate_hz
    return Recording(t=times, signals=MappingProxyType(signals), name="a vessel")


def test_a_movement_that_the_rotation_explains_is_named_turning_where_it_begins_and_ends() -> None:
    recording = swaying_recording()
    named = segment_recording(recording)
    unnamed = segment_recording(recording, preset="without_explained_turns")
    assert [one.kind for one in unnamed.segments] == ["steady", "motion", "steady"]
    assert [one.kind for one in named.segments] == ["steady", "turning", "steady"]
    assert [one.t for one in named.changepoints] == [one.t for one in unnamed.changepoints]
    found = named.segments[1]
    assert found.probability >= unnamed.segments[1].probability
    assert found.runner_up != "turning"
    assert found.centre is not None
    assert found.centre == pytest.approx((0.0, 0.0, LEVER[2]), abs=0.02)


def test_without_an_orientation_nothing_is_a_turn() -> None:
    found = segment_recording(swaying_recording(orientation=False))
    assert [one.kind for one in found.segments] == ["steady", "motion", "steady"]

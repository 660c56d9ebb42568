"""The reproduced path: its ends, derivatives and peaks, and that it does not overshoot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from tests.harness.programs import app

from caesura_protocol.messages import App, AppPath, ScrewMotion, ViaPoint
from caesura_protocol.reproduced_path import Curve, curve_of, path_in_words, turn_of, turning_at_points
from caesura_protocol.rotations import turning_of

START, END = np.array([0.1, -0.5, 0.3]), np.array([0.3, -0.4, 0.1])
PEAK = 1.875  # of a minimum-jerk movement over its mean


def test_it_begins_and_ends_where_and_how_fast_it_should() -> None:
    leaving, arriving = np.array([0.02, 0.0, -0.01]), np.array([0.0, 0.01, -0.05])
    curve = Curve.through([0.0, 1.4], [START, END], passing=[leaving, arriving])
    for t, place, speed in ((0.0, START, leaving), (1.4, END, arriving)):
        position, velocity, acceleration = curve.at(t)
        assert_allclose(position, place, atol=1e-12)
        assert_allclose(velocity, speed, atol=1e-12)
        assert_allclose(acceleration, 0.0, atol=1e-12)
    assert_allclose(curve.at(1.9)[0], END + 0.5 * arriving)


def test_velocity_and_acceleration_are_the_derivatives_of_the_place() -> None:
    knots = [START, END, START + 0.1, END - 0.05]
    passing = [*np.full((3, 3), np.nan), (0.0, 0.01, -0.05)]
    curve, step = Curve.through([0.0, 1.4, 2.0, 3.0], knots, passing=passing), 1e-5
    for t in np.linspace(0.1, 2.9, 7):
        before, _, _ = curve.at(t - step)
        here, velocity, acceleration = curve.at(t)
        after, _, _ = curve.at(t + step)
        assert_allclose((after - before) / (2 * step), velocity, atol=1e-8)
        assert_allclose((after - 2 * here + before) / step**2, acceleration, atol=1e-4)


def test_without_via_points_it_is_the_straight_line_of_minimum_jerk() -> None:
    curve = Curve.through([0.0, 2.0], [START, END])
    places = np.array([curve.at(t)[0] for t in np.linspace(0.0, 2.0, 21)])
    way = (END - START) / np.linalg.norm(END - START)
    assert_allclose(np.linalg.norm(np.cross(places - START, way), axis=1), 0.0, atol=1e-12)
    assert_allclose(curve.peaks()[0], PEAK * np.linalg.norm(END - START) / 2.0, rtol=1e-9)


def test_the_rate_of_a_turn_is_that_of_its_quaternions() -> None:
    angles = np.array([0.0, 0.5, 1.4, 2.0])
    poses = np.column_stack([*np.zeros((5, 4)), np.sin(angles / 2), np.cos(angles / 2)])
    curve = Curve.through(np.linspace(0.0, 3.0, 4), poses)
    seen = 2.0 * np.arcsin(curve.sampled(1000)[:, 5])
    assert curve.peaks()[0] == 0.0
    assert_allclose(curve.peaks()[1], np.diff(seen).max() / 1e-3, rtol=0.01)


def test_a_turn_beyond_half_a_turn_is_named_in_full_and_one_that_comes_back_is_not_doubled() -> None:
    def turning(*degrees: float, **changes: object) -> App:
        poses = [Rotation.from_euler("z", angle, degrees=True).as_quat().tolist() for angle in degrees]
        start, *via = (ViaPoint(t=float(t), position=START, orientation=q) for t, q in enumerate(poses[:-1]))
        path = AppPath(
            start=start, via=tuple(via), tn=float(len(via) + 1), length_m=0.0, deviation_m=0.0,
            deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
        )  # fmt: skip
        fields = {"target": START, "orientation": poses[-1], "path": path, **changes}
        return app("cartesian_motion", 0.0, path.tn).model_copy(update=fields)

    assert turn_of(turning(0, 90, 180, 270, 360)) == pytest.approx(2.0 * np.pi)
    assert turn_of(turning(0, 60, 120, 60, 0)) == pytest.approx(np.radians(120.0))
    assert path_in_words(turning(0, 70, 140, 210)) == "0 mm, 210°, 2 via"
    screw = ScrewMotion(
        axis=(0, 0, 1), point=(0, 0, 0), angle=9.0, pitch_m=0.001, pitch_sd_m=0.0, torque=None
    )
    assert turn_of(turning(0, 90, screw=screw)) == 9.0


def test_a_turn_keeps_the_rate_that_its_via_points_state() -> None:
    t = np.linspace(0.0, 2.0, 201)
    angle = np.radians(100.0) * (t / 2.0 - np.sin(np.pi * t) / (2.0 * np.pi))  # one rise and fall of its rate
    rate = np.gradient(angle, t)
    quaternions = Rotation.from_rotvec(np.outer(angle, (0.0, 0.6, 0.8))).as_quat()
    knots = [0, 60, 120, 200]
    path = AppPath(
        start=ViaPoint(t=0.0, position=START, orientation=quaternions[0]),
        via=tuple(
            ViaPoint(
                t=float(t[k]),
                position=START,
                orientation=-quaternions[k],  # the same rotation
                angular_velocity=(0.0, 0.6 * rate[k], 0.8 * rate[k]),
            )
            for k in knots[1:-1]
        ),
        tn=2.0, length_m=0.0, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    turned = app("cartesian_motion", 0.0, 2.0, target=START).model_copy(
        update={"orientation": tuple(quaternions[-1].tolist()), "path": path}
    )
    curve = curve_of(turned)
    seen = np.array([turning_of(*(part[3:] for part in curve.at(x)))[0] for x in t])
    assert_allclose(seen @ (0.0, 0.6, 0.8), rate, atol=0.05 * rate.max())
    assert_allclose(turning_at_points(turned)[1], rate[60] * np.array([0.0, 0.6, 0.8]), atol=1e-12)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_what_stops_on_its_way_does_not_overshoot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([0.1, 1.0, 5.0], 6))
    line = np.cumsum(rng.choice([0.0, 0.001, 0.1], 6))
    places = Curve.through(times, np.outer(line, (1.0, 0.0, 0.0))).sampled(50)[:, 0]
    assert np.diff(places).min() > -1e-12

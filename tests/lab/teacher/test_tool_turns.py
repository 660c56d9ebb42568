"""Turns, circles and repeated strokes: what is recorded is what the truth says, and what was taught."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from caesura_lab.ground_truth import truth_of
from caesura_lab.teacher.person import THESIS
from caesura_lab.teacher.phase_truth import PhaseStart, phases_of
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M, SKILLS, Scenario, Step
from caesura_lab.teacher.simulated_teaching import Demonstration, SimulatedTeaching, teach
from caesura_service.robot import Robot
from lab.teacher.nominal import nominal_once

Array = NDArray[np.float64]
TILT = Scenario(
    "tilt",
    "move and tilt, then tilt back in place",
    (0.45, 0.0, 0.35),
    (
        Step("dwell", 0.4),
        Step("move", 1.6, (0.45, 0.1, 0.35), angle_deg=30.0),
        Step("dwell", 2.1),
        Step("turn", 3.1, angle_deg=0.0),
        Step("dwell", 3.5),
    ),
    whole_pose=True,
    turn_axis=(1.0, 0.0, 0.0),
)


def spans(taught: Demonstration, cls: str) -> list[tuple[int, int]]:
    """Samples of each segment of a class, at 1 kHz."""
    found = [s for s in taught.truth["segments"] if s["cls"] == cls]
    return [(round(1000 * s["t0"]), round(1000 * s["t1"]) - 1) for s in found]


def turned_deg(taught: Demonstration, first: int, last: int) -> Array:
    """Rotation vector [deg] in the base frame from one sample to another."""
    before, after = (Rotation.from_quat(taught.recording.signals["quat"][i]) for i in (first, last))
    return np.asarray((after * before.inv()).as_rotvec(degrees=True))


def tips(taught: Demonstration) -> tuple[Array, Array]:
    """Places of the fingertips (n, 3) [m], and the lever from flange to tip (n, 3) [m]."""
    signals = taught.recording.signals
    lever = FINGERS_BELOW_FLANGE_M * Rotation.from_quat(signals["quat"]).apply([0.0, 0.0, 1.0])
    return signals["pos"] + lever, lever


@pytest.mark.parametrize(
    ("name", "angles_deg", "axis"),
    [("pouring", [90, -90], (1, 0, 0)), ("screwing", [120, -120, 120, -120, 120], (0, 0, -1))],
)
def test_between_the_edges_of_a_turn_lies_the_angle_that_was_taught(
    name: str, angles_deg: list[float], axis: tuple[float, float, float]
) -> None:
    taught = nominal_once(name)
    tip, _ = tips(taught)
    turns = spans(taught, "turning")
    assert len(turns) == len(angles_deg)
    for (first, last), angle in zip(turns, angles_deg, strict=True):
        turned = turned_deg(taught, first, last)
        assert turned @ np.array(axis) == pytest.approx(angle, abs=4.0)
        assert np.linalg.norm(np.cross(turned, axis)) < 8.0
        assert np.linalg.norm(tip[first:last] - tip[first], axis=1).max() < 0.25 * 0.1 * np.radians(
            abs(angle)
        )


@pytest.mark.slow
def test_a_screw_sinks_by_its_pitch_and_resists_more_and_more() -> None:
    taught = nominal_once("screwing", person=replace(THESIS, bias_wander_n=0.0))
    tip, lever = tips(taught)
    signals = taught.recording.signals
    driving = [(one["t0"], one["axis"], one["pitch_m"]) for one in taught.truth["screws"]]
    starts = [taught.recording.t[first] for first, _ in np.array(spans(taught, "turning"))[[0, 2, 4]]]
    assert driving == [(pytest.approx(t, abs=0.01), [0.0, 0.0, -1.0], 0.0015) for t in starts]
    about_tip = signals["torque"] - np.cross(lever, signals["force"])
    held = []
    for first, last in np.array(spans(taught, "turning"))[[0, 2, 4]]:
        middle = slice(first + 600, last - 600)
        turns = Rotation.from_quat(signals["quat"][middle])
        angle = (turns * turns[0].inv()).as_rotvec()[:, 2]
        columns = np.column_stack([angle / (2.0 * np.pi), signals["force"][middle, 2], np.ones_like(angle)])
        pitch = np.linalg.lstsq(columns, tip[middle, 2])[0][0]
        assert pitch == pytest.approx(0.0015, rel=0.1)
        axis = lever[middle] / FINGERS_BELOW_FLANGE_M
        resisted = -np.sum(about_tip[middle] * axis, axis=1)
        across = about_tip[middle] + resisted[:, None] * axis
        assert np.abs(np.median(across, axis=0)).max() < 0.02
        held.append(float(np.median(resisted)))
    assert 0.4 < held[0] < held[1] < held[2] < 2.2
    free = slice(*spans(taught, "turning")[1])
    assert np.abs(np.median(about_tip[free], axis=0)).max() < 0.05


def test_the_moment_of_a_contour_is_that_of_its_force_alone() -> None:
    taught = nominal_once("contour")
    _, lever = tips(taught)
    signals = taught.recording.signals
    for first, last in spans(taught, "sliding"):
        ticks = slice(first, last)
        force = signals["force"][ticks]
        moment = signals["torque"][ticks] - np.cross(lever[ticks], force)
        assert np.abs(np.median(moment, axis=0)).max() < 0.02
        along_tool = -np.sum(force * lever[ticks], axis=1) / FINGERS_BELOW_FLANGE_M
        assert 8.0 < np.median(along_tool) < 20.0
        assert abs(turned_deg(taught, first, last)[0]) == pytest.approx(70.0, abs=4.0)


def test_two_circles_are_one_movement_back_to_where_it_began() -> None:
    taught = nominal_once("circle")
    first, last = spans(taught, "motion")[1]
    way = taught.recording.signals["pos"][first:last:20]
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() == pytest.approx(2 * np.pi * 0.1, rel=0.05)
    assert_allclose(way[0], way[-1], atol=0.012)
    assert_allclose(np.ptp(way[:, :2], axis=0), 0.1, atol=0.01)
    assert np.ptp(way[:, 2]) < 0.02


def test_a_peg_is_pushed_in_and_stays() -> None:
    taught = nominal_once("peg")
    tip, _ = tips(taught)
    first, last = spans(taught, "sliding")[-1]
    assert tip[first, 2] - tip[last, 2] == pytest.approx(0.025, abs=0.002)
    assert np.median(taught.recording.signals["force"][first:last, 2]) > 8.0
    (load,) = taught.truth["loads"]
    assert load["t1"] < first / 1000


@pytest.mark.parametrize(
    ("name", "phases"),
    [
        ("screwing", "reach screw retract"),
        ("peg", "reach pick carry insert retract"),
        ("pouring", "reach pick pour place retract"),
        ("circle", "reach circle return"),
        ("contour", "reach follow retract"),
        ("peeling", "reach peel retract"),
        ("wiping", "reach wipe retract"),
    ],
)
def test_phases_cover_the_demonstration_and_begin_where_segments_do(name: str, phases: str) -> None:
    content: dict[str, Any] = nominal_once(name).truth
    truth = truth_of(content, name)
    assert " ".join(phase.kind for phase in truth.phases) == phases
    assert (truth.phases[0].t0, truth.phases[-1].t1) == truth.window
    edges = {mark["t"] for mark in content["changepoints"] if mark["level"] == "major"}
    for before, after in pairwise(truth.phases):
        assert before.t1 == after.t0
        assert after.t0 in edges


def test_peeling_is_five_strokes_in_contact() -> None:
    taught = nominal_once("peeling")
    assert len(spans(taught, "sliding")) == len(taught.truth["forces"]) == 5


def test_a_turn_is_the_same_by_seed_however_it_is_cut(robot: Robot) -> None:
    whole = nominal_once(TILT, seed=5, natural=True)
    pieces = list(SimulatedTeaching(TILT, seed=5, robot=robot, natural=True).chunks(0.0137))
    assert_array_equal(np.concatenate(pieces), whole.recording.matrix())
    assert [s["cls"] for s in whole.truth["segments"]].count("turning") == 1
    other = nominal_once(TILT, seed=6, natural=True)
    assert other.recording.t.size != whole.recording.t.size


def test_a_turn_without_an_angle_is_named(robot: Robot) -> None:
    scenario = Scenario("odd", "turn", (0.45, 0.0, 0.35), (Step("turn", 1.0),), turn_axis=(1.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="step turn of odd has no angle_deg"):
        teach(scenario, robot=robot)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["screwing", "peg", "contour"])
def test_a_person_with_habits_teaches_each_skill_with_all_its_phases(name: str) -> None:
    truth = truth_of(nominal_once(name, seed=5, natural=True, rate_hz=100.0).truth, name)
    assert len(truth.phases) == 1 + sum(step.begins is not None for step in SKILLS[name].steps)
    assert all(force.value < 30.0 for force in truth.forces)


def test_events_of_phases_are_taken_in_their_order_and_a_missing_one_leaves_none() -> None:
    marks = [
        {"kind": kind, "t": t} for kind, t in (("contact_on", 2.0), ("contact_off", 3.0), ("contact_on", 6.0))
    ]
    pick, carry = PhaseStart("pick", "contact_on", 2.2), PhaseStart("carry", "contact_off", 1.0)
    found = phases_of((pick, carry, PhaseStart("place", "contact_on", 3.1)), marks, 9.0)
    assert [(phase["name"], phase["t0"], phase["t1"]) for phase in found] == [
        ("reach", 0.0, 2.0),
        ("pick", 2.0, 3.0),
        ("carry", 3.0, 6.0),
        ("place", 6.0, 9.0),
    ]
    assert phases_of((pick, carry, carry), marks, 9.0) == phases_of((), marks, 9.0) == []

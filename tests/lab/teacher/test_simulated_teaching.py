"""Whole demonstrations: the same by seed, true to the scenario, and as real as the sensors they imitate."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from caesura_lab.teacher.person import THESIS, draw_person
from caesura_lab.teacher.scenarios import PICK_AND_PLACE, SCENARIOS, Scenario, Step
from caesura_lab.teacher.simulated_teaching import Demonstration, SimulatedTeaching, teach
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import WRENCH_SOURCES, WrenchSource
from caesura_service.constants import GRAVITY
from caesura_service.robot import Robot

LIFT = Scenario(
    "lift",
    "grasp, lift, hold still",
    PICK_AND_PLACE.start,
    (*PICK_AND_PLACE.steps[:5], Step("move", 5.0, (-0.018, -0.624, 0.2)), Step("dwell", 6.0)),
    PICK_AND_PLACE.surfaces,
)
SHORT = Scenario(
    "short", "one move", (0.4, 0.0, 0.3), (Step("dwell", 0.3), Step("move", 1.3, (0.4, 0.1, 0.3)))
)
DATA = Path(__file__).parents[3] / "data"
CLASSES = {"motion", "steady", "contact", "transport", "hold", "sliding", "turning"}


def test_the_same_seed_gives_the_same_bytes_however_it_is_cut(robot: Robot) -> None:
    whole = teach(SHORT, seed=5, robot=robot)
    pieces = list(SimulatedTeaching(SHORT, seed=5, robot=robot).chunks(0.0137))
    assert_array_equal(np.concatenate(pieces), whole.recording.matrix())
    assert teach(SHORT, seed=5).truth == whole.truth


def test_another_seed_is_another_person(robot: Robot) -> None:
    first, second = teach(SHORT, seed=5, robot=robot), teach(SHORT, seed=6, robot=robot)
    assert first.recording.t.size != second.recording.t.size
    assert first.truth["person"] != second.truth["person"]


def test_the_wrench_source_changes_the_wrench_and_nothing_else(robot: Robot) -> None:
    recordings = {s: teach(SHORT, seed=2, wrench_source=s, robot=robot).recording for s in WRENCH_SOURCES}
    for recording in recordings.values():
        assert_array_equal(recording.signals["pos"], recordings["none"].signals["pos"])
    assert "force" not in recordings["none"].signals
    assert "tau" in recordings["joint_torque_estimate"].signals
    hand = recordings["flange_sensor_with_hand"].signals["force"]
    below = recordings["flange_sensor"].signals["force"]
    assert np.abs(hand).max() > 2.0 + np.abs(below).max()


def test_joint_torque_estimates_err_by_newtons_in_motion(robot: Robot) -> None:
    true = teach(SHORT, seed=3, wrench_source="flange_sensor_with_hand", robot=robot).recording
    estimate = teach(SHORT, seed=3, wrench_source="joint_torque_estimate", robot=robot).recording
    velocity_of_class = (true.t > 0.8) & (true.t < 1.4)
    error = np.linalg.norm((estimate.signals["force"] - true.signals["force"])[velocity_of_class], axis=1)
    assert 1.0 < np.sqrt(np.mean(error**2)) < 8.0


@pytest.mark.parametrize("rate", [100.0, 700.0, 1000.0])
def test_samples_come_at_the_rate_asked_for(robot: Robot, rate: float) -> None:
    t = teach(SHORT, rate_hz=rate, robot=robot).recording.t
    assert t.size == pytest.approx(1.3 * rate, abs=1)
    assert np.diff(t).max() <= 1.0 / rate + 0.001
    assert np.all(np.diff(t) > 0)


@pytest.mark.slow
def test_each_scenario_ends_where_it_should(nominal: Demonstration) -> None:
    scenario = SCENARIOS[nominal.truth["scenario"]]
    assert_allclose(nominal.recording.signals["pos"][-1], scenario.end, atol=0.012)
    assert nominal.recording.t[-1] == pytest.approx(scenario.steps[-1].until_s, abs=0.002)


def test_joints_and_poses_agree(nominal: Demonstration, robot: Robot) -> None:
    signals = nominal.recording.signals
    positions, quaternions = robot.flange_poses(signals["q"][::200])
    assert_allclose(signals["pos"][::200], positions, atol=2e-6)
    assert_allclose(np.abs(np.sum(quaternions * signals["quat"][::200], axis=1)), 1.0, atol=1e-5)
    assert np.abs(np.diff(signals["quat"], axis=0)).max() < 0.01
    assert np.all((robot.lower_limits < signals["q"]) & (signals["q"] < robot.upper_limits))
    joint_speed = np.abs(signals["q"][10:] - signals["q"][:-10]) / 0.01
    assert np.all(joint_speed.max(axis=0) < robot.velocity_limits)


def test_truth_has_the_format_of_the_hand_annotations(nominal: Demonstration) -> None:
    truth = json.loads(json.dumps(nominal.truth))
    assert {"file", "window", "rule", "hand_force_in_wrench", "changepoints", "segments", "gripper"} <= set(
        truth
    )
    assert {"loads", "forces", "scenario", "seed", "person"} <= set(truth)
    for mark in truth["changepoints"]:
        assert set(mark) - {"t_alt"} == {"t", "kind", "tol", "level"}
        assert "t_alt" not in mark or (mark["kind"] == "contact_off" and mark["t_alt"] < mark["t"])
        assert mark["level"] in ("major", "optional")
    assert {s["cls"] for s in truth["segments"]} <= CLASSES
    assert truth["window"] == [0.0, pytest.approx(nominal.recording.t[-1])]


def test_truth_is_in_order(nominal: Demonstration) -> None:
    truth = nominal.truth
    times = [mark["t"] for mark in truth["changepoints"]]
    assert times == sorted(times)
    assert all(s["t0"] < s["t1"] for s in truth["segments"])
    assert all(before["t1"] <= after["t0"] for before, after in pairwise(truth["segments"]))


def test_pick_and_place_happens_when_the_thesis_says(pick_and_place: Demonstration) -> None:
    found = [m for m in pick_and_place.truth["changepoints"] if m["level"] == "major"][:5]
    # Fig. 4.15 and 4.17: contact, lift-off, via point, place contact, let go.
    kinds = ["contact_on", "contact_off", "corner", "contact_on", "contact_off"]
    assert [m["kind"] for m in found] == kinds
    assert [m["t"] for m in found] == pytest.approx([1.8, 4.2, 5.7, 7.5, 10.1], abs=0.3)
    assert [e["t"] for e in pick_and_place.truth["gripper"]] == [3.0, 9.2]
    assert [f["newton"] for f in pick_and_place.truth["forces"]] == pytest.approx([15.0, 9.9], rel=0.15)
    assert [load["kg"] for load in pick_and_place.truth["loads"]] == [0.25]
    width = pick_and_place.recording.signals["gripper"][:, 0]
    assert width[[0, 5000, -1]] == pytest.approx([0.08, 0.05, 0.08], abs=1e-5)
    closing = np.flatnonzero((width < 0.0799) & (width > 0.0501))
    closing = closing[closing < 5000]
    assert 0.4 < (closing[-1] - closing[0]) / 1000 < 0.56


def test_a_hand_holds_its_effort_when_the_load_is_gripped(pick_and_place: Demonstration) -> None:
    # Once it held the surface's force: the reading fell by the load, with a false boundary at the grip.
    # Fig. 4.14: 15.0 N and 9.9 N from the touch to the decay; gripped at 3.0 s, let go at 9.2 s.
    t, reading = pick_and_place.recording.t, pick_and_place.recording.signals["force"][:, 2]
    for grip_s in (3.0, 9.2):
        before, after = ((t > grip_s + at) & (t < grip_s + at + 0.2) for at in (-0.3, 0.3))
        assert reading[after].mean() == pytest.approx(reading[before].mean(), abs=0.6)
    assert [f["newton"] for f in pick_and_place.truth["forces"]] == pytest.approx([15.0, 9.9], abs=0.5)


def test_the_dispenser_is_pressed_twice_to_its_stop(dispenser: Demonstration) -> None:
    forces = dispenser.truth["forces"]
    assert [f["newton"] for f in forces] == pytest.approx([21.0, 20.0], rel=0.15)
    assert [f["t0"] for f in forces] == pytest.approx([2.6, 7.6], abs=0.3)
    z = dispenser.recording.signals["pos"][:, 2]
    assert z.min() == pytest.approx(0.190 - 0.025, abs=0.004)


def test_pressing_down_pushes_the_robot_up(dispenser: Demonstration) -> None:
    contact = dispenser.truth["forces"][0]
    held = (dispenser.recording.t > contact["t0"] + 0.9) & (dispenser.recording.t < contact["t1"] - 0.6)
    assert dispenser.recording.signals["force"][held, 2].mean() == pytest.approx(contact["newton"], abs=2.0)


@pytest.mark.parametrize("load_kg", [0.15, 0.6])
def test_a_load_held_still_weighs_what_it_weighs(robot: Robot, load_kg: float) -> None:
    person = replace(THESIS, load_kg=load_kg, bias_wander_n=0.0)
    demonstration = teach(LIFT, person=person, robot=robot)
    recording = demonstration.recording
    resting = recording.signals["force"][recording.t > recording.t[-1] - 0.5]
    assert_allclose(resting.mean(axis=0), [0.0, 0.0, -load_kg * GRAVITY], atol=0.05)
    assert demonstration.truth["segments"][-1]["cls"] == "hold"


def test_a_recording_is_tared_only_if_asked(robot: Robot) -> None:
    tared = teach(SHORT, robot=robot).recording.signals["force"][:150].mean(axis=0)
    raw = teach(SHORT, robot=robot, tared=False).recording.signals["force"][:150].mean(axis=0)
    assert np.linalg.norm(tared) < 0.1
    assert np.linalg.norm(raw) == pytest.approx(THESIS.bias_n, abs=0.2)


def test_people_differ_within_what_was_asked() -> None:
    people = [draw_person(np.random.default_rng(seed), "x") for seed in range(1, 200)]
    assert all(0.85 <= p.force_factor <= 1.15 and 0.15 <= p.load_kg <= 0.6 for p in people)
    assert all(2e-6 <= p.position_noise_m <= 15e-6 and 0.02 <= p.force_noise_n <= 0.2 for p in people)
    assert {p.profile for p in people} == {"minimum_jerk", "overdamped", "lognormal"}


@pytest.mark.parametrize("source", ["flange_sensor", "joint_torque_estimate"])
def test_the_truth_says_whether_the_hand_is_in_the_wrench(robot: Robot, source: WrenchSource) -> None:
    truth = teach(SHORT, wrench_source=source, robot=robot).truth
    assert truth["hand_force_in_wrench"] is (source == "joint_torque_estimate")


def test_misuse_is_named() -> None:
    with pytest.raises(ValueError, match=r"unknown scenario 'juggling', known: .*pick_and_place"):
        SimulatedTeaching("juggling")
    with pytest.raises(ValueError, match="rate is 5000"):
        SimulatedTeaching("button", rate_hz=5000.0)
    with pytest.raises(RuntimeError, match="read all chunks first"):
        SimulatedTeaching("button").truth()


def test_the_recordings_in_the_repository_are_what_the_teacher_makes(stored: Demonstration) -> None:
    # Rounding differs between machines and grows in contact, so the signals agree to a fraction of a step.
    name = stored.truth["scenario"]
    file = load_recording(DATA / f"{name}.npz")
    assert_array_equal(file.t, stored.recording.t)
    assert_allclose(file.signals["pos"], stored.recording.signals["pos"], atol=1e-4)
    assert_allclose(file.signals["force"], stored.recording.signals["force"], atol=0.5)
    truth = json.loads((DATA / f"{name}.ann.json").read_text(encoding="utf-8"))
    assert [m["kind"] for m in truth["changepoints"]] == [m["kind"] for m in stored.truth["changepoints"]]
    names = [[phase["name"] for phase in found.get("phases", [])] for found in (truth, stored.truth)]
    assert names[0] == names[1]

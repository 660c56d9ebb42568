"""The simulated teacher on every arm that ships."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from caesura_lab.evaluation.cases.suites import SimulatedDemonstration, SuiteOptions, suite
from caesura_lab.teacher.command_registration import register
from caesura_lab.teacher.scenarios import SCENARIOS, moved
from caesura_lab.teacher.simulated_teaching import SimulatedTeaching
from caesura_protocol.formats.read import load_recording
from caesura_protocol.robots import robot_description
from caesura_service.robot import load_robot
from lab.teacher.nominal import nominal_once

ARMS = ("fr3", "iiwa14", "ur10e", "ur5e", "xarm7")
ASTRAY_M = 0.04  # of a hand that lets go near its goal


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_guided_through_buttons_within_its_limits(name: str) -> None:
    demonstration, robot = nominal_once("button", seed=1, robot=name), load_robot(name)
    recording, offset = demonstration.recording, robot_description(name).task_offset_m
    q = recording.signals["q"]
    assert np.all((robot.lower_limits < q) & (q < robot.upper_limits))
    assert np.all(np.abs(np.diff(q, axis=0)) < robot.velocity_limits * np.diff(recording.t)[:, None])
    assert_allclose(recording.signals["pos"][0], np.add(SCENARIOS["button"].start, offset), atol=5e-3)
    end = np.add(SCENARIOS["button"].end, offset)
    assert np.linalg.norm(recording.signals["pos"][-1] - end) < ASTRAY_M
    assert recording.signals["force"][:, 2].max() > 5.0  # a button pushes back
    assert recording.signals["q"].shape[1] == robot.joints
    assert recording.setting.robot == name
    assert_allclose(robot.flange_poses(recording.signals["q"])[0], recording.signals["pos"], atol=2e-6)
    assert demonstration.truth["robot"] == name
    assert {segment["cls"] for segment in demonstration.truth["segments"]} >= {"motion", "contact"}


def test_a_scenario_is_moved_with_all_that_it_touches() -> None:
    offset = (0.1, -0.2, 0.3)
    for scenario in SCENARIOS.values():
        there = moved(scenario, offset)
        assert_allclose(there.start, np.add(scenario.start, offset))
        assert_allclose(there.end, np.add(scenario.end, offset))
        for one, other in zip(scenario.surfaces, there.surfaces, strict=True):
            x, y = one.center_m
            assert other.covers(x + 0.1, y - 0.2) == one.covers(x, y)
            assert other.height_at(x + 0.1, y - 0.2) == pytest.approx(one.height_at(x, y) + 0.3)


def test_no_offset_changes_nothing() -> None:
    for scenario in SCENARIOS.values():
        assert moved(scenario, (0.0, 0.0, 0.0)) is scenario


def test_a_robot_out_of_reach_of_the_task_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\[1.5, 0.0, 0.0\] m: .* are left"):
        SimulatedTeaching(moved(SCENARIOS["parkour"], (1.667, 0.462, -0.052)), robot="xarm7")


def test_a_suite_is_of_one_robot() -> None:
    cases = suite("skills", SuiteOptions(seeds=1, robot="ur5e"))
    assert {case.robot for case in cases if isinstance(case, SimulatedDemonstration)} == {"ur5e"}
    assert all(case.name.endswith("-ur5e") for case in cases)
    assert not any(case.name.endswith("panda") for case in suite("skills", SuiteOptions(seeds=1)))


def test_the_command_takes_a_robot(tmp_path: Path) -> None:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)
    file = tmp_path / "eight.npz"
    options = ["--robot", "ur5e", "--rate", "100", "-o", str(file)]
    result = CliRunner().invoke(app, ["teach", "parkour", *options])
    assert result.exit_code == 0, result.output
    expected = nominal_once("parkour", robot="ur5e", rate_hz=100.0).recording
    assert load_recording(file).signals["pos"].tobytes() == expected.signals["pos"].tobytes()
    refused = CliRunner().invoke(
        app, ["teach", "parkour", "--robot", "ur5"], env={"COLUMNS": "300", "TERM": "dumb"}
    )
    assert refused.exit_code == 2
    assert "'ur5' is not known, expected one of" in refused.output

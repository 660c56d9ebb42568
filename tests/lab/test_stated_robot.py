"""A recording of joints alone, whose robot the command line states."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from caesura_protocol.robots import robot_description
from harness.commands import application


@pytest.fixture
def six(tmp_path: Path) -> Path:
    """A csv of six joints: an arm that rests, turns its base by 0.5 rad, and rests."""
    t = np.arange(0.0, 5.0, 0.01)
    q = np.tile(robot_description("ur5e").postures[0], (t.size, 1))
    q[:, 0] += 0.25 - 0.25 * np.cos(np.pi * np.clip((t - 1.5) / 2.0, 0.0, 1.0))
    file = tmp_path / "six.csv"
    names = ",".join(["t", *(f"q{joint}" for joint in range(1, 7))])
    np.savetxt(file, np.column_stack([t, q]), delimiter=",", header=names, comments="")
    return file


def caesura(*arguments: object) -> Result:
    return CliRunner().invoke(application(), [str(word) for word in arguments], env={"COLUMNS": "300"})


def test_segment_and_report_take_the_robot_of_the_command_line(six: Path, tmp_path: Path) -> None:
    result, report = tmp_path / "six.json", tmp_path / "six.html"
    divided = caesura("segment", six, "--robot", "ur5e", "--json", result)
    assert divided.exit_code == 0, divided.output
    (moved,) = [app for app in json.loads(result.read_text())["program"] if app["path"] is not None]
    assert len(moved["joints"]) == 6
    drawn = caesura("report", six, "--robot", "ur5e", "-o", report)
    assert drawn.exit_code == 0, drawn.output


def test_without_a_robot_the_refusal_names_the_option(six: Path) -> None:
    refused = caesura("segment", six)
    assert refused.exit_code == 1
    assert "6 joints and no position" in refused.output
    assert "--robot" in refused.output


def test_that_only_a_simulated_robot_runs_is_said_with_the_scripts_of_every_arm(six: Path) -> None:
    """A UR5e's program was sent to a franky script."""
    said = " ".join(caesura("execute", six).output.split())
    assert "caesura program --format franky, urscript or xarm" in said


def test_the_list_of_robots_has_units() -> None:
    listed = caesura("robots").output
    assert "reach [m]" in listed
    assert "payload [kg]" in listed


def test_a_folder_without_robots_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path / "mistyped"))
    done = caesura("robots")
    assert done.exit_code == 1
    assert done.output.startswith("error: CAESURA_ROBOTS is ")

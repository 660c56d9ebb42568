"""A robot as data: what is refused, and a seventh arm that is a folder and no code."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from caesura_clients.cli.robots import list_robots
from caesura_protocol.robots import RobotError, description, robot_description, robot_names
from caesura_protocol.robots.description import MAX_FILE_BYTES
from caesura_service.robot import load_robot

URDF = """<robot name="planar">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 0.1"/><limit lower="-3" upper="3" effort="40" velocity="2"/></joint>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><axis xyz="0 0 1"/>
    <origin xyz="0.4 0 0"/><limit lower="-2.5" upper="2.5" effort="20" velocity="3"/></joint>
  <link name="flange"/>
  <joint name="end" type="fixed"><parent link="fore"/><child link="flange"/><origin xyz="0.3 0 0"/></joint>
</robot>"""

FIELDS: dict[str, Any] = {
    "name": "planar",
    "title": "Two joints in a plane",
    "urdf": "planar.urdf",
    "joints": ["shoulder", "elbow"],
    "flange": "flange",
    "acceleration_limits": [5.0, 5.0],
    "jerk_limits": [100.0, 100.0],
    "flange_acceleration_limit": 3.0,
    "flange_jerk_limit": 50.0,
    "friction_nm": [0.5, 0.3],
    "postures": [[0.0, 1.0]],
    "reach_m": 0.7,
    "payload_kg": 1.0,
    "wrench_source": "flange_sensor",
}


def folder(root: Path, text: str = URDF, **changed: Any) -> Path:
    root.mkdir(exist_ok=True)
    (root / "planar.urdf").write_text(text)
    (root / "robot.json").write_text(json.dumps(FIELDS | changed))
    return root


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """Descriptions are read once a process, and a name has one path: each test starts afresh."""
    description._known.cache_clear()
    robot_description.cache_clear()
    yield
    description._known.cache_clear()
    robot_description.cache_clear()


def test_a_seventh_arm_is_a_folder(tmp_path: Path) -> None:
    for path in (folder(tmp_path), tmp_path / "robot.json"):
        robot = load_robot(str(path))
        assert robot.joints == 2
        assert_allclose(robot.flange_pose([0.0, np.pi / 2]).position_base, [0.4, 0.3, 0.1], atol=1e-12)
        assert_allclose(robot.upper_limits, [3.0, 2.5])
        assert_allclose(robot.friction_nm, [0.5, 0.3])


def test_a_folder_of_robots_is_found_by_name_and_by_any_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder(tmp_path / "planar")
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path))
    assert "planar" in robot_names()
    monkeypatch.chdir(tmp_path)
    for path in ("planar/robot.json", "planar", str(tmp_path / "planar")):
        assert robot_description(path).name == "planar"
    monkeypatch.delenv("CAESURA_ROBOTS")
    description._known.cache_clear()
    robot_description.cache_clear()
    assert robot_description("planar").name == "planar"  # the folder in the working directory


def test_a_folder_of_robots_that_has_none_or_a_taken_name_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path / "mistyped"))
    with pytest.raises(
        RobotError, match=r"CAESURA_ROBOTS is '.*mistyped', expected a folder that holds robots"
    ):
        robot_names()
    with pytest.raises(RobotError, match=r"CAESURA_ROBOTS is '.*mistyped'"):
        robot_description("planar")
    assert robot_description("panda").name == "panda"  # a wrong folder refuses no robot of the package
    folder(tmp_path / "panda")
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path))
    description._known.cache_clear()
    with pytest.raises(RobotError, match="the name 'panda' is taken"):
        robot_names()


def test_another_package_adds_an_arm_by_an_entry_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder(tmp_path) / "robot.json"

    class Point:
        name = "planar"

        @staticmethod
        def load() -> Any:
            return lambda: file

    def points(*, group: str) -> list[type[Point]]:
        return [Point] if group == "caesura.robots" else []

    monkeypatch.setattr(description, "entry_points", points)
    assert "planar" in robot_names()
    assert load_robot("planar").joints == 2


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(
        RobotError,
        match=r"'ur5' is not known, expected one of .*fr3.*ur5e.*; the path of a robot.json"
        r".*CAESURA_ROBOTS.*at the service",
    ):
        robot_description("ur5")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"acceleration_limits": [5.0]},
            r"robot\.json: acceleration_limits has 1 numbers, expected one for each of 2 joints$",
        ),
        ({"jerk_limits": [5.0] * 3}, "jerk_limits has 3 numbers, expected one for each of 2"),
        ({"friction_nm": [0.1]}, "friction_nm has 1 numbers"),
        ({"postures": [[0.0, 0.0], [0.0]]}, r"postures\[1\] has 1 numbers"),
        ({"motor_inertia": [0.1, -0.1]}, r"motor_inertia is \[0.1, -0.1\], expected numbers of at least 0"),
        ({"jerk_limits": [5.0, 0.0]}, r"jerk_limits\.1 is 0\.0, expected greater than 0$"),
        ({"wrench_source": "guess"}, "wrench_source is 'guess', expected 'flange_sensor'"),
        ({"colour": "grey"}, "unknown field colour, known: name, title, urdf, joints"),
        ({"urdf": "other.urdf"}, "urdf is 'other.urdf', which is no file beside it"),
        ({"urdf": "/etc/passwd"}, "urdf is '/etc/passwd', which is no file beside it"),
        ({"urdf": "../../../../../etc/passwd"}, "which is no file beside it"),
        ({"sources": {"limits": "x" * MAX_FILE_BYTES}}, f"expected at most {MAX_FILE_BYTES}"),
    ],
)
def test_a_wrong_description_is_refused_by_field(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    # It read "colour: Extra inputs are not permitted", and the text on counts ended in a cut description.
    with pytest.raises(RobotError, match=said):
        robot_description(str(folder(tmp_path, **changed)))


def test_all_fields_that_are_missing_are_named_at_once(tmp_path: Path) -> None:
    """An arm from a URDF has twelve fields to find: the error named one at a time."""
    (tmp_path / "robot.json").write_text('{"name": "planar", "urdf": "planar.urdf", "payload_kg": -1}')
    with pytest.raises(
        RobotError, match=r"has no title, joints, flange, acceleration_limits, .*, wrench_source;"
    ):
        robot_description(str(tmp_path / "robot.json"))


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"robot.json: cannot be read: No such file"):
        robot_description(str(tmp_path))
    (tmp_path / "robot.json").write_text("{")
    with pytest.raises(RobotError, match=r"robot.json: no JSON"):
        robot_description(str(tmp_path / "robot.json"))
    (tmp_path / "robot.json").write_text("[" * 100_000)
    with pytest.raises(RobotError, match=r"robot.json: no description: nested too deeply"):
        robot_description(str(tmp_path / "robot.json"))


def test_a_urdf_that_takes_seconds_to_read_is_refused(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{number}"/>' for number in range(20_000))
    with pytest.raises(RobotError, match=rf"planar.urdf: has \d+ bytes, expected at most {MAX_FILE_BYTES}"):
        load_robot(str(folder(tmp_path, URDF.replace("</robot>", links + "</robot>"))))


def test_a_package_that_fails_costs_its_own_robot_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def points(*, group: str) -> list[EntryPoint]:
        return [EntryPoint("broken", "no_such_package:robot", group)] if group == "caesura.robots" else []

    monkeypatch.setattr(description, "entry_points", points)
    assert robot_description("panda").name == "panda"
    with pytest.raises(RobotError, match="robot 'broken': entry point no_such_package:robot fails"):
        robot_description("broken")


def test_a_robot_with_the_name_of_a_shipped_one_is_left_out_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "panda").mkdir()
    folder(tmp_path / "panda", name="panda")
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path))
    assert len(robot_description("panda").joints) == 7
    assert "robot 'panda' of" in caplog.text
    assert "another robot has its name" in caplog.text


def test_an_unusable_robot_is_named_beside_the_list_of_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "robot.json").write_text("{")
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path))
    list_robots()
    shown = capsys.readouterr()
    assert "panda" in shown.out
    assert "robotiq_2f_85" in shown.out, "grippers are listed too"
    assert "broken" in shown.err


@pytest.mark.parametrize(
    ("urdf", "changed", "said"),
    [
        (URDF.replace('"elbow"', '"wrist"'), {}, "movable joints are shoulder, wrist, but planar"),
        (
            URDF.replace('"elbow" type="revolute"', '"elbow" type="fixed"'),
            {},
            "movable joints are shoulder,",
        ),
        (
            URDF.replace('"elbow" type="revolute"', '"elbow" type="continuous"'),
            {},
            "joint elbow is RUBZ, expected revolute with limits",
        ),
        (URDF, {"joints": ["elbow", "shoulder"]}, "expected the same in the same order. Make other joints"),
        (
            URDF,
            {"postures": [[0.0, 57.3]]},
            r"postures\[0\] has 57.3 rad for joint elbow, .*: are they degrees",
        ),
        (URDF, {"flange": "tip"}, "has no frame 'tip', which planar states"),
        (URDF, {"tool": "gripper"}, "has no frame 'gripper', which planar states"),
        ("<robot", {}, "not a valid URDF"),
    ],
)
def test_a_urdf_that_does_not_fit_is_refused(
    tmp_path: Path, urdf: str, changed: dict[str, Any], said: str
) -> None:
    with pytest.raises(RobotError, match=said):
        load_robot(str(folder(tmp_path, urdf, **changed)))

"""Which robot a session is taught on: its joints, its kinematics, and what is said where none is stated."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_protocol.errors import ProtocolError
from caesura_protocol.formats.read import load_recording
from caesura_protocol.messages import Open
from caesura_protocol.programs.safety import UNSET, CellSettings
from caesura_protocol.recording import Recording, RecordingError
from caesura_protocol.robots import description
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.input_notes import ASSUMED_ROBOT, UNREAD_JOINTS
from caesura_service.segmentation.opening_layout import layout_of
from caesura_service.segmentation.pipeline import make_pipeline
from harness.segmentations import segmented

DATA = Path(__file__).parents[3] / "data"
POSE = ("t", "px", "py", "pz", "qx", "qy", "qz", "qw")
SIX, SEVEN = (tuple(f"q{i}" for i in range(1, n + 1)) for n in (6, 7))
PLANAR = """<robot name="planar"><link name="base"/><link name="upper"/><link name="hand"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="10" velocity="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="0.4 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="10" velocity="2"/></joint></robot>"""


@pytest.fixture
def planar(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Arms of two joints in the folder CAESURA_ROBOTS; those of `winding` turn by 7 rad."""
    _write_arm(tmp_path / "planar", PLANAR)
    _write_arm(tmp_path / "winding", PLANAR.replace('"-3"', '"-7"').replace('"3"', '"7"'))
    monkeypatch.setenv("CAESURA_ROBOTS", str(tmp_path))
    _forget_robots()
    yield "planar"
    monkeypatch.undo()
    _forget_robots()


def _write_arm(folder: Path, urdf: str) -> None:
    folder.mkdir()
    (folder / "planar.urdf").write_text(urdf)
    panda = json.loads((description.SHIPPED / "panda" / "robot.json").read_text())
    two = ("acceleration_limits", "jerk_limits", "friction_nm")
    short = {field: panda[field][:2] for field in two} | {"motor_inertia": [], "postures": [[0.0, 0.5]]}
    named = {"name": folder.name, "title": "Planar", "urdf": "planar.urdf", "joints": ["shoulder", "elbow"]}
    placed = {"flange": "hand", "tool": None, "script": None}
    (folder / "robot.json").write_text(json.dumps(panda | short | named | placed))


def _forget_robots() -> None:
    description.robot_description.cache_clear()
    description._known.cache_clear()


def opening(columns: tuple[str, ...], robot: str | None = None) -> Open:
    return Open(session="s", columns=columns, robot=robot, wrench_source="none")


def test_pose_and_program_come_from_the_joints_of_the_robot_that_is_stated(planar: str) -> None:
    t = np.arange(0.0, 6.0, 0.01)
    turn = 0.5 - 0.5 * np.cos(np.pi * np.clip((t - 2.0) / 2.0, 0.0, 1.0))
    q = np.column_stack([turn, 0.5 - 0.3 * turn])
    taught = Recording(t, {"q": q}, setting=CellSettings(robot=planar))
    view = segment_recording(taught)
    (moved,) = [app for app in view.apps if app.path is not None]
    assert moved.joints is not None
    assert len(moved.joints) == 2
    there = 0.4 * np.array([np.cos(moved.joints[0]), np.sin(moved.joints[0]), 0.0])
    assert np.allclose(moved.target, there, atol=1e-3)
    assert view.robot == planar
    assert ASSUMED_ROBOT not in view.notes


@pytest.mark.parametrize(
    ("columns", "robot", "said"),
    [
        ((*POSE, *SIX), "panda", "robot is 'panda', which has 7 joints; the columns have 6: q1 to q6"),
        ((*POSE, *SEVEN), "ur9", "robot 'ur9' is not known, expected one of "),
        (("t", *SIX), None, "columns have 6 joints and no position, expected a robot to be stated (--robot"),
        ((*POSE, "q1", "q3"), None, "column 'q3'"),
    ],
)
def test_a_robot_that_does_not_fit_is_refused_with_both_values(
    columns: tuple[str, ...], robot: str | None, said: str
) -> None:
    with pytest.raises(ProtocolError) as refusal:
        make_pipeline(opening(columns, robot), "default")
    assert said in refusal.value.message
    assert refusal.value.value == (robot or list(columns))


@pytest.mark.usefixtures("planar")
def test_joints_may_turn_as_far_as_those_of_the_robot_that_is_stated(tmp_path: Path) -> None:
    """An arm whose wrist turns by more than a whole turn was refused at 6.5 rad: "probably in deg"."""
    t = np.arange(0.0, 2.0, 0.01)
    file = tmp_path / "wound.csv"
    np.savetxt(
        file, np.column_stack([t, 0.0 * t, 6.5 + 0.0 * t]), delimiter=",", header="t,q1,q2", comments=""
    )
    wound = load_recording(file, robot="winding")
    assert wound.setting.robot == "winding"
    assert wound.doubts == ()
    assert segment_recording(wound).samples == t.size
    with pytest.raises(RecordingError, match=r"joints turn to 6.5 rad, at most 6.3 rad are plausible"):
        load_recording(file, robot="planar")
    degrees = replace(wound, signals={"q": 10.0 * wound.signals["q"]})
    assert "at most 7 rad are plausible: probably in deg" in str(degrees.implausible)


def test_six_joints_beside_a_pose_need_no_robot() -> None:
    layout = layout_of(opening((*POSE, *SIX)))
    assert layout.joints == 6
    assert not layout.needs_robot


def test_that_joints_of_an_unstated_arm_give_no_orientation_is_stated(tmp_path: Path) -> None:
    """Six joints beside a position were left unread in silence, as in a log of UR's RTDE."""
    taught = replace(load_recording(DATA / "button.npz"), setting=UNSET, wrench_source="none")
    beside = {"pos": taught.signals["pos"], "q": taught.signals["q"][:, :6]}
    posed = beside | {"quat": taught.signals["quat"]}
    assert UNREAD_JOINTS in segmented(replace(taught, signals=beside)).notes
    assert UNREAD_JOINTS not in segmented(replace(taught, signals=posed)).notes
    assert UNREAD_JOINTS not in segmented(taught).notes


def test_that_joints_are_read_as_a_pandas_is_said_where_it_matters() -> None:
    taught = replace(load_recording(DATA / "button.npz"), setting=UNSET)
    joints = replace(taught, signals={"q": taught.signals["q"]}, wrench_source="none")
    assert ASSUMED_ROBOT in segmented(joints).notes
    assert ASSUMED_ROBOT not in segmented(taught).notes
    stated = replace(joints, setting=CellSettings(robot="panda"))
    view = segmented(stated)
    assert ASSUMED_ROBOT not in view.notes
    assert [one.kind for one in view.segments] == [one.kind for one in segmented(joints).segments]


def test_a_robot_may_be_stated_where_no_joints_are_sent() -> None:
    assert not layout_of(opening(POSE, "panda")).has("q")

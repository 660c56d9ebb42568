"""Franka arms without hardware: what comes out of libfranka's states, and what is said when one is lost."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from caesura_clients.bridge import Bridge
from caesura_clients.bridge.sources.libfranka_state import FrankaSource
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import HERE, Transform, flange_of, multiply, pose_of, rotate
from clients.bridging import QUICK
from clients.fake_franka import (
    GUIDING,
    IDLE,
    Affine,
    Duration,
    FrankaScript,
    fake_franky,
    fake_libfranka,
    state,
)
from clients.fake_service import FakeService, eventually
from clients.lost_arm import chunks_of

ARMS = ["franky", "panda"]
IGNORED = {"franky": "Ignore", "panda": "kIgnore"}


@pytest.fixture
def play(monkeypatch):
    """A robot that plays a script, under the name of its package."""

    def begin(arm: str, script: FrankaScript, *, gripper: bool = False) -> FrankaSource:
        monkeypatch.setitem(sys.modules, "franky", fake_franky(script))
        monkeypatch.setitem(sys.modules, "panda_py.libfranka", fake_libfranka(script))
        return open_source(arm, SourceOptions(host="172.16.0.2", gripper=gripper))

    return begin


def moving(count: int, first_ms: int = 5000) -> list:
    """Along x, pressing on the table with 10 N, the hand on the flange as Franka's desk sets it."""
    effector, hand = np.diag([1.0, -1.0, -1.0, 1.0]), np.eye(4)
    turn = np.sqrt(0.5)
    hand[:3, :] = [[turn, turn, 0, 0], [-turn, turn, 0, 0], [0, 0, 1, 0.1034]]
    states = []
    for i in range(count):
        matrix = effector.copy()
        matrix[:3, 3] = [0.4 + 1e-4 * i, 0.1, 0.2]
        reported = {"q": np.arange(7.0) / 10 + i / 1000, "O_F_ext_hat_K": np.array([0, 0, -10.0, 1, 2, 3])}
        reported["tau_ext_hat_filtered"] = np.arange(7.0)
        states.append(state(first_ms + i, O_T_EE=matrix, F_T_EE=hand, **reported))
    return states


@pytest.mark.parametrize("arm", ARMS)
def test_a_state_becomes_a_sample_in_our_frame_and_sign(play, arm):
    script = FrankaScript(moving(40))
    source = play(arm, script)
    assert script.asked == [("Robot", "172.16.0.2", IGNORED[arm])]
    chunks, _ = chunks_of(source)
    assert [len(chunk) for chunk in chunks] == [20, 20]
    column = dict(zip(source.columns, np.concatenate(chunks).T, strict=True))
    np.testing.assert_allclose(column["t"], np.arange(40) / 1000)
    np.testing.assert_allclose(column["px"], 0.4 + 1e-4 * np.arange(40))
    np.testing.assert_allclose(column["pz"], 0.2 + 0.1034)  # the tool points down: the flange is above it
    assert column["fz"].tolist() == [10.0] * 40  # the robot pushes down, the table pushes up
    np.testing.assert_allclose([column[f"m{axis}"][0] for axis in "xyz"], [-1, -2, -3])
    np.testing.assert_allclose([column[f"tau{i}"][7] for i in range(1, 8)], -np.arange(7.0))
    np.testing.assert_allclose([column[f"q{i}"][7] for i in range(1, 8)], np.arange(7.0) / 10 + 0.007)
    said = (source.wrench_source, source.force_frame, source.length_unit, source.can_wait)
    assert said == ("joint_torque_estimate", "base", "m", False)
    assert source.hand_on_robot == "yes"


@pytest.mark.parametrize("arm", ARMS)
def test_a_torque_is_moved_from_the_stiffness_frame_to_the_flange(play, arm):
    # It was sent as libfranka has it, about K: 12 N at the hand were 1.2 Nm off.
    push, stiffness = np.array([12.0, 0.0, 0.0]), np.eye(4)
    stiffness[:3, 3] = [0.0, 0.0, 0.05]  # K is 0.05 m beyond the effector: 0.1534 m below the flange
    states = moving(20)
    for one in states:
        one.EE_T_K = stiffness
        one.O_F_ext_hat_K = np.concatenate([-push, np.zeros(3)])  # the environment pushes along x, at K
    source = play(arm, FrankaScript(states))
    column = dict(zip(source.columns, np.concatenate(chunks_of(source)[0]).T, strict=True))
    torque = [column[f"m{axis}"][0] for axis in "xyz"]
    np.testing.assert_allclose(torque, np.cross([0.0, 0.0, -0.1534], push), atol=1e-9)


@pytest.mark.parametrize("arm", ARMS)
def test_a_robot_that_no_person_guides_is_stated_as_such(play, arm):
    play(arm, FrankaScript(moving(1)))
    options = SourceOptions(host="172.16.0.2", gripper=False, hand_on_robot="no")
    assert open_source(arm, options).hand_on_robot == "no"
    for wrong, expected in (
        ({"hand_on_robot": "maybe"}, "'maybe', expected one of yes, no, unknown"),
        ({"wrench_source": "flange_sensor"}, f"expected joint_torque_estimate, which the source {arm} has"),
    ):
        with pytest.raises(SourceError, match=expected):
            open_source(arm, replace(options, **wrong))


@pytest.mark.parametrize("arm", ARMS)
def test_a_robot_that_is_lost_says_when_and_why(play, arm):
    chunks, said = chunks_of(play(arm, FrankaScript(moving(30))))
    assert [len(chunk) for chunk in chunks] == [20, 10]
    assert said == f"{arm} at 172.16.0.2: lost after 0.0 s: libfranka: UDP receive: Timeout"


@pytest.mark.parametrize("arm", ARMS)
def test_a_robot_that_does_not_answer_says_why(play, arm):
    with pytest.raises(SourceError, match=f"{arm} at 172.16.0.2: cannot connect: libfranka: refused"):
        play(arm, FrankaScript([], error="libfranka:\n refused"))


@pytest.mark.parametrize("arm", ARMS)
def test_a_gripper_is_a_column_that_keeps_its_last_width(play, arm):
    script = FrankaScript(moving(40))
    source = play(arm, script, gripper=True)
    assert script.asked[1] == ("Gripper", "172.16.0.2")
    reported = source.chunks()
    assert next(reported)[:, -1].tolist() == [0.08] * 20
    script.width = 0.03
    eventually(lambda: source._gripper.width == 0.03)
    assert next(reported)[:, -1].tolist() == [0.03] * 20
    reported.close()


@pytest.mark.parametrize("arm", ARMS)
def test_a_gripper_that_is_lost_ends_the_source(play, arm):
    script = FrankaScript(moving(40))
    source = play(arm, script, gripper=True)
    reported = source.chunks()
    next(reported)
    script.gripper_error = "connection closed"
    eventually(lambda: source._gripper.failure is not None)
    with pytest.raises(SourceError, match=r"the gripper was lost after 0\.0 s: connection closed"):
        next(reported)


@pytest.mark.parametrize("arm", ARMS)
def test_no_gripper_says_what_to_add(play, arm):
    script = FrankaScript(moving(3))
    script.gripper_error = "refused"
    with pytest.raises(
        SourceError, match=r"its gripper: cannot connect: refused \(without a gripper: --no-gr"
    ):
        play(arm, script, gripper=True)


@pytest.mark.parametrize("arm", ARMS)
def test_a_state_that_is_reported_twice_is_taken_once_and_one_that_was_missed_stays_missing(play, arm):
    states = [one for one in moving(60) for _ in range(2) if one.time_ms % 10]
    chunks, _ = chunks_of(play(arm, FrankaScript(states)))
    times = np.concatenate(chunks)[:, 0] * 1000
    assert (np.diff(times) >= 1).all()
    assert set(np.round(np.diff(times))) == {1, 2}


@pytest.mark.parametrize("arm", ARMS)
def test_the_bridge_sends_what_came_and_then_says_why_it_ended(play, arm, memory):
    with (
        FakeService(memory.transport()) as service,
        Bridge(memory.transport(), "cell-1", play(arm, FrankaScript(moving(200))), settings=QUICK) as bridge,
        pytest.raises(SourceError, match="UDP receive: Timeout"),
    ):
        bridge.run()
    assert service.rows() == 200
    assert service.state == "closed"


@pytest.mark.parametrize("arm", ARMS)
def test_a_missing_extra_is_named(monkeypatch, arm):
    monkeypatch.setitem(sys.modules, "franky", None)
    monkeypatch.setitem(sys.modules, "panda_py.libfranka", None)
    with pytest.raises(
        SourceError, match=rf"the source {arm} needs .*: pip install '\.\[{arm}\]' in a clone"
    ):
        open_source(arm, SourceOptions(host="172.16.0.2"))
    with pytest.raises(SourceError, match="needs --host"):
        open_source(arm, SourceOptions())


# --- poses ------------------------------------------------------------------------------------------------


def matrix_of(pose: Transform) -> np.ndarray:
    matrix = np.eye(4)
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    matrix[:3, :3] = np.array([rotate(pose.orientation, axis) for axis in axes]).T
    matrix[:3, 3] = pose.position
    return matrix


coordinates = st.floats(-2.0, 2.0)
quaternions = st.tuples(*[coordinates] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
poses = st.builds(
    lambda p, q: Transform(p, tuple((np.array(q) / np.linalg.norm(q)).tolist())),
    st.tuples(*[coordinates] * 3),
    quaternions,
)


@given(poses, poses)
def test_the_flange_times_the_effector_on_it_is_the_effector(flange, tool):
    effector = pose_of((matrix_of(flange) @ matrix_of(tool)).flatten(order="F"))
    np.testing.assert_allclose(matrix_of(flange_of(effector, tool)), matrix_of(flange), atol=1e-9)


@given(poses)
def test_a_matrix_and_its_pose_are_the_same_rotation(pose):
    found = pose_of(matrix_of(pose).flatten(order="F"))
    along = abs(np.dot(found.orientation, pose.orientation))
    assert along == pytest.approx(1.0, abs=1e-9)
    assert found.position == pytest.approx(pose.position)


@given(poses)
def test_without_a_tool_the_pose_is_untouched(pose):
    assert flange_of(pose, HERE) is pose
    assert flange_of(pose, Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))) is pose
    assert multiply(pose.orientation, HERE.orientation) == pytest.approx(pose.orientation)


# --- the fake against what it stands for ------------------------------------------------------------------


def test_franky_is_as_the_fake_has_it():
    real = pytest.importorskip("franky", reason="franky-control is not installed")
    for name in ("Robot", "Gripper", "Affine", "Duration", "NetworkException"):
        assert hasattr(real, name)
    assert issubclass(real.NetworkException, Exception)
    assert hasattr(real.RealtimeConfig, "Ignore")
    assert (int(real.RobotMode.Idle), int(real.RobotMode.Guiding)) == (IDLE, GUIDING)
    for name in vars(state(0)):
        assert name == "time_ms" or isinstance(getattr(real.RobotState, name), property)
    assert isinstance(real.RobotState.time, property)
    assert isinstance(real.Robot.state, property)
    assert isinstance(real.Gripper.state, property)
    assert isinstance(real.GripperState.width, property)
    assert "fci_hostname: str" in real.Robot.__init__.__doc__
    assert "realtime_config: " in real.Robot.__init__.__doc__
    assert real.Duration(7).to_msec() == Duration(7).to_msec()
    matrix = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    assert np.array_equal(real.Affine(matrix).matrix, Affine(matrix).matrix)
    with pytest.raises(real.Exception):
        real.Robot("127.0.0.1", realtime_config=real.RealtimeConfig.Ignore)


def test_panda_python_is_as_the_fake_has_it():
    panda_py = pytest.importorskip("panda_py", reason="panda-python is not installed")
    real = panda_py.libfranka
    assert "franka_address: str, realtime_config" in real.Robot.__init__.__doc__
    assert "franka_address: str" in real.Gripper.__init__.__doc__
    assert hasattr(real.RealtimeConfig, "kIgnore")
    assert (int(real.RobotMode.kIdle), int(real.RobotMode.kGuiding)) == (IDLE, GUIDING)
    for name in vars(state(0)):
        assert name == "time_ms" or isinstance(getattr(real.RobotState, name), property)
    assert callable(real.Robot.read_once)
    assert callable(real.Gripper.read_once)
    assert isinstance(real.GripperState.width, property)
    assert real.Duration(7).to_msec() == Duration(7).to_msec()
    with pytest.raises(RuntimeError):
        real.Robot("127.0.0.1", real.RealtimeConfig.kIgnore)

"""Arms of UFACTORY without hardware: what the SDK's reports become, and what is said when an arm is lost."""

from __future__ import annotations

import inspect
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_clients.bridge.sources import xarm_arm
from caesura_clients.bridge.sources.live_arm import LiveArm
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import pose_of_roll_pitch_yaw
from caesura_protocol.robots import robot_description
from clients.fake_xarm import PARAMETERS, STOP, XArmScript, fake_xarm, report
from clients.lost_arm import chunks_of
from harness.xarm_sdk import xarm_api

STATED = SourceOptions(
    host="10.0.0.3", robot="xarm7", tcp_offset="0,0,0.1,0,0,0", wrench_source="flange_sensor_with_hand"
)


@pytest.fixture
def play(monkeypatch):
    """An arm that plays a script, under the name of the SDK."""
    monkeypatch.setattr(xarm_arm, "SILENT_S", 0.01)

    def begin(script: XArmScript, options: SourceOptions = STATED) -> LiveArm:
        for name, module in fake_xarm(script).items():
            monkeypatch.setitem(sys.modules, name, module)
        return open_source("xarm", options)

    return begin


def moving(count: int) -> list:
    """Along x, the tool down."""
    return [
        report(cartesian=[400.0 + 0.1 * i, 100.0, 200.0, np.pi, 0.0, 0.0], joints=[0.1 * j for j in range(7)])
        for i in range(count)
    ]


def test_a_report_becomes_a_sample_of_the_flange(play):
    script = XArmScript(moving(20), force=[0.0, 0.0, -10.0, 0.1, 0.2, 0.3], connected=False)
    source = play(script)
    chunks, said = chunks_of(source)
    rows = np.concatenate(chunks)
    column = dict(zip(source.columns, rows.T, strict=True))
    np.testing.assert_allclose(column["px"], 0.4 + 1e-4 * np.arange(20))
    np.testing.assert_allclose(column["pz"], 0.3)  # the tool points down: the flange is above the TCP
    np.testing.assert_allclose([column[f"q{j}"][0] for j in range(1, 8)], 0.1 * np.arange(7))
    np.testing.assert_allclose([column[name][3] for name in ("fz", "mx", "my", "mz")], [-10.0, 0.1, 0.2, 0.3])
    assert (np.diff(column["t"]) > 0).all()
    assert (source.force_frame, source.wrench_source) == ("flange", "flange_sensor_with_hand")
    after_s = column["t"][-1]
    assert said.startswith(f"xarm7 at 10.0.0.3: lost after {after_s:.1f} s: the connection was closed")
    assert [call[0] for call in script.calls] == ["XArmAPI", "set_ft_sensor_enable", "disconnect"]
    assert script.calls[0][1:] == ("10.0.0.3", True, "real")


def test_without_a_sensor_there_is_no_wrench(play):
    source = play(XArmScript(moving(3)), replace(STATED, wrench_source="none"))
    assert not {"fx", "mx"} & set(source.columns)
    chunks, said = chunks_of(source)
    rows = np.concatenate(chunks)
    assert rows.shape == (3, len(source.columns))
    assert "no report for" in said


def test_teach_mode_zeroes_the_sensor_lets_go_and_holds_again(play):
    script = XArmScript(moving(3))
    source = play(script, replace(STATED, teach_mode=True))
    source.close()
    source.close()
    assert script.calls[1:] == [
        ("set_ft_sensor_enable", 1),
        ("set_ft_sensor_zero",),
        ("motion_enable",),
        ("set_mode", 0),
        ("set_state", 0),
        ("set_mode", 2),
        ("set_state", 0),
        ("set_mode", 0),
        ("set_state", 0),
        ("disconnect",),
    ]


def test_an_arm_that_was_in_another_mode_is_in_teach_mode_all_the_same(play):
    # The controller goes to mode 0 first and stays there: the arm could not be guided, and nothing said so.
    script = XArmScript([], mode=1)
    source = play(script, replace(STATED, teach_mode=True))
    modes = [call[1] for call in script.calls if call[0] == "set_mode"]
    source.close()
    assert modes == [0, 2]


def test_an_error_of_the_controller_ends_the_source(play):
    # A fast report has no error code: the one that the SDK hands on is always 0.
    stopped = XArmScript([*moving(2), report(state=STOP), report(state=STOP)], error=31)
    chunks, said = chunks_of(play(stopped))
    assert said.endswith("the controller's error is 31")
    assert sum(map(len, chunks)) == 2


def test_an_arm_that_was_stopped_without_an_error_is_read_on(play):
    chunks, said = chunks_of(
        play(XArmScript([*moving(2), report(state=STOP, cartesian=[410.0] + [0.0] * 5)]))
    )
    assert sum(map(len, chunks)) == 3
    assert "no report for" in said


@pytest.mark.parametrize(
    ("changed", "script", "said"),
    [
        ({"robot": None}, XArmScript([]), "the source xarm needs --robot, such as xarm7"),
        ({"tcp_offset": None}, XArmScript([]), "xarm7 at 10.0.0.3: where is its TCP"),
        ({"wrench_source": None}, XArmScript([]), "wrench_source is None, expected flange_sensor or"),
        ({"wrench_source": "joint_torque_estimate"}, XArmScript([]), "or none without it"),
        ({}, XArmScript([], refused="connect failed"), "xarm7 at 10.0.0.3: cannot connect: connect failed"),
        (
            {},
            XArmScript([], codes={"set_ft_sensor_enable": 9}),
            "its sensor: the SDK's code is 9, expected 0",
        ),
    ],
)
def test_what_is_missing_is_named(play, changed, script, said):
    with pytest.raises(SourceError, match=said):
        play(script, replace(STATED, **changed))


def test_roll_pitch_and_yaw_are_those_of_scipy():
    for turn in np.random.default_rng(2).uniform(-3.0, 3.0, (50, 3)):
        found = pose_of_roll_pitch_yaw((0.0, 0.0, 0.0), turn.tolist()).orientation
        expected = Rotation.from_euler("xyz", turn)  # about fixed axes
        assert (Rotation.from_quat(found).inv() * expected).magnitude() < 1e-9


def test_the_sdk_is_as_the_fake_has_it():
    real = xarm_api()
    for name, parameters in PARAMETERS.items():
        assert list(inspect.signature(getattr(real, name)).parameters)[1 : len(parameters) + 1] == parameters
    assert isinstance(real.ft_ext_force, property)
    assert isinstance(real.connected, property)
    assert isinstance(real.mode, property)
    assert list(inspect.signature(real.__init__).parameters)[1:3] == ["port", "is_radian"]


def test_an_xarm_is_listed_with_the_wrench_that_its_source_takes(play):
    # The list had an estimate by joint torques, which the source refuses: it does not read them.
    listed = robot_description("xarm7").wrench_source
    assert play(XArmScript(moving(3)), replace(STATED, wrench_source=listed)).wrench_source == listed

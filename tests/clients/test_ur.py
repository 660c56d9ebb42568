"""Arms of Universal Robots without hardware: what RTDE's states become, and what is said when one is lost."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_clients.bridge.sources.live_arm import LiveArm
from caesura_clients.bridge.sources.registry import SourceOptions, open_source
from caesura_protocol.errors import SourceError
from caesura_protocol.flange_pose import moved_wrench, pose_of_rotation_vector
from clients.fake_ur import SIGNATURES, UrScript, fake_ur, state
from clients.lost_arm import chunks_of
from clients.rtde_server import rtde_server

STATED = SourceOptions(host="10.0.0.2", robot="ur5e", tcp_offset="0,0,0.1,0,0,0")
DOWN = [np.pi, 0.0, 0.0]  # rotation vector: the tool points down


@pytest.fixture
def play(monkeypatch):
    """An arm that plays a script, under the names of ur_rtde's modules."""

    def begin(script: UrScript, options: SourceOptions = STATED) -> LiveArm:
        for name, module in fake_ur(script).items():
            monkeypatch.setitem(sys.modules, name, module)
        return open_source("ur", options)

    return begin


def moving(count: int, first_s: float = 5000.0) -> list:
    """Along x, pressing on the table with 10 N."""
    return [
        state(
            first_s + 0.002 * i,
            q=[0.1 * j + 0.001 * i for j in range(6)],
            pose=[0.4 + 1e-4 * i, 0.1, 0.2, *DOWN],
            wrench=[1.0, 0.0, 10.0, 0.0, 0.0, 0.5],
        )
        for i in range(count)
    ]


def test_a_state_becomes_a_sample_of_the_flange(play):
    script = UrScript(moving(40), connected=False, offset=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    source = play(script)
    chunks, said = chunks_of(source)
    column = dict(zip(source.columns, np.concatenate(chunks).T, strict=True))
    np.testing.assert_allclose(column["t"], 0.002 * np.arange(40), atol=1e-9)
    np.testing.assert_allclose(column["px"], 0.4 + 1e-4 * np.arange(40))
    np.testing.assert_allclose(column["pz"], 0.3)  # the tool points down: the flange is above the TCP
    np.testing.assert_allclose([column[name][0] for name in ("qx", "qy", "qz")], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose([column[f"q{j + 1}"][7] for j in range(6)], 0.1 * np.arange(6) + 0.007)
    np.testing.assert_allclose([column[f"f{axis}"][0] for axis in "xyz"], [1.0, 0.0, 10.0])
    # 1 N along x, 0.1 m below the flange, turns about −y there
    np.testing.assert_allclose([column[f"m{axis}"][0] for axis in "xyz"], [0.0, -0.1, 0.5], atol=1e-12)
    assert "q7" not in source.columns
    assert "tau1" not in source.columns
    assert said == "ur5e at 10.0.0.2: lost after 0.1 s: the controller has closed the connection"
    assert script.calls == ["receive.disconnect"]  # nothing was commanded


def test_a_state_that_changes_while_it_is_read_is_read_again(play):
    script = UrScript(moving(80), connected=False, torn=True)
    source = play(script)
    rows = np.concatenate(chunks_of(source)[0])
    column = dict(zip(source.columns, rows.T, strict=True))
    first = 5000.0 + 0.002 * round((column["px"][0] - 0.4) / 1e-4)
    np.testing.assert_allclose(column["px"], 0.4 + 1e-4 * (first - 5000.0 + column["t"]) / 0.002, atol=1e-9)


def test_a_torque_is_about_the_flange_whether_the_arm_has_a_sensor_or_not(play):
    # An e-Series arm reports it there, and it was moved by the TCP's offset once more.
    for is_cb3, source in ((False, None), (True, "joint_torque_estimate")):
        script = UrScript(moving(15), connected=False, offset=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0], is_cb3=is_cb3)
        arm = play(script, replace(STATED, wrench_source=source))
        rows = np.concatenate(chunks_of(arm)[0])
        torque = rows[0, [arm.columns.index(f"m{axis}") for axis in "xyz"]]
        np.testing.assert_allclose(torque, [0.0, -0.1, 0.5], atol=1e-12)


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ({"protective_stop": True}, "protective stop"),
        ({"emergency_stop": True}, "emergency stop"),
        ({}, "no state for 1 s"),
    ],
)
def test_an_arm_that_stops_says_why(play, ends, said):
    chunks, lost = chunks_of(play(UrScript(moving(15), **ends)))
    assert sum(map(len, chunks)) == 15
    assert lost == f"ur5e at 10.0.0.2: lost after 0.0 s: {said}"


def test_teach_mode_asks_for_the_tcp_zeroes_the_sensor_lets_go_and_holds_again(play):
    script = UrScript(moving(20), offset=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0], connected=False)
    source = play(script, replace(STATED, tcp_offset=None, teach_mode=True))
    assert script.calls == ["zeroFtSensor", "teachMode"]
    rows = np.concatenate(chunks_of(source)[0])
    np.testing.assert_allclose(rows[:, source.columns.index("pz")], 0.3)
    assert script.calls[2:] == ["endTeachMode", "stopScript", "disconnect", "receive.disconnect"]
    source.close()
    assert len(script.calls) == 6  # once


def test_a_command_that_is_not_carried_out_is_named(play):
    with pytest.raises(SourceError, match="teach mode: the controller did not execute it"):
        play(UrScript(moving(1), fails="teachMode"), replace(STATED, teach_mode=True))


def test_without_a_wrench_there_are_no_columns_for_one(play):
    source = play(UrScript(moving(12)), replace(STATED, wrench_source="none"))
    assert chunks_of(source)[0][0].shape[1] == len(source.columns) == 1 + 7 + 6


@pytest.mark.parametrize(
    ("hand", "stated", "declared"),
    [
        (None, None, ("flange_sensor_with_hand", "yes")),
        ("no", None, ("flange_sensor", "no")),
        (None, "joint_torque_estimate", ("joint_torque_estimate", "yes")),  # a CB3 has no sensor
    ],
)
def test_the_wrench_source_is_that_of_the_robots_data(play, hand, stated, declared):
    source = play(UrScript(moving(1)), replace(STATED, hand_on_robot=hand, wrench_source=stated))
    assert (source.wrench_source, source.hand_on_robot) == declared
    assert (source.force_frame, source.length_unit, source.can_wait) == ("base", "m", False)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"robot": None}, "the source ur needs --robot, such as ur5e or ur10e"),
        ({"host": None}, "the source ur needs --host"),
        ({"tcp_offset": None}, "ur5e at 10.0.0.2: where is its TCP"),
        ({"tcp_offset": "0,0,0.1"}, "tcp_offset is '0,0,0.1', expected six numbers"),
        ({"tcp_offset": "0,0,0.1,0,0,nan"}, "expected six numbers"),
        ({"wrench_source": "wrist"}, "wrench_source is 'wrist', expected one of flange_sensor"),
        ({"hand_on_robot": "maybe"}, "hand_on_robot is 'maybe', expected one of yes, no, unknown"),
    ],
)
def test_what_is_not_stated_is_asked_for(play, changed, said):
    with pytest.raises(SourceError, match=said):
        play(UrScript(moving(1)), replace(STATED, **changed))


def test_an_arm_that_does_not_answer_says_why(play):
    with pytest.raises(SourceError, match=r"ur5e at 10\.0\.0\.2: cannot connect: Could not connect"):
        play(UrScript(moving(1), refused="Could not connect to: 10.0.0.2 at 30004"))


def test_a_rotation_vector_is_the_rotation_of_scipy():
    for vector in np.random.default_rng(1).normal(size=(50, 3)) * np.geomspace(1e-8, 2.0, 50)[:, None]:
        found = pose_of_rotation_vector([0.1, 0.2, 0.3, *vector]).orientation
        np.testing.assert_allclose(found, Rotation.from_rotvec(vector).as_quat(), atol=1e-12)


def test_a_wrench_moves_as_its_lever_says():
    moved = moved_wrench([1.0, 2.0, 3.0, 0.4, 0.5, 0.6], (0.1, 0.2, 0.3), (0.0, 0.1, 0.5))
    np.testing.assert_allclose(
        moved[3:], np.array([0.4, 0.5, 0.6]) + np.cross([0.1, 0.1, -0.2], [1, 2, 3]), atol=1e-12
    )


@pytest.mark.parametrize("name", SIGNATURES)
def test_ur_rtde_is_as_the_fake_has_it(name):
    module, kind = name.split(".")
    pytest.importorskip(module, reason="ur_rtde is not installed")
    real = getattr(import_module(module), kind)
    for method, signature in SIGNATURES[name].items():
        assert f"{method}(self: {name}" in getattr(real, method).__doc__
        assert signature in getattr(real, method).__doc__, method
    with pytest.raises(RuntimeError):
        real("127.0.0.1")


def test_ur_rtde_itself_reads_a_controller_that_speaks_rtde():
    pytest.importorskip("rtde_receive", reason="ur_rtde is not installed")
    values = {
        "actual_q": [0.1, -1.2, 1.3, -1.4, -1.5, 0.6],
        "actual_TCP_pose": [0.4, 0.1, 0.2, *DOWN],
        "actual_TCP_force": [1.0, 0.0, 10.0, 0.0, 0.0, 0.5],
        "robot_status_bits": [0b111],  # power, program, teach button
    }
    with rtde_server(values) as controller:
        source = open_source("ur", replace(STATED, host="127.0.0.1"))
        reported = source.chunks()
        column = dict(zip(source.columns, next(reported).T, strict=True))
        assert source.button_pressed is True
        controller.kill()
        with pytest.raises(SourceError, match="lost after"):
            for _ in reported:
                pass
    assert np.diff(column["t"]).min() > 0.0
    np.testing.assert_allclose([column[f"q{j}"][0] for j in range(1, 7)], values["actual_q"])
    assert column["pz"][0] == pytest.approx(0.3)
    assert column["fz"][0] == 10.0

"""The script for xArm-Python-SDK: it runs against the SDK's own signatures, and has the program's numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import create_autospec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import App, ScrewMotion
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import (
    DOWN,
    as_file,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    wiped,
)
from harness.xarm_sdk import xarm_api

from .test_ur_script import circle

TABLE_N = [0.0, 0.0, -8.0, 0.0, 0.0, 0.0]


def on_xarm(apps: tuple[App, ...], **changed: Any) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": "xarm7", "gripper": "robotiq_2f_85"} | changed)


class Arm:
    """An arm behind the SDK's signatures: it is where it was sent, and feels a table below a height."""

    def __init__(self, table_m: float = -9.0, grasped: int = 2, wrench: list[float] | None = None) -> None:
        self.pose = [300.0, -300.0, 400.0, 3.14, 0.0, 0.0]
        self.table_m = table_m
        self.wrench = wrench
        self.api = create_autospec(xarm_api(), instance=True)
        for name in xarm_api().__dict__:
            if callable(getattr(self.api, name, None)) and not name.startswith("_"):
                getattr(self.api, name).return_value = 0
        self.api.tcp_offset, self.api.tcp_load = [0.0, 0.0, 172.0, 0.0, 0.0, 0.0], [0.8, [0.0, 0.0, 50.0]]
        self.api.robotiq_status = {"gOBJ": grasped}
        self.api.get_state.return_value = self.api.get_cmdnum.return_value = (0, 0)
        self.api.get_position_aa.side_effect = lambda *_: (0, list(self.pose))
        self.api.get_ft_sensor_data.side_effect = lambda *_: (0, self.felt())
        self.api.set_position_aa.side_effect = self.go
        self.api.vc_set_cartesian_velocity.side_effect = self.drift
        self.api.get_gripper_position.return_value = (0, 500)

    def felt(self) -> list[float]:
        if self.wrench is not None:
            return self.wrench
        return TABLE_N if self.pose[2] < 1000 * self.table_m else [0.0] * 6

    def go(self, pose: list[float], **stated: Any) -> int:
        self.pose = list(pose)
        return 0

    def drift(self, speeds: list[float], **stated: Any) -> int:
        self.pose = [p + 0.02 * v for p, v in zip(self.pose, speeds, strict=True)]
        return 0

    def calls(self, name: str) -> list[Any]:
        return [call for call in self.api.mock_calls if call[0] == name]

    def moves(self) -> np.ndarray:
        return np.array([call.args[0] for call in self.calls("set_position_aa")])


def module_of(program: ProgramFile) -> ModuleType:
    module = ModuleType("made")
    exec(compile(xarm_script(program), "made.py", "exec"), module.__dict__)
    module.__dict__["time"] = type("time", (), {"sleep": staticmethod(lambda seconds: None)})
    return module


def run(program: ProgramFile, **world: Any) -> Arm:
    arm, made = Arm(**world), module_of(program)
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    try:
        runner.run(made.APPS)
    finally:
        runner.close()
    return arm


def test_a_press_has_the_poses_and_the_force_of_the_program():
    arm = run(on_xarm(press()), table_m=0.185)
    touch, pressed, away = press()
    begun, left = arm.moves()
    np.testing.assert_allclose(begun[:3] / 1000, np.add(touch.target, (0.0, 0.0, 0.02)), atol=1e-6)
    np.testing.assert_allclose(left[:3] / 1000, away.target, atol=1e-6)
    assert (Rotation.from_rotvec(left[3:]) * Rotation.from_quat(DOWN).inv()).magnitude() < 1e-5
    frame, axes, newtons, *_ = arm.calls("set_ft_sensor_force_parameters")[0].args
    assert (frame, axes, newtons) == (0, [0, 0, 1, 0, 0, 0], [0, 0, pressed.force[2], 0, 0, 0])
    names = [call[0] for call in arm.api.mock_calls]
    assert names.index("set_ft_sensor_zero") < names.index("vc_set_cartesian_velocity")
    modes = [call.args[0] for call in arm.calls("set_ft_sensor_mode")]
    assert modes[:2] == [2, 0]


def test_a_stroke_presses_before_its_way_and_after_it_as_long_as_it_was_taught():
    made = module_of(on_xarm(wiped()))
    stroke = made.APPS[1]
    assert (stroke["wait"], stroke["hold"]) == pytest.approx((0.8, 0.5))
    assert stroke["legs"]
    done: list[object] = []
    made.time = SimpleNamespace(sleep=done.append)
    runner = create_autospec(made.Runner, instance=True)
    runner.arm = create_autospec(xarm_api(), instance=True)
    runner.arm.set_ft_sensor_mode.side_effect = lambda mode: done.append(f"mode {mode}")
    runner.pose.return_value = [0.0] * 6
    runner.go.side_effect = lambda legs, tight: done.append("way")
    runner.stay.side_effect = lambda seconds, began: done.append(seconds)
    made.Runner.press(runner, stroke)
    assert done[-4:] == [stroke["wait"], "way", stroke["hold"], "mode 0"]
    done.clear()
    made.Runner.stay(runner, 0.8, [0.0] * 3)
    assert sum(done) == pytest.approx(0.8)
    runner.pose.return_value = [0.0, 0.0, -0.06, 0.0, 0.0, 0.0]
    with pytest.raises(made.Stop, match="pushed in by more than"):
        made.Runner.stay(runner, 0.8, [0.0] * 3)


def test_the_offset_of_the_tcp_is_taken_off_and_put_back():
    arm = run(on_xarm(press()), table_m=0.185)
    offsets = [call.args[0] for call in arm.calls("set_tcp_offset")]
    assert offsets == [[0.0] * 6, [0.0, 0.0, 172.0, 0.0, 0.0, 0.0]]
    assert arm.api.mock_calls[-1][0] == "disconnect"


def test_a_contact_that_is_not_there_stops_the_program():
    made = module_of(on_xarm(press()))
    arm = Arm()
    with pytest.raises(made.Stop, match=r"no contact within 0\.04 m"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    assert arm.calls("vc_set_cartesian_velocity")[-1].args[0] == [0.0] * 6


def test_the_sensor_is_zeroed_where_nothing_is_touched():
    arm, made = Arm(table_m=0.11), module_of(on_xarm(set_down_at_once()))
    zeroed_mm: list[float] = []
    arm.api.set_ft_sensor_zero.side_effect = lambda *_: zeroed_mm.append(arm.pose[2]) or 0
    made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    assert len(zeroed_mm) >= 2
    assert min(zeroed_mm) > 110.0


def test_a_force_beyond_the_limit_stops_the_program():
    made = module_of(on_xarm((circle(),)))
    arm = Arm(wrench=[0.0, 31.0, 0.0, 0.0, 0.0, 0.0])
    arm.api.get_state.return_value = (0, 1)
    with pytest.raises(made.Stop, match=r"stopped at 31\.0 N, the limit is 30 N"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    assert [call.args[0] for call in arm.calls("set_state")][-2:] == [4, 0]


def test_pick_and_place_grips_carries_its_load_and_lets_it_go():
    arm = run(on_xarm(pick_and_place()), table_m=0.11)
    counts = [
        (call.args[0], call.kwargs["speed"], call.kwargs["force"])
        for call in arm.calls("robotiq_set_position")
    ]
    assert counts == [(123, 59, 0), (16, 59, 0)]
    loads = [(call.args[0], call.args[1]) for call in arm.calls("set_tcp_load")]
    assert loads == [(pytest.approx(kg), [0.0, 0.0, 50.0]) for kg in (1.05, 1.05, 0.8)]


@pytest.mark.parametrize(
    ("gripper", "call", "first"),
    [("xarm_gripper", "set_gripper_position", (400,)), ("xarm_vacuum", "set_vacuum_gripper", (True,))],
)
def test_ufactorys_own_grippers_are_driven(gripper, call, first):
    arm = run(on_xarm(pick_and_place(), gripper=gripper), table_m=0.11)
    assert arm.calls(call)[0].args == first
    assert len(arm.calls(call)) == 2


def test_what_is_not_grasped_stops_the_program():
    made = module_of(on_xarm(pick_and_place()))
    arm = Arm(table_m=0.11, grasped=3)
    with pytest.raises(made.Stop, match="nothing between the fingers"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)


def test_a_path_is_followed_by_legs_with_blends_no_faster_than_the_limit():
    way = circle()
    arm = run(on_xarm((way,), safety=Safety(speed_m_per_s=0.06)))
    _, *legs = arm.calls("set_position_aa")
    np.testing.assert_allclose(legs[-1].args[0][:3], np.multiply(1000, way.target), atol=1e-3)
    assert all(0.0 < leg.kwargs["speed"] <= 60.0 for leg in legs)
    assert all(leg.kwargs["radius"] > 0.0 for leg in legs[:-1])
    assert legs[-1].kwargs["radius"] is None


@pytest.mark.parametrize(("felt_nm", "tight"), [(1.4, False), (1.6, True), (-1.6, True)])
def test_a_turn_ends_where_it_is_tight(felt_nm, tight):
    screw = ScrewMotion(
        axis=(0, 0, 1), point=(0.45, 0, 0.3), angle=1.6, pitch_m=0.001, pitch_sd_m=0.0, torque=(0.0, 0.0, 1.0)
    )
    made = module_of(on_xarm((circle(screw=screw),)))
    arm = Arm(wrench=[0.0, 0.0, 0.0, 0.0, 0.0, felt_nm])
    arm.api.get_state.side_effect = [(0, 0), (0, 1), (0, 1), *[(0, 0)] * 9]
    made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    assert (4 in [call.args[0] for call in arm.calls("set_state")]) == tight


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (on_xarm(press(), robot="ur5e"), "an xArm script is for UFACTORY's arms, and its robot is ur5e"),
        (on_xarm(pick_and_place(), gripper="franka_hand"), "the SDK does not drive a Franka Hand"),
        (on_xarm(pick_and_place(), gripper=None), "no gripper is stated, expected --gripper robotiq_2f_85"),
        (on_xarm(press(), safety=Safety(felt_force_n=5.0)), "force 10.0 N, at most 4.8 N"),
    ],
)
def test_what_cannot_be_run_is_refused_by_name(program, said):
    with pytest.raises(ValueError, match=said):
        xarm_script(program)


def test_a_force_along_an_axis_of_the_tool_is_in_its_frame_and_any_other_is_refused():
    leant = Rotation.from_quat(DOWN) * Rotation.from_euler("x", 40, degrees=True)
    touch, pressed, _ = press()
    along = tuple((10.0 * leant.as_matrix()[:, 2]).tolist())
    tilted = pressed.model_copy(update={"orientation": tuple(leant.as_quat().tolist()), "force": along})
    text = xarm_script(on_xarm((touch, tilted)))
    assert "'force': (1, 2, 10.0)" in text
    aside = tilted.model_copy(update={"orientation": DOWN})
    with pytest.raises(ValueError, match=r"app 2 \(apply force\): force .* N, expected one along an axis"):
        xarm_script(on_xarm((touch, aside)))


def test_a_dry_run_needs_neither_the_sdk_nor_a_robot(tmp_path: Path):
    file = tmp_path / "made.py"
    file.write_text(xarm_script(on_xarm(pick_and_place())))
    command = [sys.executable, "-S", str(file)]
    done = subprocess.run([*command, "--dry-run"], capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == 6
    refused = subprocess.run([*command, "--robot", "10.0.0.3"], capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "pip install xarm-python-sdk" in refused.stderr


def test_a_rest_beside_a_way_is_pressed_with_its_own_force():
    made = module_of(on_xarm(pressed_harder_before()))
    done: list[object] = []
    runner = create_autospec(made.Runner, instance=True)
    runner.arm = create_autospec(xarm_api(), instance=True)
    runner.pose.return_value = [0.0] * 6
    runner.aim.side_effect = lambda frame, axis, newtons: done.append(newtons)
    runner.go.side_effect = lambda legs, tight: done.append("way")
    runner.stay.side_effect = lambda seconds, began: done.append("rest")
    made.Runner.press(runner, made.APPS[1])
    assert done == [-12.0, "rest", -10.0, "way", -5.0, "rest"]

"""The script for xArm-Python-SDK: it runs against the SDK's own signatures, and has the program's numbers."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

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
    over_barrel,
    path_from,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    wiped,
)
from harness.xarm_sdk import RecordedApi

from .test_ur_script import circle, slid

FRAME_S = 0.01
TABLE_N = [0.0, 0.0, -8.0, 0.0, 0.0, 0.0]


def on_xarm(apps: tuple[App, ...], **changed: Any) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": "xarm7", "gripper": "robotiq_2f_85"} | changed)


class Arm:
    """An arm behind the SDK's signatures: it is where it was sent, and feels a table below a height."""

    def __init__(self, table_m: float = -9.0, grasped: int = 2, wrench: list[float] | None = None) -> None:
        self.pose = [300.0, -300.0, 400.0, 3.14, 0.0, 0.0]
        self.table_m = table_m
        self.wrench = wrench
        self.api = RecordedApi()
        self.api.tcp_offset, self.api.tcp_load = [0.0, 0.0, 172.0, 0.0, 0.0, 0.0], [0.8, [0.0, 0.0, 50.0]]
        self.api.robotiq_status = {"gOBJ": grasped}
        self.api.get_state.return_value = self.api.get_cmdnum.return_value = (0, 0)
        self.api.get_err_warn_code.return_value = (0, [0, 0])
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


class MovingArm(Arm):
    """Movements, and what a force pushes along -z, take their time, which passes while the script sleeps.

    surface_m: the height of what is pressed on, at x and y [m].
    """

    def __init__(self, surface_m: Callable[[float, float], float], **world: Any) -> None:
        super().__init__(**world)
        self.surface_m = surface_m
        self.queue: list[tuple[list[float], float]] = []
        self.velocity = [0.0] * 6
        self.presses = False
        self.api.get_state.side_effect = lambda: (0, 1 if self.queue else 2)
        self.api.get_cmdnum.side_effect = lambda: (0, len(self.queue))
        self.api.set_state.side_effect = self.set_state
        self.api.set_ft_sensor_mode.side_effect = self.set_ft_sensor_mode

    def set_state(self, state: int) -> int:
        if state == 4:
            self.queue.clear()
        return 0

    def set_ft_sensor_mode(self, mode: int) -> int:
        self.presses = mode == 2
        return 0

    def felt(self) -> list[float]:
        x, y, z = np.array(self.pose[:3]) / 1000
        return TABLE_N if z <= self.surface_m(x, y) + 1e-6 else [0.0] * 6

    def go(self, pose: list[float], **stated: Any) -> int:
        self.queue.append((list(pose), stated["speed"]))
        return 0

    def drift(self, speeds: list[float], **stated: Any) -> int:
        self.velocity = list(speeds)
        return 0

    def sleep(self, seconds: float) -> None:
        for _ in range(round(seconds / FRAME_S)):
            self.pose = [p + FRAME_S * v for p, v in zip(self.pose, self.velocity, strict=True)]
            x, y, z = np.array(self.pose[:3]) / 1000
            if self.presses:
                self.pose[2] = 1000 * max(z - 0.03 * FRAME_S, self.surface_m(x, y))
            if self.queue:
                pose, speed = self.queue[0]
                way = np.subtract(pose, self.pose)
                way[2] *= not self.presses
                share = min(1.0, speed * FRAME_S / max(float(np.linalg.norm(way[:3])), 1e-9))
                self.pose = [p + share * w for p, w in zip(self.pose, way.tolist(), strict=True)]
                if share == 1.0:
                    self.queue.pop(0)


def module_of(program: ProgramFile, sleep: Callable[[float], object] = lambda seconds: None) -> ModuleType:
    module = ModuleType("made")
    exec(compile(xarm_script(program), "made.py", "exec"), module.__dict__)
    module.__dict__["time"] = SimpleNamespace(sleep=sleep)
    return module


def moved(program: ProgramFile, arm: MovingArm) -> None:
    made = module_of(program, arm.sleep)
    made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)


def stopped(program: ProgramFile, arm: MovingArm) -> str:
    """What a script says where it stops by itself; the arm holds then, and presses nothing."""
    with pytest.raises(Exception, match="app") as raised:
        moved(program, arm)
    assert type(raised.value).__name__ == "Stop"
    assert not arm.presses
    assert not arm.queue
    assert arm.velocity == [0.0] * 6
    assert [call.args[0] for call in arm.calls("set_mode")][-1] == 0
    assert arm.calls("set_state")[-1].args[0] == 0
    return str(raised.value)


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


def done_in_a_press(program: ProgramFile) -> list[object]:
    """The forces that a script sets [N], the seconds that it presses with them, and its way, in order."""
    done: list[Any] = []
    arm = Arm(table_m=0.19)

    def note(what: object) -> int:
        done.append(what)
        return 0

    made = module_of(program, note)
    (stroke,) = (app for app in made.APPS if "force" in app)
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    arm.pose[:3] = [1000 * value for value in stroke["way"][0]]
    arm.api.set_ft_sensor_force_parameters.side_effect = lambda frame, axes, forces, *_: note(
        f"{sum(forces)} N"
    )
    arm.api.set_ft_sensor_mode.side_effect = lambda mode: note(f"mode {mode}")
    runner.go = lambda legs, over: done.append("way")
    runner.press(stroke)
    summed: list[object] = []
    for one in done:
        if isinstance(one, float) and summed and isinstance(summed[-1], float):
            summed[-1] = round(summed[-1] + one, 6)
        else:
            summed.append(one)
    return summed


def test_a_stroke_presses_before_its_way_and_after_it_as_long_as_it_was_taught():
    done = done_in_a_press(on_xarm(wiped()))
    assert done == ["-10.0 N", "mode 2", 0.8, "-10.0 N", "way", "-10.0 N", 0.5, "mode 0"]


def test_a_press_lasts_as_long_as_it_was_taught():
    assert done_in_a_press(on_xarm(press())) == ["-10.0 N", "mode 2", 1.6, "mode 0"]


def test_rests_beside_a_way_that_is_none_are_pressed_with_their_own_forces():
    # A stroke without legs was pressed with one force.
    touch, stroke = pressed_harder_before()
    assert stroke.path is not None
    still = path_from(stroke.path.start.position, stroke.path.start.t, stroke.path.tn, 0.0)
    pressed = stroke.model_copy(update={"path": still, "target": stroke.path.start.position})
    done = done_in_a_press(on_xarm((touch, pressed)))
    assert done == ["-12.0 N", "mode 2", 0.8, "-10.0 N", 1.0, "-5.0 N", 0.5, "mode 0"]


def test_a_surface_that_ends_in_the_middle_of_a_stroke_stops_the_program():
    # Only the rests beside a way were looked at.
    arm = MovingArm(lambda x, y: 0.19 if x < 0.02 else 0.0)
    said = stopped(on_xarm(slid(4.0)), arm)
    assert re.match(
        r"app 2 \(apply force\): nothing to press on: 0\.04\d m beyond its way at 0\.0 N, at most", said
    )
    assert said.endswith("at most 0.04 m")
    assert 0.0 < arm.pose[0] < 78.0  # in the middle of its way
    assert arm.pose[2] == pytest.approx(150.0, abs=2.0)


def test_a_rest_after_a_way_that_has_lost_its_surface_stops_the_program():
    touch, stroke = slid(1.0)
    rest = stroke.model_copy(update={"tn": stroke.tn + 4.0})
    arm = MovingArm(lambda x, y: 0.19 if x < 0.07 else 0.0)
    assert "nothing to press on" in stopped(on_xarm((touch, rest)), arm)
    assert arm.pose[0] == pytest.approx(80.0)
    assert arm.pose[2] == pytest.approx(150.0, abs=2.0)


def test_a_surface_that_leads_down_is_followed_as_it_was_taught():
    arm = MovingArm(lambda x, y: 0.19 - 0.6 * max(x + 0.02, 0.0))
    moved(on_xarm(slid(4.0, down_m=0.06)), arm)
    assert arm.pose[2] == pytest.approx(130.0, abs=2.0)


@pytest.mark.parametrize("early_m", [0.1, 0.03])
def test_a_contact_far_before_where_it_was_taught_stops_the_program(early_m: float):
    # What was met 100 mm above the table was pressed.
    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    program = on_xarm((touch.model_copy(update={"path": from_above}), pressed, away))
    arm = MovingArm(lambda x, y: 0.19 + early_m)
    if early_m < Safety().search_m:
        moved(program, arm)
        assert arm.calls("set_ft_sensor_force_parameters")
        return
    said = stopped(program, arm)
    assert said == "app 1 (move to contact): contact 0.100 m from where it was taught, at most 0.04 m"
    assert not arm.calls("set_ft_sensor_force_parameters")


def test_an_arm_that_stops_by_itself_does_not_go_on_with_the_next_app():
    # Where the controller had stopped it, a movement passed for done, and the fingers closed there.
    class Collides(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.pose[2] < 200.0:
                self.queue.clear()
                self.api.get_state.side_effect = lambda: (0, 4)
                self.api.get_err_warn_code.return_value = (0, [31, 0])

    said = stopped(on_xarm(pick_and_place()), arm := Collides(lambda x, y: -9.0))
    assert said == "app 1 (move to contact): the arm was stopped, the controller's error is 31"
    assert not arm.calls("robotiq_set_position")


def test_the_reason_of_a_stop_is_not_that_of_what_fails_after_it():
    # The mode that is set after a stop was refused by an arm in an error: that stood there instead.
    arm = MovingArm(lambda x, y: 0.19 if x < 0.02 else 0.0)
    arm.api.set_mode.side_effect = lambda mode: 0 if arm.pose[2] > 160.0 else 1
    assert "nothing to press on" in stopped(on_xarm(slid(4.0)), arm)


def test_the_offset_of_the_tcp_is_taken_off_and_put_back():
    arm = run(on_xarm(press()), table_m=0.185)
    offsets = [call.args[0] for call in arm.calls("set_tcp_offset")]
    assert offsets == [[0.0] * 6, [0.0, 0.0, 172.0, 0.0, 0.0, 0.0]]
    assert arm.api.mock_calls[-1][0] == "disconnect"


def test_a_contact_that_is_not_there_stops_the_program():
    made = module_of(on_xarm(press()))
    arm = Arm()
    with pytest.raises(made.Stop, match=r"app 1 .move to contact.: no contact within 0\.04 m"):
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
        (
            on_xarm(press(), robot="ur5e"),
            "UFACTORY's arms, and the program's robot is ur5e: use --format urscript",
        ),
        (on_xarm(pick_and_place(), gripper="franka_hand"), "the SDK does not drive a Franka Hand"),
        (
            on_xarm(pick_and_place(), gripper=None),
            "no gripper is stated, expected --gripper, or Gripper in the dashboard: robotiq_2f_85",
        ),
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
    said = "leans by 40.0° from the axis z of the base, at most 20°: teach it again, pushing along the axis"
    with pytest.raises(ValueError, match=rf"app 2 \(apply force\): its force {said} of the tool"):
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


def test_a_dry_run_names_what_it_prints(tmp_path: Path):
    # A press was "0 legs  force (0, 2, -10.0)".
    file = tmp_path / "made.py"
    file.write_text(xarm_script(on_xarm(press())))
    command = [sys.executable, "-S", str(file), "--dry-run"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    (pressed,) = [line for line in said.splitlines() if "apply force" in line]
    seconds = next(app.tn - app.t0 for app in press() if app.kind == "apply_force")
    assert f"presses with -10.0 N along z of the base  rests for {seconds:.1f} s" in pressed
    assert " leg to [" in said
    assert "0 legs" not in said


def test_a_rest_beside_a_way_is_pressed_with_its_own_force():
    done = done_in_a_press(on_xarm(pressed_harder_before()))
    assert done == ["-12.0 N", "mode 2", 0.8, "-10.0 N", "way", "-5.0 N", 0.5, "mode 0"]


def test_the_force_turns_with_a_tool_that_is_tilted():
    # Over a barrel it kept an axis of the base: at both ends it leaned by 30° from the normal.
    assert "'force': (1, 2, 10.0)" in xarm_script(on_xarm(over_barrel()))
    assert "'force': (0, 2, -10.0)" in xarm_script(on_xarm(wiped()))


def test_the_sensor_is_zeroed_before_the_first_movement():
    # The way to the first place was watched with whatever the sensor had as its zero.
    arm = run(on_xarm((circle(),)))
    names = [call[0] for call in arm.api.mock_calls]
    assert names.index("set_ft_sensor_zero") < names.index("set_position_aa")


@pytest.mark.parametrize(("degrees", "said"), [(14.0, True), (2.0, False)])
def test_a_force_that_leans_a_little_is_pressed_along_the_axis_and_the_script_says_so(
    degrees: float, said: bool
):
    # Presses by hand lean by 7 to 17 degrees: of seven scenarios with a press six had no script.
    touch, pressed, away = press()
    force = Rotation.from_euler("x", degrees, degrees=True).apply([0.0, 0.0, -10.0])
    text = xarm_script(on_xarm((touch, pressed.model_copy(update={"force": tuple(force.tolist())}), away)))
    assert "'force': (0, 2, -10.0)" in text
    comment = "    # warning: its force leans by 14° from the axis z of the base, along which it presses"
    assert (comment in text.splitlines()) == said


def test_a_force_is_pressed_along_the_axis_from_which_it_leans_least():
    leant = Rotation.from_quat(DOWN) * Rotation.from_euler("x", 15, degrees=True)
    touch, pressed, _ = press()
    along = tuple((10.0 * leant.as_matrix()[:, 2]).tolist())
    tilted = pressed.model_copy(update={"orientation": tuple(leant.as_quat().tolist()), "force": along})
    assert "'force': (1, 2, 10.0)" in xarm_script(on_xarm((touch, tilted)))


@pytest.mark.parametrize("height_m", [0.25, 0.195])
def test_an_interrupted_script_stops_the_arm(height_m: float):
    # After Ctrl-C the arm went on with the legs that were sent.
    class Interrupted(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.pose[2] < 1000 * height_m and (self.queue or any(self.velocity)):
                raise KeyboardInterrupt

    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    arm = Interrupted(lambda x, y: 0.19)
    with pytest.raises(KeyboardInterrupt):
        moved(on_xarm((touch.model_copy(update={"path": from_above}), pressed, away)), arm)
    assert not arm.queue
    assert arm.velocity == [0.0] * 6


def test_an_interrupted_press_stops_its_way_before_its_force_ends():
    class Interrupted(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.presses and self.queue and self.pose[0] > 20.0:
                raise KeyboardInterrupt

        def set_ft_sensor_mode(self, mode: int) -> int:
            assert mode == 2 or not self.queue
            return super().set_ft_sensor_mode(mode)

    arm = Interrupted(lambda x, y: 0.19)
    with pytest.raises(KeyboardInterrupt):
        moved(on_xarm(slid(4.0)), arm)
    assert not arm.presses


def test_a_tool_that_is_tilted_loses_its_surface_along_its_own_axis():
    # The depth counted along the force of the middle: tilted by 70°, 45 mm off the way were 83 mm.
    program = on_xarm(over_barrel(half_degrees=70))
    made, arm = module_of(program), Arm()
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    stroke, path = made.APPS[1], program.apps[1].path
    assert path is not None
    arm.pose = [*(1000 * value for value in stroke["way"][0]), *stroke["legs"][0][0][3:]]
    arm.pose[3:] = Rotation.from_quat(path.start.orientation).as_rotvec().tolist()
    beyond = runner.depth_beyond(stroke)
    end = stroke["legs"][-1][0]
    axis = Rotation.from_rotvec(end[3:]).apply([0.0, 0.0, 1.0])
    arm.pose = [*(1000 * (np.array(end[:3]) + 0.045 * axis)).tolist(), *end[3:]]
    assert beyond() == pytest.approx(0.045, abs=0.002)


def test_an_arm_without_a_sensor_keeps_the_offset_of_its_tcp():
    # It was taken off first: the next program of the pendant would have moved the tool by its length too far.
    made, arm = module_of(on_xarm(press())), Arm()
    arm.api.set_ft_sensor_enable.return_value = 1
    with pytest.raises(made.Stop, match="the sensor: the SDK's code is 1"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    assert not arm.calls("set_tcp_offset")


def test_an_offset_of_the_tcp_that_is_not_put_back_is_said(capsys: pytest.CaptureFixture[str]):
    # After a lost connection the arm had no offset, and no message said so.
    made, arm = module_of(on_xarm(press())), Arm()
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    arm.api.set_tcp_offset.return_value = -1
    runner.close()
    assert arm.calls("disconnect")
    assert "offset of the TCP was not put back: [0.0, 0.0, 172.0, 0.0, 0.0, 0.0]" in capsys.readouterr().err


@pytest.mark.parametrize("state", [4, 5])
def test_an_arm_that_is_not_ready_any_more_does_not_go_on(state: int):
    # The SDK counts both states as stopped; in 5 a movement passed for done.
    made, arm = module_of(on_xarm((circle(),))), Arm()
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    arm.api.get_state.return_value = (0, state)
    with pytest.raises(made.Stop, match="the arm was stopped"):
        runner.run(made.APPS)


def test_a_lost_connection_says_that_the_arm_may_go_on(capsys: pytest.CaptureFixture[str]):
    # The controller goes on with its legs and its force, and the script said that it had stopped.
    class Lost(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.presses and self.queue and self.pose[0] > 20.0:
                for name in ("set_state", "set_mode", "set_ft_sensor_mode", "set_tcp_offset"):
                    getattr(self.api, name).side_effect = lambda *_: -1
                self.api.get_state.side_effect = lambda: (-1, "xArm is not connect")

    arm = Lost(lambda x, y: 0.19)
    with pytest.raises(Exception, match=r"app 2 \(apply force\): .*the SDK's code is -1"):
        moved(on_xarm(slid(4.0)), arm)
    said = capsys.readouterr().err
    assert said.count("the arm does not answer: it may still move and press, stop it at its button") == 1


@pytest.mark.parametrize(("off_mm", "closes"), [(20.0, True), (50.0, False)])
def test_the_fingers_do_not_close_where_the_arm_stands_elsewhere(off_mm: float, closes: bool):
    # A recording that begins at the object has no way there: the fingers closed wherever the arm stood.
    arm, made = Arm(), module_of(on_xarm(pick_and_place()[1:]))
    arm.pose = [-14.0, -673.0, 107.0 + off_mm, 3.14, 0.0, 0.0]
    runner = made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    with nullcontext() if closes else pytest.raises(made.Stop, match=r"app 1 .grasp.: the arm is 0.050 m"):
        runner.run(made.APPS[:1])
    assert bool(arm.calls("robotiq_set_position")) == closes


def test_the_first_way_is_slow_where_only_the_fingers_moved_before_it():
    # Fingers that open first counted as a movement: the arm went to its first place as fast as it was taught.
    opened = pick_and_place()[4].model_copy(update={"t0": 0.0, "tn": 0.1})
    arm = run(on_xarm((opened, *press())), table_m=0.185)
    first = arm.calls("set_position_aa")[0]
    assert first.kwargs["speed"] == pytest.approx(100.0)

"""The script for xArm-Python-SDK: it runs against the SDK's own signatures, and has the program's numbers."""

from __future__ import annotations

import math
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import ScrewMotion
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import (
    app,
    circle,
    path_from,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    slid,
    squeezed,
)

from .xarm_runs import Arm, MovingArm, module_of, moved, on_xarm, run, stopped


@pytest.mark.parametrize("gripper", ["xarm_gripper", "robotiq_2f_85", "xarm_vacuum"])
def test_a_gripper_without_the_force_and_speed_of_the_cell_is_named(gripper):
    text = xarm_script(on_xarm(pick_and_place(), gripper=gripper))
    said = "# warning: force and speed of the fingers are those set at the gripper, not the 20 N and 0.05 m/s"
    assert (said in text) == (gripper == "xarm_gripper")
    assert said not in xarm_script(on_xarm(press(), gripper=gripper))


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
    carrying = pytest.approx([0.0, 0.0, (0.8 * 50.0 + 0.25 * 172.0) / 1.05])
    assert loads == [(pytest.approx(1.05), carrying), (0.8, [0.0, 0.0, 50.0])]


def test_a_grip_is_eased_by_opening_the_fingers_and_grasping_again():
    arm = run(on_xarm(squeezed()), table_m=0.11)
    counts = [call.args[0] for call in arm.calls("robotiq_set_position")]
    assert counts == [123, 177, 96, 123, 16]  # 40, 20, 50, 40 and 80 mm of 85


def test_a_gripper_that_is_activated_is_not_activated_again():
    # The SDK activated it at the first grasp: the fingers shut, on the part, and opened all the way.
    assert not run(on_xarm(pick_and_place()), table_m=0.11).was_activated


def test_a_gripper_that_is_not_activated_stops_the_program_before_anything_moves():
    made, arm = module_of(on_xarm(pick_and_place())), Arm(table_m=0.11)
    arm.api.robotiq_status["gSTA"] = 0
    with pytest.raises(made.Stop, match="the gripper is not activated"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    assert not arm.moves().size
    assert not arm.calls("robotiq_set_position")


def test_a_controller_that_does_not_report_is_not_run():
    # Its offset and load were taken for zero: the load of the tool was taken off with the first grasp.
    made, arm = module_of(on_xarm(press())), Arm()
    made.__dict__["REPORT_S"] = 0.01
    arm.api.register_report_callback.side_effect = lambda callback: True
    with pytest.raises(made.Stop, match=r"no report of the controller within 0\.01 s"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3")
    assert not arm.calls("set_tcp_offset")


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


@pytest.mark.parametrize("gripper", ["robotiq_2f_85", "xarm_gripper", "xarm_vacuum"])
def test_what_falls_on_its_way_stops_the_program_before_it_is_set_down(gripper):
    # The empty fingers went on to where the part was to be set down, and up to 40 mm beyond.
    made, arm = module_of(on_xarm(pick_and_place(), gripper=gripper)), Arm(table_m=0.11)

    def go(pose: list[float], **stated: Any) -> int:
        if arm.calls("set_tcp_load"):
            arm.drop()
        return Arm.go(arm, pose, **stated)

    arm.api.set_position_aa.side_effect = go
    with pytest.raises(made.Stop, match=r"app 3 .transport.: nothing between the fingers any more"):
        made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    order = [call[0] for call in arm.api.mock_calls]
    assert "vc_set_cartesian_velocity" not in order[order.index("set_tcp_load") :]  # no surface is looked for


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
        (on_xarm(press(), safety=Safety(force_n=5.0)), "force 10.0 N, at most 5.0 N"),
    ],
)
def test_what_cannot_be_run_is_refused_by_name(program, said):
    with pytest.raises(ValueError, match=said):
        xarm_script(program)


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


def test_a_dry_run_states_the_forces_of_rests(capsys: pytest.CaptureFixture[str]):
    made = module_of(on_xarm(pressed_harder_before()))
    made.say(2, made.APPS[1])
    said = capsys.readouterr().out
    assert "presses with -10.0 N along z of the base" in said
    assert "-12.0 N before its way  -5.0 N after its way" in said


def test_a_dry_run_refuses_what_a_run_refuses(tmp_path: Path):
    file = tmp_path / "made.py"
    file.write_text(xarm_script(on_xarm(pressed_harder_before(newton=40.0))))
    command = [sys.executable, "-S", str(file), "--dry-run"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert not done.stdout
    assert "stopped: app 2 (apply force): force 40.0 N" in done.stderr


def test_the_sensor_is_zeroed_before_the_first_movement():
    # The way to the first place was watched with whatever the sensor had as its zero.
    arm = run(on_xarm((circle(),)))
    names = [call[0] for call in arm.api.mock_calls]
    assert names.index("set_ft_sensor_zero") < names.index("set_position_aa")


@pytest.mark.parametrize("height_m", [0.25, 0.195])
def test_an_interrupted_script_stops_the_arm(height_m: float):
    # After Ctrl-C the arm went on with the legs that were sent.
    class InterruptedMove(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.pose[2] < 1000 * height_m and (self.queue or any(self.velocity)):
                raise KeyboardInterrupt

    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    arm = InterruptedMove(lambda x, y: 0.19)
    with pytest.raises(KeyboardInterrupt):
        moved(on_xarm((touch.model_copy(update={"path": from_above}), pressed, away)), arm)
    assert not arm.queue
    assert arm.velocity == [0.0] * 6


SDK = """
import sys

class XArmAPI:
    tcp_offset, tcp_load = [0.0] * 6, (0.0, [0.0] * 3)
    ANSWERS = {"get_state": (0, 1), "get_cmdnum": (0, 1)}  # it moves

    def __init__(self, host, is_radian):
        pass

    def register_report_callback(self, callback):
        callback({})

    def set_position_aa(self, *where, **how):
        print("moves", file=sys.stderr, flush=True)
        return 0

    def set_state(self, state):
        print("state", state, file=sys.stderr, flush=True)
        return 0

    def __getattr__(self, name):
        is_read = name in ("get_position_aa", "get_ft_sensor_data")
        return lambda *_, **__: (0, [0.0] * 6) if is_read else self.ANSWERS.get(name, 0)
"""


def test_a_script_that_is_terminated_stops_the_arm(tmp_path: Path):
    """It ended at once, as where its service is stopped: the controller followed the legs that were sent."""
    (tmp_path / "xarm").mkdir()
    (tmp_path / "xarm" / "__init__.py").touch()
    (tmp_path / "xarm" / "wrapper.py").write_text(SDK)
    file = tmp_path / "made.py"
    file.write_text(xarm_script(on_xarm((circle(),))))
    command = [sys.executable, str(file), "--robot", "10.0.0.3"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as script:
        assert script.stderr is not None
        try:
            assert any(line == "moves\n" for line in script.stderr)
            script.terminate()
            assert "state 4" in script.communicate(timeout=30.0)[1].splitlines()
        finally:
            script.kill()


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
    class LostArm(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.presses and self.queue and self.pose[0] > 20.0:
                for name in ("set_state", "set_mode", "set_ft_sensor_mode", "set_tcp_offset"):
                    getattr(self.api, name).side_effect = lambda *_: -1
                self.api.get_state.side_effect = lambda: (-1, "xArm is not connect")

    arm = LostArm(lambda x, y: 0.19)
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
    first, began = arm.calls("set_position_aa")[0], Arm().pose
    turn = Rotation.from_rotvec(first.args[0][3:]) * Rotation.from_rotvec(began[3:]).inv()
    slowly = 0.3 * math.dist(first.args[0][:3], began[:3]) / turn.magnitude()
    assert first.kwargs["speed"] == pytest.approx(min(100.0, slowly))


@pytest.mark.parametrize("off_mm", [0.0, 1.0, 50.0, 400.0])
def test_the_way_to_the_first_place_turns_slowly(off_mm: float):
    """An arm that stood near the start, and was turned, turned as fast as it can."""
    arm = Arm()
    x, y, z, *_ = arm.pose  # turned by half a turn about x
    there = ((x + off_mm) / 1000.0, y / 1000.0, z / 1000.0)
    about_y = (0.0, 1.0, 0.0, 0.0)
    path = path_from(there, 0.0, 1.0, 0.05, about_y)
    way = app("cartesian_motion", 0.0, 1.0, (there[0], there[1], there[2] - 0.05), path=path)
    made = module_of(on_xarm((way.model_copy(update={"orientation": about_y}),)))
    made.Runner(lambda host, is_radian: arm.api, "10.0.0.3").run(made.APPS)
    speed = arm.calls("set_position_aa")[0].kwargs["speed"]
    seconds = math.pi / speed if off_mm == 0.0 else off_mm / speed
    assert math.pi / seconds <= 0.3 + 1e-3
    assert speed <= 100.0


@pytest.mark.parametrize(("seconds", "slower"), [(6.0, False), (60.0, True)])
def test_a_turn_in_place_that_the_sdk_makes_faster_is_named(seconds: float, slower: bool):
    # The SDK raises a speed to 0.1 mm/s, and so a rate of turn to 0.1 rad/s: 90° in 60 s took 16 s.
    first, turned = press()[2], (0.0, 1.0, 0.0, 0.0)
    path = path_from(first.target, first.tn, first.tn + seconds, 0.0)
    turn = app("cartesian_motion", first.tn, path.tn, first.target, orientation=turned, path=path)
    program = on_xarm((first, turn))
    said = "and the SDK turns in place with at least 0.1 rad/s"
    assert (said in xarm_script(program)) == slower
    rates = [call.kwargs["speed"] for call in run(program).calls("set_position_aa")]
    assert (min(rates) < 0.1) == slower

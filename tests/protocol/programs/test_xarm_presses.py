"""The script for xArm-Python-SDK where it presses: its force, its way, and a surface that ends."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.xarm_script import xarm_script
from harness.programs import DOWN, over_barrel, path_from, press, pressed_harder_before, slid, wiped

from .xarm_runs import Arm, MovingArm, module_of, moved, on_xarm, run, stopped


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


def test_a_rest_beside_a_way_is_pressed_with_its_own_force():
    done = done_in_a_press(on_xarm(pressed_harder_before()))
    assert done == ["-12.0 N", "mode 2", 0.8, "-10.0 N", "way", "-5.0 N", 0.5, "mode 0"]


def test_the_force_turns_with_a_tool_that_is_tilted():
    # Over a barrel it kept an axis of the base: at both ends it leaned by 30° from the normal.
    assert "'force': (1, 2, 10.0)" in xarm_script(on_xarm(over_barrel()))
    assert "'force': (0, 2, -10.0)" in xarm_script(on_xarm(wiped()))


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


def test_an_interrupted_press_stops_its_way_before_its_force_ends():
    class InterruptedPress(MovingArm):
        def sleep(self, seconds: float) -> None:
            super().sleep(seconds)
            if self.presses and self.queue and self.pose[0] > 20.0:
                raise KeyboardInterrupt

        def set_ft_sensor_mode(self, mode: int) -> int:
            assert mode == 2 or not self.queue
            return super().set_ft_sensor_mode(mode)

    arm = InterruptedPress(lambda x, y: 0.19)
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

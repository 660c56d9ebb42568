"""The script for franky where it presses: its force, its way, and surfaces that are not where they were."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import AppPath, ViaPoint
from caesura_protocol.programs.contact_forces import touching_force
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.safety import Safety
from harness.programs import (
    DOWN,
    as_file,
    barrel_m,
    curved,
    over_barrel,
    press,
    pressed_harder_before,
    slid,
    wiped,
)

from . import fake_franky
from .franky_runs import flanges, module_of, motions, over_surface, pressed_n, run, stopped


def test_a_press_that_slides_follows_its_path_across_the_force() -> None:
    apps = list(curved())
    path = AppPath(
        start=ViaPoint(t=2.6, position=(-0.02, -0.52, 0.2), orientation=DOWN), tn=4.2,
        length_m=0.1, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    apps[1] = apps[1].model_copy(update={"path": path, "target": (0.08, -0.52, 0.19)})
    calls = motions(run(as_file(tuple(apps))))
    pressed = next(m for m in calls if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion))
    begin, *_, end = flanges(pressed)
    assert end.translation[0] - begin.translation[0] == pytest.approx(0.1, abs=1e-3)


def test_a_stroke_presses_where_it_is_before_its_way_and_after_it() -> None:
    calls = motions(run(as_file(wiped())))
    pressed = next(m for m in calls if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion))
    begin, *followed = flanges(pressed)
    ways = np.array([one.translation[0] for one in followed]) - begin.translation[0]
    assert len(ways) == 115  # 2.3 s, one each 20 ms
    still = np.abs(np.diff(ways)) < 1e-9
    assert np.flatnonzero(~still)[[0, -1]].tolist() == pytest.approx([40, 89], abs=1)
    assert ways[-1] == pytest.approx(0.1, abs=1e-3)


def test_a_rest_beside_a_way_is_pressed_with_its_own_force(capsys: pytest.CaptureFixture[str]) -> None:
    made = module_of(as_file(pressed_harder_before()))
    stroke = made.APPS[1]
    newtons = [made.newtons_at(stroke, t, 1.0) for t in (0.0, 0.79, 0.81, 1.79, 1.81, 2.3)]
    assert newtons == pytest.approx([12.0, 12.0, 10.0, 10.0, 5.0, 5.0])
    assert made.newtons_at(stroke, 1.81, 2.0) == pytest.approx(10.0)  # twice as slow, the way is not over yet
    made.say(2, stroke)
    assert "12.0 N before its path  5.0 N after its path" in capsys.readouterr().out


def test_a_rest_beyond_the_limit_is_refused_before_anything_moves() -> None:
    made = module_of(as_file(pressed_harder_before()))
    made.APPS[1]["before_n"] = 40.0
    with pytest.raises(made.Stop, match=r"force 40\.0 N"):
        made.checked(made.APPS)
    limited = {"safety": Safety(force_n=28.5)}
    with pytest.raises(ValueError, match=r"app 2 .*force 40\.0 N, at most 28\.5 N"):
        franky_script(as_file(pressed_harder_before(newton=40.0)).model_copy(update=limited))


def test_over_a_bend_the_contact_is_looked_for_where_the_fingers_point() -> None:
    """The force of a stroke over a barrel leans away from the one with which it is touched."""
    touch, stroke = wiped()
    leaning = (0.0, 6.0, -8.0)
    assert touching_force(stroke.model_copy(update={"force": leaning})) == leaning
    over = Rotation.from_euler("x", 60.0, degrees=True) * Rotation.from_quat(DOWN)
    bent = stroke.model_copy(update={"force": leaning, "orientation": tuple(over.as_quat().tolist())})
    assert touching_force(bent) is None
    made = module_of(as_file((touch, bent)))
    assert made.press_direction(*made.APPS) == pytest.approx((0.0, 0.0, -1.0), abs=1e-5)
    about_force = Rotation.from_euler("z", 120.0, degrees=True) * Rotation.from_quat(DOWN)
    screwed = stroke.model_copy(update={"orientation": tuple(about_force.as_quat().tolist())})
    assert touching_force(screwed) == stroke.force


def test_a_press_that_turns_follows_its_orientation() -> None:
    apps, turned = list(curved()), (0.0, 1.0, 0.0, 0.0)
    path = AppPath(
        start=ViaPoint(t=2.6, position=(-0.02, -0.52, 0.19), orientation=DOWN), tn=4.2,
        length_m=0.0, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    apps[1] = apps[1].model_copy(update={"path": path, "target": (-0.02, -0.52, 0.19), "orientation": turned})
    calls = motions(run(as_file(tuple(apps))))
    pressed = next(m for m in calls if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion))
    followed = [one.quaternion for one in flanges(pressed)[1:]]
    assert list(followed[0]) == pytest.approx(DOWN, abs=1e-3)
    assert list(followed[-1]) == pytest.approx(turned, abs=1e-3)
    assert all(sum(x * x for x in quaternion) == pytest.approx(1.0) for quaternion in followed)


def test_a_press_follows_the_force_within_its_reach_and_ends_with_a_stop() -> None:
    calls = run(as_file(press()))
    pressed = next(m for m in motions(calls) if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion))
    begin = flanges(pressed)[0].translation
    offsets = [float(begin[2] - one.translation[2]) for one in flanges(pressed)]
    assert 0.0 < max(offsets) <= 0.05
    assert max(offsets) * pressed.stiffness < Safety().felt_force_n
    assert isinstance(pressed.reactions[0].motion, fake_franky.TorqueStopMotion)
    assert isinstance(motions(calls)[-2], fake_franky.TorqueStopMotion)


def test_a_surface_that_ends_in_the_middle_of_a_stroke_stops_the_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The tool went on 50 mm below its way, through the air.
    said = stopped(monkeypatch, as_file(slid(4.0)), lambda x, y: 0.19 if x < 0.02 else 0.0)
    assert re.fullmatch(
        r"app 2 \(apply force\): nothing to press on: 0\.04\d m beyond its way at 0\.0 N, at most 0\.04 m",
        said,
    )


def test_a_surface_that_leads_down_is_followed_as_it_was_taught(monkeypatch: pytest.MonkeyPatch) -> None:
    program = as_file(slid(4.0, down_m=0.06))
    made, runner = over_surface(monkeypatch, program, lambda x, y: 0.19 - 0.6 * max(x + 0.02, 0.0))
    runner.run(made.APPS)
    assert runner.robot.flange.translation[2] == pytest.approx(0.13, abs=1e-3)


@pytest.mark.parametrize("rise", [0.4, -0.4])
def test_a_slope_is_pressed_as_hard_as_it_was_taught(monkeypatch: pytest.MonkeyPatch, rise: float) -> None:
    # The setpoint stayed at the height of the touch: 40 mm above it 20 N were pressed in place of 10.
    program = as_file(slid(4.0, down_m=-0.1 * rise))
    felt = pressed_n(monkeypatch, program, lambda x, y: 0.19 + rise * min(max(x + 0.02, 0.0), 0.1))
    assert felt[-20:] == pytest.approx([10.0] * 20, abs=1.5)


def test_friction_is_no_part_of_a_press(monkeypatch: pytest.MonkeyPatch) -> None:
    # The size of all that was felt was compared: of 10 N along the normal 9 were pressed.
    monkeypatch.setattr(fake_franky.MovingRobot, "friction", 0.5)
    felt = pressed_n(monkeypatch, as_file(wiped()), lambda x, y: 0.19)
    assert felt[-20:] == pytest.approx([10.0] * 20, abs=0.2)


def test_what_is_pushed_in_is_no_lost_surface_and_has_its_force_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The setpoint stayed within 50 mm of the touch: 43 mm deep 3.5 N were left of 10.
    touch, pressed, _ = press()
    deep = pressed.model_copy(update={"target": (-0.02, -0.52, 0.145), "tn": pressed.tn + 6.0})

    def giving_way(x: float, y: float) -> float:
        tracked = fake_franky.CartesianImpedanceTrackingMotion
        return 0.147 if any(isinstance(one, tracked) for one in motions(fake_franky.calls)) else 0.19

    program = as_file((touch, deep))
    assert pressed_n(monkeypatch, program, giving_way)[-20:] == pytest.approx([10.0] * 20, abs=1.0)


def test_the_largest_force_that_a_program_may_ask_for_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    # The setpoint went 50 mm beyond the surface at most, which is 25 N.
    touch, pressed, _ = press()
    hard = pressed.model_copy(update={"force": (0.0, 0.0, -28.0), "tn": pressed.tn + 6.0})
    felt = pressed_n(monkeypatch, as_file((touch, hard)), lambda x, y: 0.19)
    assert felt[-20:] == pytest.approx([28.0] * 20, abs=1.0)
    assert max(felt) < Safety().felt_force_n


def test_a_press_keeps_the_flange_where_it_touches(monkeypatch: pytest.MonkeyPatch) -> None:
    # The end effector got the orientation of the flange: with a Franka Hand the tool turned by 45 degrees.
    made, runner = over_surface(monkeypatch, as_file(slid(4.0)), lambda x, y: 0.19)
    runner.run(made.APPS)
    pressing = fake_franky.CartesianImpedanceTrackingMotion
    pressed = next(motion for motion in motions(fake_franky.calls) if isinstance(motion, pressing))
    turned = Rotation.from_quat([one.quaternion for one in flanges(pressed)]) * Rotation.from_quat(DOWN).inv()
    assert turned.magnitude().max() < 1e-5


def test_the_force_turns_with_a_tool_that_is_tilted(monkeypatch: pytest.MonkeyPatch) -> None:
    # Over a barrel it kept the direction of the top: at both ends it leaned by 30° from the normal.
    program = as_file(over_barrel())
    made, runner = over_surface(monkeypatch, program, barrel_m)
    runner.run(made.APPS)
    pressing = fake_franky.CartesianImpedanceTrackingMotion
    pressed = next(motion for motion in motions(fake_franky.calls) if isinstance(motion, pressing))
    _, *_, last = flanges(pressed)
    begun = flanges(pressed)[0].translation
    way = np.subtract(program.apps[1].target, program.apps[1].path.start.position)
    pushed = last.translation - (begun + way)
    axis = Rotation.from_quat(last.quaternion).apply([0.0, 0.0, 1.0])
    assert pushed @ axis > 0.01
    assert np.linalg.norm(np.cross(pushed, axis)) < 0.05 * (pushed @ axis)


def test_an_interrupted_press_ends_its_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    # Ctrl-C left the impedance to the end of the process.
    made, runner = over_surface(monkeypatch, as_file(press()), lambda x, y: 0.19)

    def interrupted(robot: Any, timeout: float | None = None) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(fake_franky.MovingRobot, "join_motion", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runner.run(made.APPS)
    assert isinstance(motions(fake_franky.calls)[-1], fake_franky.TorqueStopMotion)


def test_a_short_press_reaches_its_force_no_faster_than_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    # The force came by a time constant of a second: a press of 1.3 s ended at 73 % of its force. Without a
    # surface the setpoint of a press with 28 N fell at 56 mm/s.
    touch, pressed, _ = press()
    short = pressed.model_copy(update={"tn": pressed.t0 + 1.3})
    felt = pressed_n(monkeypatch, as_file((touch, short)), lambda x, y: 0.19)
    assert felt[-1] == pytest.approx(10.0, rel=0.05)
    assert max(felt) < 10.5
    hard = pressed.model_copy(update={"force": (0.0, 0.0, -28.0)})
    pressed_n(monkeypatch, as_file((touch, hard)), lambda x, y: 0.19)
    pressing = fake_franky.CartesianImpedanceTrackingMotion
    tracked = next(motion for motion in motions(fake_franky.calls) if isinstance(motion, pressing))
    heights = np.array([one.translation[2] for one in flanges(tracked)])
    assert np.abs(np.diff(heights)).max() <= 0.03 * 0.02 + 1e-9  # a period of 20 ms


@pytest.mark.parametrize(("newton", "rise_m"), [(10.0, -0.03), (5.0, 0.035), (28.0, -0.035)])
def test_a_surface_off_its_way_is_pressed_as_hard_as_a_low_limit_of_force_allows(
    monkeypatch: pytest.MonkeyPatch, newton: float, rise_m: float
) -> None:
    # The setpoint kept within the largest force over the stiffness of the way: with a limit of 10 N a surface
    # 16 mm lower stopped the program, and with one of 5 N a surface 35 mm higher was pressed with 12.5 N.
    touch, stroke = slid(4.0)
    stroke = stroke.model_copy(update={"force": (0.0, 0.0, -newton), "tn": stroke.tn + 4.0})
    program = as_file((touch, stroke)).model_copy(update={"safety": Safety(force_n=newton)})
    felt = pressed_n(monkeypatch, program, lambda x, y: 0.19 + 10.0 * rise_m * min(max(x + 0.02, 0.0), 0.1))
    assert felt[-20:] == pytest.approx([newton] * 20, rel=0.03)
    assert max(felt) < newton + 3.0  # it lags behind a slope


@pytest.mark.parametrize("n_per_m", [500.0, 2000.0])
def test_what_gives_way_is_pressed_as_hard_as_a_low_limit_of_force_allows(
    monkeypatch: pytest.MonkeyPatch, n_per_m: float
) -> None:
    # With a cell's limit of 10 N, 5 of 10 N reached what gives way by 1 mm with 0.5 N.
    touch, pressed, _ = press()
    assert touch.target is not None
    soft = pressed.model_copy(update={"target": touch.target, "tn": pressed.tn + 4.0})
    program = as_file((touch, soft)).model_copy(update={"safety": Safety(force_n=10.0)})
    monkeypatch.setattr(fake_franky.MovingRobot, "surface_n_per_m", n_per_m)
    felt = pressed_n(monkeypatch, program, lambda x, y: 0.19)
    assert felt[-20:] == pytest.approx([10.0] * 20, rel=0.03)
    assert max(felt) < 10.5


class SpringRobot(fake_franky.MovingRobot):
    """A flange with a mass behind the impedance, on a surface that is a spring; its force is known late.

    The impedance has the damping that franky's has: critical for 1 kg.
    """

    mass_kg, surface_n_per_m, delay_s = 5.0, 20e3, 0.0
    STEP_S = 1e-4

    def __init__(self, host: str) -> None:
        super().__init__(host)
        self.speed = 0.0
        self.pressed_n: list[float] = []

    def join_motion(self, timeout: float | None = None) -> bool:
        reference = self._tracked.references[-1].target * fake_franky.RobotState.F_T_EE.inverse
        stiffness, (x, y, wanted) = self._tracked.stiffness, reference.translation
        z, wanted, speed = float(self.flange.translation[2]), float(wanted), self.speed
        surface_n_per_m, mass_kg, step_s = self.surface_n_per_m, self.mass_kg, self.STEP_S
        damping = 2.0 * math.sqrt(stiffness)
        assert timeout is not None
        for _ in range(round(timeout / step_s)):
            pressed = max(surface_n_per_m * (0.19 - z), 0.0)
            speed += step_s * (stiffness * (wanted - z) - damping * speed + pressed) / mass_kg
            z += step_s * speed
            self.pressed_n.append(pressed)
        self.speed = speed
        self.flange = fake_franky.Affine((x, y, z), reference.quaternion)
        return False

    def felt_n(self) -> float:
        if not self.pressed_n:
            return super().felt_n()
        return self.pressed_n[max(len(self.pressed_n) - 1 - round(self.delay_s / self.STEP_S), 0)]


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("mass_kg", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("n_per_m", [20e3, 2e3, 500.0])
def test_a_force_settles_on_what_is_stiff_and_on_what_gives_way(
    monkeypatch: pytest.MonkeyPatch, n_per_m: float, mass_kg: float, delay_s: float
) -> None:
    touch, pressed, _ = press()
    rest = pressed.model_copy(update={"target": touch.target, "tn": pressed.tn + 3.0})
    monkeypatch.setattr(fake_franky, "MovingRobot", SpringRobot)
    for name, value in (("surface_n_per_m", n_per_m), ("mass_kg", mass_kg), ("delay_s", delay_s)):
        monkeypatch.setattr(SpringRobot, name, value)
    made, runner = over_surface(monkeypatch, as_file((touch, rest)), lambda x, y: 0.19)
    runner.run(made.APPS)
    felt = runner.robot.pressed_n
    assert max(felt) < 10.5
    assert np.abs(np.array(felt[-10000:]) - 10.0).max() < 0.1  # the last second

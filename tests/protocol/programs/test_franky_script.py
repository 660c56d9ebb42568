"""The script for franky: it compiles, runs against a fake of its API, and keeps to its limits."""

from __future__ import annotations

import inspect
import math
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.app_kinds import APP_KINDS, AppKind
from caesura_protocol.messages import App, AppPath, ScrewMotion, ViaPoint
from caesura_protocol.programs import franky_script as writer
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.franky_script import franky_script
from caesura_protocol.programs.limits import touching_force
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import path_in_words
from harness.programs import (
    DOWN,
    app,
    as_file,
    barrel_m,
    over_barrel,
    path_from,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    wiped,
)

from . import fake_franky
from .test_ur_script import slid


def module_of(program: ProgramFile) -> ModuleType:
    module = ModuleType("made")
    exec(compile(franky_script(program), "made.py", "exec"), module.__dict__)
    module.__dict__["time"] = type("time", (), {"sleep": staticmethod(lambda seconds: None)})
    return module


def run(program: ProgramFile) -> list[tuple[str, dict[str, Any]]]:
    fake_franky.calls.clear()
    made = module_of(program)
    made.Runner(fake_franky, "robot").run(made.checked(made.APPS))
    return list(fake_franky.calls)


def motions(calls: list[tuple[str, dict[str, Any]]]) -> list[Any]:
    return [arguments["motion"] for name, arguments in calls if name == "move"]


def flanges(pressed: fake_franky.CartesianImpedanceTrackingMotion) -> list[fake_franky.Affine]:
    """The poses of the flange to which a press leads the robot."""
    return [one.target * fake_franky.RobotState.F_T_EE.inverse for one in pressed.references]


def over_surface(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> tuple[ModuleType, Any]:
    """A script, and its runner of a robot over a surface."""
    fake_franky.calls.clear()
    monkeypatch.setattr(fake_franky, "Robot", fake_franky.MovingRobot)
    monkeypatch.setattr(fake_franky.MovingRobot, "surface_m", staticmethod(surface_m), raising=False)
    made = module_of(program)
    return made, made.Runner(fake_franky, "robot")


def stopped(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> str:
    """What a script says where it stops by itself; no motion goes on then."""
    made, runner = over_surface(monkeypatch, program, surface_m)
    with pytest.raises(made.Stop) as raised:
        runner.run(made.APPS)
    assert not isinstance(motions(fake_franky.calls)[-1], fake_franky.CartesianImpedanceTrackingMotion)
    return str(raised.value)


def pressed_n(
    monkeypatch: pytest.MonkeyPatch, program: ProgramFile, surface_m: Callable[[float, float], float]
) -> list[float]:
    """The forces [N] with which a script presses on a surface, one a period."""
    felt: list[float] = []
    joined = fake_franky.MovingRobot.join_motion

    def join_motion(robot: Any, timeout: float | None = None) -> bool:
        ended = joined(robot, timeout)
        felt.append(robot.felt_n())
        return ended

    made, runner = over_surface(monkeypatch, program, surface_m)
    monkeypatch.setattr(fake_franky.MovingRobot, "join_motion", join_motion)
    runner.run(made.APPS)
    return felt


def test_poses_of_the_fake_are_multiplied_as_scipys() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        (p, q), turns = rng.standard_normal((2, 3)), Rotation.from_quat(rng.standard_normal((2, 4)))
        one, other = (fake_franky.Affine(t, r.as_quat()) for t, r in zip((p, q), turns, strict=True))
        both, back = one * other, one.inverse
        assert both.translation == pytest.approx(p + turns[0].apply(q), abs=1e-12)
        assert (Rotation.from_quat(both.quaternion).inv() * turns[0] * turns[1]).magnitude() < 1e-12
        assert back.translation == pytest.approx(-turns[0].inv().apply(p), abs=1e-12)
        assert (Rotation.from_quat(back.quaternion) * turns[0]).magnitude() < 1e-12


def test_limits_stand_at_the_top_and_are_those_of_the_program() -> None:
    safety = Safety(speed_m_per_s=0.25, felt_force_n=20.0)
    made = module_of(as_file(press()).model_copy(update={"safety": safety}))
    for name, (field, _) in writer.CONSTANTS.items():
        assert getattr(made, name) == getattr(safety, field)
    text = franky_script(as_file(press()))
    assert text.index("MAX_SPEED_M_PER_S =") < text.index("APPS =") < text.index("def ")


def test_pick_and_place_grips_carries_its_load_and_lets_it_go() -> None:
    calls = run(as_file(pick_and_place()))
    names = [name for name, _ in calls if name in ("grasp", "fingers", "load")]
    assert names == ["grasp", "load", "load", "fingers", "load"]
    assert [a["kg"] for name, a in calls if name == "load"] == [0.25, 0.25, 0.0]
    ends = [len(motion.reactions) for motion in motions(calls)]
    assert ends == [
        1,
        0,
        1,
        0,
    ]  # a contact ends the approach, and setting down; the others go to their targets


def test_a_contact_that_ends_is_left_before_another_one_is_looked_for() -> None:
    # The force was zeroed while the tool still pressed on the table: what was let go passed for a contact.
    fake_franky.calls.clear()
    made = module_of(as_file(set_down_at_once()))
    runner = made.Runner(fake_franky, "robot")
    runner.run(made.checked(made.APPS))
    carried = [motion for motion in motions(fake_franky.calls) if hasattr(motion, "waypoints")]
    over, (*_, end) = (motion.waypoints for motion in carried)
    assert over[-1].target.pose.translation.tolist() == [-0.018, -0.624, 0.156]
    assert end.target.pose.translation[2] == pytest.approx(0.127)
    assert [len(motion.reactions) for motion in carried] == [0, 1]
    assert [one.minimum_time.milliseconds for one in (over[-1], end)] == [1700, 1800]
    assert runner.bias[2] == 0.0


def test_it_sets_what_the_robot_itself_watches_before_it_moves() -> None:
    names = [name for name, _ in run(as_file(press()))]
    assert names.index("collision") < names.index("move")
    assert ("collision", {"torque": 20.0, "force": 30.0}) in fake_franky.calls


def test_no_movement_is_faster_than_the_limit_however_short_it_was_taught() -> None:
    hurried = [app.model_copy(update={"t0": 0.1 * i, "tn": 0.1 * i + 0.1}) for i, app in enumerate(press())]
    limits = [a["value"] for name, a in run(as_file(tuple(hurried))) if name == "limit"]
    assert max(limits) == Safety().speed_m_per_s
    assert limits[0] == 0.1  # from wherever the robot is


def curved(speed: float = 0.1) -> tuple[App, ...]:
    """A press after a way around a corner."""
    touch, *rest = press()
    place, flat = (-0.03, -0.56, 0.3), (speed, 0.0, 0.0)
    path = AppPath(
        start=ViaPoint(t=0.8, position=(-0.03, -0.6, 0.33), orientation=DOWN),
        via=(
            ViaPoint(t=1.8, position=place, orientation=DOWN, velocity=flat),
            ViaPoint(t=2.5, position=(-0.02, -0.52, 0.195), orientation=DOWN, velocity=flat),
        ),
        tn=2.6, length_m=0.2, deviation_m=0.001, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    return touch.model_copy(update={"path": path}), *rest


def test_a_path_is_followed_by_its_via_points_with_their_velocities_and_times() -> None:
    calls = motions(run(as_file(curved())))
    assert calls[0].target.translation.tolist() == [-0.03, -0.6, 0.33]  # to its start, slowly
    first, last = calls[1].waypoints  # what lies within the stand-off before a contact is left out
    assert first.target.pose.translation.tolist() == [-0.03, -0.56, 0.3]
    assert first.target.velocity.linear.tolist() == [0.1, 0.0, 0.0]
    assert (first.minimum_time.milliseconds, last.minimum_time.milliseconds) == (1000, 800)
    assert last.target.velocity.linear.tolist() == [0.0, 0.0, 0.0]
    assert len(calls[1].reactions) == 1


def test_a_path_that_was_taught_faster_than_the_limit_is_followed_slower() -> None:
    (first, _) = motions(run(as_file(curved(speed=0.96))))[1].waypoints
    assert first.target.velocity.linear[0] == pytest.approx(0.48)  # and a quarter is left to the limit
    assert first.minimum_time.milliseconds == 2000


def corner(*, pause_s: float = 0.0, contact: bool = False) -> ProgramFile:
    """Two movements without a stop between them, or with a pause; the second may meet a contact."""
    begin, middle, end = (0.3, -0.6, 0.33), (0.4, -0.6, 0.33), (0.4, -0.5, 0.33)
    velocity = (0.05, 0.05, 0.0)
    first = path_from(begin, 0.0, 1.0, 0.1).model_copy(update={"end_velocity": velocity})
    second = path_from(middle, 1.0 + pause_s, 2.0 + pause_s, 0.1)
    second = second.model_copy(update={"start": second.start.model_copy(update={"velocity": velocity})})
    kind = "move_to_contact" if contact else "cartesian_motion"
    apps = (
        app("cartesian_motion", 0.0, 1.0, middle, path=first),
        app(kind, 1.0 + pause_s, 2.0 + pause_s, end, path=second),
    )
    return as_file((*apps, app("apply_force", 2.0, 3.0, end, force=(0.0, 0.0, -5.0))) if contact else apps)


def test_a_corner_that_a_hand_did_not_stop_at_is_passed_in_one_motion() -> None:
    to_start, motion = motions(run(corner()))
    assert to_start.target.translation.tolist() == [0.3, -0.6, 0.33]
    middle, end = motion.waypoints
    assert middle.target.pose.translation.tolist() == [0.4, -0.6, 0.33]
    assert middle.target.velocity.linear.tolist() == [0.05, 0.05, 0.0]
    assert end.target.velocity.linear.tolist() == [0.0, 0.0, 0.0]
    assert [one.minimum_time.milliseconds for one in (middle, end)] == [1000, 1000]


@pytest.mark.parametrize("program", [corner(pause_s=0.5), corner(contact=True)])
def test_before_a_pause_and_a_contact_the_robot_stops(program: ProgramFile) -> None:
    """A contact is looked for by a motion of its own: it would end at what the first movement leaves."""
    _, first, *_ = motions(run(program))
    (middle,) = first.waypoints
    assert middle.target.velocity.linear.tolist() == [0.0, 0.0, 0.0]


def turning(seconds: float, *, by_path: bool) -> ProgramFile:
    """A turn by 90° in place, after a movement."""
    first, turned = press()[2], (0.0, 1.0, 0.0, 0.0)
    moving = app("cartesian_motion", first.tn, first.tn + seconds, first.target, orientation=turned)
    half = Rotation.from_quat([DOWN, turned]).mean().as_quat().tolist()
    path = AppPath(
        start=ViaPoint(t=moving.t0, position=first.target, orientation=DOWN),
        via=(ViaPoint(t=moving.t0 + 0.5 * seconds, position=first.target, orientation=half),),
        tn=moving.tn, length_m=0.0, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    return as_file((first, moving.model_copy(update={"path": path}) if by_path else moving))


def test_a_turn_is_passed_through_its_via_points_at_the_taught_rate_and_time() -> None:
    calls = run(turning(2.0, by_path=True))
    half, end = motions(calls)[-1].waypoints
    assert half.minimum_time.milliseconds == end.minimum_time.milliseconds == 1000
    assert np.linalg.norm(half.target.velocity.angular) == pytest.approx(math.pi / 4, rel=0.1)
    assert half.target.velocity.angular[2] == pytest.approx(-math.pi / 4, rel=0.1)
    assert end.target.velocity.angular.tolist() == [0.0, 0.0, 0.0]
    assert [a["value"] for name, a in calls if name == "turn"][-1] < 1.6  # rad/s; mean 0.8


def test_a_turn_is_named_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    program = turning(2.0, by_path=True)
    made = module_of(program)
    made.say(1, made.APPS[1])
    assert "turns 90 degrees  by 1 via points" in capsys.readouterr().out
    assert path_in_words(program.apps[1]) == "0 mm, 90°, 1 via"


@pytest.mark.parametrize("by_path", [True, False])
def test_no_turn_is_faster_than_the_limit_however_short_it_was_taught(by_path: bool) -> None:
    program = turning(0.4, by_path=by_path)
    slow = program.model_copy(update={"safety": Safety(turn_rad_per_s=1.0)})
    calls = run(slow)
    assert [a["value"] for name, a in calls if name == "turn"][-1] == 1.0
    if by_path:
        half, end = motions(calls)[-1].waypoints
        seconds = (half.minimum_time.milliseconds + end.minimum_time.milliseconds) / 1000
        assert seconds > math.pi / 2  # at 1 rad/s
        assert np.linalg.norm(half.target.velocity.angular) <= 1.0


def test_a_press_that_turns_is_slowed_to_the_limit() -> None:
    program = turning(0.4, by_path=True)
    touch, pressed, _ = press()
    path = program.apps[1].path.model_copy(update={"tn": program.apps[1].tn})
    turned = program.apps[1].model_copy(update={"kind": "apply_force", "force": pressed.force, "path": path})
    slow = as_file((touch, turned)).model_copy(update={"safety": Safety(turn_rad_per_s=1.0)})
    tracked = next(
        m for m in motions(run(slow)) if isinstance(m, fake_franky.CartesianImpedanceTrackingMotion)
    )
    poses = Rotation.from_quat([one.target.quaternion for one in tracked.references[1:]])
    assert (poses[1:] * poses[:-1].inv()).magnitude().max() <= 1.0 * 0.02 + 1e-6  # rad a period


@pytest.mark.parametrize("kind", ["cartesian_motion", "apply_force"])
@pytest.mark.parametrize(("felt_nm", "tight"), [(1.4, False), (1.6, True), (-1.6, True)])
def test_a_turn_ends_where_it_is_tight(
    monkeypatch: pytest.MonkeyPatch, kind: AppKind, felt_nm: float, tight: bool
) -> None:
    first, turned = turning(2.0, by_path=True).apps
    screw = ScrewMotion(
        axis=(0, 0, 1), point=(0, 0, 0), angle=1.6, pitch_m=0.001, pitch_sd_m=0.0, torque=(0.0, 0.0, 1.0)
    )
    app = turned.model_copy(update={"kind": kind, "screw": screw, "force": (0.0, 0.0, -5.0)})
    made = module_of(as_file((first.model_copy(update={"kind": "move_to_contact"}), app)))
    assert made.APPS[1]["tight"][2] == 1.5  # of 1 Nm taught
    runner = made.Runner(fake_franky, "robot")
    monkeypatch.setattr(fake_franky, "torque_nm", [felt_nm])
    joins = iter([False] * 200)
    monkeypatch.setattr(fake_franky.Robot, "join_motion", lambda self, timeout=None: next(joins, True))
    fake_franky.calls.clear()
    runner.moved = True
    try:
        getattr(runner, kind)(made.APPS[1], None)
    finally:
        polls = 200 - len(list(joins))
    assert polls == 1 if tight else polls > 50
    ended = isinstance(motions(fake_franky.calls)[-1], fake_franky.CartesianStopMotion)
    assert ended == (tight and kind == "cartesian_motion")


def test_a_press_that_slides_follows_its_path_across_the_force() -> None:
    apps = list(curved())
    path = AppPath(
        start=ViaPoint(t=2.6, position=(0.0, 0.0, 0.2), orientation=DOWN), tn=4.2,
        length_m=0.1, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    apps[1] = apps[1].model_copy(update={"path": path, "target": (0.1, 0.0, 0.19)})
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
    with pytest.raises(ValueError, match=r"app 2 .*force 40\.0 N, at most 28\.5 N"):
        franky_script(as_file(pressed_harder_before(newton=40.0)))


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


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"target": (0.0, -0.9, 0.2)}, "workspace"),
        ({"force": (0.0, 0.0, -40.0)}, "force 40.0 N"),
        ({"load_kg": 5.0}, "load 5.0 kg"),
    ],
)
def test_it_refuses_what_is_beyond_its_limits_before_anything_moves(wrong: dict[str, Any], said: str) -> None:
    first, *rest = press()
    made = module_of(as_file((first, rest[0])))
    made.APPS[1].update(wrong)
    with pytest.raises(made.Stop, match=rf"app 2 \(apply force\): .*{said}"):
        made.checked(made.APPS)
    with pytest.raises(ValueError, match=rf"app 2 \(apply force\): .*{said}"):
        franky_script(as_file((first, rest[0].model_copy(update=wrong))))


def test_without_a_contact_it_stops_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    said = stopped(monkeypatch, as_file(press()), lambda x, y: -9.0)
    assert said == "app 1 (move to contact): no contact within 0.04 m past its target"


def test_a_dry_run_says_every_app_and_needs_no_franky(tmp_path: Path) -> None:
    script = tmp_path / "made.py"
    script.write_text(franky_script(as_file(pick_and_place())), encoding="utf-8")
    done = subprocess.run([sys.executable, script, "--dry-run"], check=True, capture_output=True, text=True)
    said = [line.split(maxsplit=1) for line in done.stdout.splitlines()]
    for number, ((shown, rest), one) in enumerate(zip(said, pick_and_place(), strict=True), start=1):
        assert (int(shown), rest.startswith(f"{APP_KINDS[one.kind].title}  ")) == (number, True)
    refused = subprocess.run([sys.executable, script], check=False, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "--robot" in refused.stderr


def test_the_fake_has_the_names_of_franky_itself() -> None:
    franky = pytest.importorskip("franky", reason="franky-control is not installed")
    for name, made in inspect.getmembers(fake_franky, inspect.isclass):
        invented = name.startswith("_") or made is fake_franky.MovingRobot
        if made.__module__ == fake_franky.__name__ and not invented:
            real = getattr(franky, name)
            own = {n for n in vars(made) if not n.startswith("_")}
            assert own <= set(dir(real)), name


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


@pytest.mark.parametrize(("off_m", "closes"), [(0.02, True), (0.05, False)])
def test_the_fingers_do_not_close_where_the_arm_stands_elsewhere(
    monkeypatch: pytest.MonkeyPatch, off_m: float, closes: bool
) -> None:
    # A recording that begins at the object has no way there: the fingers closed wherever the arm stood.
    made, runner = over_surface(monkeypatch, as_file(pick_and_place()[1:]), lambda x, y: -1.0)
    runner.robot.flange = fake_franky.Affine((-0.014, -0.673, 0.107 + off_m), DOWN)
    with nullcontext() if closes else pytest.raises(made.Stop, match=r"app 1 .grasp.: the arm is 0.050 m"):
        runner.run(made.APPS[:1])
    assert any(name == "grasp" for name, _ in fake_franky.calls) == closes


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


@pytest.mark.parametrize("early_m", [0.1, 0.03])
def test_a_contact_far_before_where_it_was_taught_stops_the_program(
    monkeypatch: pytest.MonkeyPatch, early_m: float
) -> None:
    # What was met 100 mm above the table was pressed.
    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    program = as_file((touch.model_copy(update={"path": from_above}), pressed, away))
    if early_m < Safety().search_m:
        made, runner = over_surface(monkeypatch, program, lambda x, y: 0.19 + early_m)
        runner.run(made.APPS)
        return
    said = stopped(monkeypatch, program, lambda x, y: 0.19 + early_m)
    assert said == "app 1 (move to contact): contact 0.100 m from where it was taught, at most 0.04 m"
    pressing = fake_franky.CartesianImpedanceTrackingMotion
    assert not any(isinstance(motion, pressing) for motion in motions(fake_franky.calls))


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


def test_a_collision_names_the_app(monkeypatch: pytest.MonkeyPatch) -> None:
    # What franky raises where the robot stops by itself ended the script with a traceback.
    made, runner = over_surface(monkeypatch, as_file(press()), lambda x, y: 0.19)
    moved = fake_franky.MovingRobot.move

    def collided(robot: Any, motion: Any, asynchronous: bool = False) -> None:
        if robot.flange.translation[2] < 0.25:
            raise fake_franky.ControlException("cartesian_reflex")
        moved(robot, motion, asynchronous)

    monkeypatch.setattr(fake_franky.MovingRobot, "move", collided)
    with pytest.raises(made.Stop, match=r"app 1 \(move to contact\): cartesian_reflex"):
        runner.run(made.APPS)


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

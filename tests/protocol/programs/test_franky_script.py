"""The script for franky: it compiles, runs against a fake of its API, and keeps to its limits."""

from __future__ import annotations

import inspect
import math
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, ViaPoint
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.export_limits import CONSTANTS
from caesura_protocol.programs.franky_script import DIGITS, POINTS_S, franky_script
from caesura_protocol.programs.planned_apps import STANDOFF_M
from caesura_protocol.programs.safety import Safety
from caesura_protocol.reproduced_path import curve_of
from harness.programs import (
    DOWN,
    app,
    as_file,
    circle,
    curved,
    move,
    path_from,
    pick_and_place,
    press,
    set_down_at_once,
    squeezed,
)

from . import fake_franky
from .franky_runs import module_of, motions, over_surface, passed, passed_at, run, stopped


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
    for name, (field, _) in CONSTANTS.items():
        assert getattr(made, name) == getattr(safety, field)
    text = franky_script(as_file(press()))
    assert text.index("MAX_SPEED_M_PER_S =") < text.index("APPS =") < text.index("def ")


def test_pick_and_place_grips_carries_its_load_and_lets_it_go() -> None:
    calls = run(as_file(pick_and_place()))
    names = [name for name, _ in calls if name in ("grasp", "fingers", "load")]
    assert names == ["load", "grasp", "load", "load", "fingers", "load"]
    hand = [0.0, 0.0, 0.1034]
    loads = [(a["kg"], a["at"]) for name, a in calls if name == "load"]
    nothing = (0.0, [0.0, 0.0, 0.0])  # stated first: a run that was stopped leaves its own
    assert loads == [nothing, (0.25, hand), (0.25, hand), nothing]
    ends = [len(motion.reactions) for motion in motions(calls)]
    assert ends == [
        1,
        0,
        1,
        0,
    ]  # a contact ends the approach, and setting down; the others go to their targets


def test_a_grip_is_eased_by_opening_the_fingers_and_grasping_again() -> None:
    calls = run(as_file(squeezed()))
    fingers = [(name, width["width"]) for name, width in calls if name in ("grasp", "fingers")]
    assert fingers == [
        ("grasp", 0.05),
        ("grasp", 0.03),
        ("fingers", 0.05),
        ("grasp", 0.05),
        ("fingers", 0.08),
    ]
    assert [load["kg"] for name, load in calls if name == "load"][-2:] == [0.25, 0.0]


def test_a_contact_that_ends_is_left_before_another_one_is_looked_for() -> None:
    # The force was zeroed while the tool still pressed on the table: what was let go passed for a contact.
    fake_franky.calls.clear()
    made = module_of(as_file(set_down_at_once()))
    runner = made.Runner(fake_franky, "robot")
    runner.run(made.checked(made.APPS))
    carried = [motion for motion in motions(fake_franky.calls) if hasattr(motion, "waypoints")]
    (left_s, over), (end_s, end) = (passed(motion)[-1] for motion in carried)
    left_m = math.dist(over.pose.translation, (-0.014, -0.673, 0.107))
    assert STANDOFF_M <= left_m < math.dist((-0.018, -0.624, 0.156), (-0.014, -0.673, 0.107))
    assert end.pose.translation[2] == pytest.approx(0.127)
    assert [len(motion.reactions) for motion in carried] == [0, 1]
    assert left_s + end_s == pytest.approx(3.5, abs=0.01)
    assert passed_at(carried[1], (-0.018, -0.624, 0.156))[0] == pytest.approx(1.7 - left_s, abs=0.01)
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


def test_a_path_is_followed_by_its_via_points_with_their_velocities_and_times() -> None:
    calls = motions(run(as_file(curved())))
    assert calls[0].target.translation.tolist() == [-0.03, -0.6, 0.33]  # to its start, slowly
    first_s, first = passed_at(calls[1], (-0.03, -0.56, 0.3))
    assert first.velocity.linear.tolist() == [0.1, 0.0, 0.0]
    last_s, last = passed(calls[1])[-1]
    assert (first_s, last_s) == pytest.approx((1.0, 1.8), abs=0.01)
    assert last.velocity.linear.tolist() == [0.0, 0.0, 0.0]
    # What lies within the stand-off before a contact is left out.
    assert min(one.pose.translation[2] for _, one in passed(calls[1])) == pytest.approx(0.21)
    assert len(calls[1].reactions) == 1


def test_a_contact_is_approached_so_that_the_robot_can_stop_before_it() -> None:
    x, y, z = (-0.02, -0.52, 0.19)
    path = path_from((x, y, z + 0.2), 0.8, 1.6, 0.2)  # at up to 0.47 m/s
    touch, *rest = press()
    motion = motions(run(as_file((touch.model_copy(update={"t0": 0.8, "tn": 1.6, "path": path}), *rest))))[1]
    *way, (_, last) = passed(motion)
    assert last.pose.translation[2] == pytest.approx(z + STANDOFF_M)
    assert way
    for _, state in way:
        left_m = float(state.pose.translation[2] - last.pose.translation[2])
        assert state.velocity.linear[2] ** 2 <= 2.0 * 1.0 * left_m


def test_points_between_via_points_are_on_the_reproduced_path_and_close_together() -> None:
    """Between two points franky goes another way than the reproduced path."""
    way = circle(seconds=3.2)  # with via points 0.4 s apart
    (*between, _), curve = passed(motions(run(as_file((way,))))[1]), curve_of(way)
    assert len(between) == 15
    for t, state in between:
        values, velocities, _ = curve.at(1.0 + t)
        assert state.pose.translation == pytest.approx(values[:3], abs=1e-5)
        assert state.velocity.linear == pytest.approx(velocities[:3], abs=1e-5)
        turned = Rotation.from_quat(values[3:]).inv() * Rotation.from_quat(state.pose.quaternion)
        assert turned.magnitude() < 1e-5
    assert np.diff([0.0, *(t for t, _ in between), 3.2]).max() <= POINTS_S + 1e-9


def test_a_path_without_stated_velocities_is_passed_as_it_is_reproduced() -> None:
    """Such as of an older file: the robot stopped at each via point, and went straight between them."""
    way = circle()
    assert way.path is not None
    via = tuple(point.model_copy(update={"velocity": None}) for point in way.path.via)
    way = way.model_copy(update={"path": way.path.model_copy(update={"via": via})})
    motion = motions(run(as_file((way,))))[1]
    velocities = [
        passed_at(motion, tuple(round(x, DIGITS) for x in point.position))[1].velocity.linear for point in via
    ]
    assert np.array(velocities) == pytest.approx(curve_of(way).passing[1:-1, :3], abs=1e-6)
    assert min(map(np.linalg.norm, velocities)) > 0.05
    assert passed(motion)[-1][1].velocity.linear.tolist() == [0.0, 0.0, 0.0]


def test_a_path_that_is_slow_at_its_via_points_has_a_limit_above_its_speed_between_them() -> None:
    """The limit was that of the ends and of the via points: the robot was slower in between."""
    x, y, z = 0.3, -0.6, 0.33
    passed = ((0.5, x + 0.01, (0.03, 0.0, 0.0)), (1.5, x + 0.15, (0.03, 0.0, 0.0)))
    via = tuple(ViaPoint(t=t, position=(at, y, z), orientation=DOWN, velocity=v) for t, at, v in passed)
    path = path_from((x, y, z), 0.0, 2.0, 0.16, via=via)
    way = app("cartesian_motion", 0.0, 2.0, (x + 0.16, y, z), path=path)
    fastest, _ = curve_of(way).peaks()
    assert fastest > 0.2
    limits = [arguments["value"] for name, arguments in run(as_file((way,))) if name == "limit"]
    assert limits[-1] >= fastest - 1e-6


def test_a_path_that_was_taught_faster_than_the_limit_is_followed_slower() -> None:
    motion = motions(run(as_file(curved(speed=0.96))))[1]
    passed_s, first = passed_at(motion, (-0.03, -0.56, 0.3))
    assert first.velocity.linear[0] == pytest.approx(0.48)  # and a quarter is left to the limit
    assert passed_s == pytest.approx(2.0)
    assert max(np.linalg.norm(one.velocity.linear) for _, one in passed(motion)) <= Safety().speed_m_per_s


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
    middle_s, middle = passed_at(motion, (0.4, -0.6, 0.33))
    end_s, end = passed(motion)[-1]
    assert middle.velocity.linear.tolist() == [0.05, 0.05, 0.0]
    assert end.velocity.linear.tolist() == [0.0, 0.0, 0.0]
    assert (middle_s, end_s) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize("program", [corner(pause_s=0.5), corner(contact=True)])
def test_before_a_pause_and_a_contact_the_robot_stops(program: ProgramFile) -> None:
    """A contact is looked for by a motion of its own: it would end at what the first movement leaves."""
    _, first, *_ = motions(run(program))
    _, middle = passed(first)[-1]
    assert middle.pose.translation.tolist() == [0.4, -0.6, 0.33]
    assert middle.velocity.linear.tolist() == [0.0, 0.0, 0.0]


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
    limited = as_file((first, rest[0].model_copy(update=wrong)))
    limited = limited.model_copy(update={"safety": Safety(force_n=28.5)})
    with pytest.raises(ValueError, match=rf"app 2 \(apply force\): .*{said}"):
        franky_script(limited)


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


def test_a_dry_run_states_units(capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for apps in (pick_and_place(), limited_press()):
        made = module_of(as_file(apps))
        for number, one in enumerate(made.APPS, start=1):
            made.say(number, one)
            said.append(capsys.readouterr().out.strip().split("  "))
    shown = {part.strip() for parts in said for part in parts}
    assert {
        "1.60 s",
        "to [-0.014, -0.673, 0.107] m",
        "fingers 50 mm apart",
        "carries 0.25 kg",
        "presses with 10.0 N of 20.7 N taught, [0.0, 0.0, -10.0] N",
    } <= shown


def limited_press() -> tuple[App, ...]:
    """A press whose force a limit has cut."""
    touch, pressed, leave = press()
    return touch, pressed.model_copy(update={"force_taught": (0.0, 0.0, -20.7)}), leave


def test_the_fake_has_the_names_of_franky_itself() -> None:
    franky = pytest.importorskip("franky", reason="franky-control is not installed")
    for name, made in inspect.getmembers(fake_franky, inspect.isclass):
        invented = name.startswith("_") or made is fake_franky.MovingRobot
        if made.__module__ == fake_franky.__name__ and not invented:
            real = getattr(franky, name)
            own = {n for n in vars(made) if not n.startswith("_")}
            assert own <= set(dir(real)), name


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


def test_what_falls_on_its_way_stops_the_program_before_it_is_set_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The empty fingers went on to where the part was to be set down, and up to 40 mm beyond.
    made, runner = over_surface(monkeypatch, as_file(pick_and_place()), lambda x, y: 0.11)
    moved = fake_franky.MovingRobot.move

    def dropped(robot: Any, motion: Any, asynchronous: bool = False) -> None:
        moved(robot, motion, asynchronous)
        if any(name == "load" for name, _ in fake_franky.calls):
            runner.gripper.is_grasped = False

    monkeypatch.setattr(fake_franky.MovingRobot, "move", dropped)
    with pytest.raises(made.Stop, match=r"app 3 .transport.: nothing between the fingers any more"):
        runner.run(made.APPS)


def test_what_is_let_fall_is_let_go_where_it_was_taught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a bin the arm looked for a surface up to 40 mm below, and the script stopped: there is none."""

    def surface(_: float, y: float) -> float:
        return 0.11 if y < -0.6 else 0.0

    *before, let_go, away = pick_and_place()
    fall = let_go.model_copy(update={"force_taught": None})
    made, runner = over_surface(monkeypatch, as_file((*before, fall, away)), surface)
    opened_at, open_fingers = [], runner.gripper.move

    def opened(*args: Any) -> bool:
        opened_at.append(runner.flange().translation[2])
        return bool(open_fingers(*args))

    monkeypatch.setattr(runner.gripper, "move", opened)
    runner.run(made.APPS)
    assert opened_at == pytest.approx([0.107], abs=0.001)
    made, runner = over_surface(monkeypatch, as_file(pick_and_place()), surface)
    with pytest.raises(made.Stop, match=r"app 4 .transport.: no contact within"):
        runner.run(made.APPS)


def test_a_gripper_that_is_lost_names_the_app(monkeypatch: pytest.MonkeyPatch) -> None:
    # It ended the script with a traceback: in franky 2.0.0 this is no `franky.Exception`.
    made, runner = over_surface(monkeypatch, as_file(pick_and_place()), lambda x, y: 0.11)

    def lost(*_: Any, **__: Any) -> bool:
        raise fake_franky.GripperException("connection lost")

    monkeypatch.setattr(runner.gripper, "grasp", lost)
    with pytest.raises(made.Stop, match=r"app 2 .grasp.: connection lost"):
        runner.run(made.APPS)


def test_a_hold_without_a_path_stays_as_long_as_it_was_taught(monkeypatch: pytest.MonkeyPatch) -> None:
    # It ended at once, because the arm was there already.
    touch, grasp, carry, *_ = pick_and_place()
    hold = app("hold", carry.tn, carry.tn + 1.5, carry.target, load_kg=0.25, load_sd_kg=0.01)
    made, runner = over_surface(monkeypatch, as_file((touch, grasp, carry, hold)), lambda x, y: 0.11)
    waited: list[float] = []
    monkeypatch.setattr(made.time, "sleep", waited.append)
    runner.run(made.APPS)
    assert waited[-1] == pytest.approx(1.5)


@pytest.mark.parametrize("ends_in_contact", [False, True])
def test_a_hold_that_drifts_lasts_as_long_as_it_was_taught(
    monkeypatch: pytest.MonkeyPatch, ends_in_contact: bool
) -> None:
    # Only its path was followed: of a hold of 6 s with 1 s of drift, 5 s were lost.
    touch, grasp, lift, carry, *_ = pick_and_place()
    over = lift if not ends_in_contact else carry
    path = path_from(over.target, over.tn + 2.0, over.tn + 3.0, 0.012)
    hold = app("hold", over.tn, over.tn + 6.0, over.target, load_kg=0.25, path=path)
    pressed = app("apply_force", hold.tn, hold.tn + 1.0, over.target, force=(0.0, 0.0, -5.0))
    apps = (touch, grasp, lift, carry, hold, pressed) if ends_in_contact else (touch, grasp, lift, hold)
    made, runner = over_surface(monkeypatch, as_file(apps), lambda x, y: 0.11 if y < -0.6 else 0.1)
    waited: list[tuple[float, int]] = []
    monkeypatch.setattr(made.time, "sleep", lambda s: waited.append((s, len(motions(fake_franky.calls)))))
    runner.run(made.APPS)
    ((_, moved),) = [one for one in waited if one[0] == pytest.approx(5.0)]
    after = motions(fake_franky.calls)[moved:]
    assert any(motion.reactions for motion in after) == ends_in_contact  # it waits in the air, then searches


@pytest.mark.parametrize(
    ("taught_m", "part_m", "grasps"),
    [
        (0.05, 0.05, True),
        (0.05, 0.035, False),
        (0.05, 0.0, False),
        (None, 0.05, True),  # a program of a closed flag states no width: 0 mm was expected, up to 20 mm
        (None, 0.0, False),
        (0.006, 0.006, True),
        (0.006, 0.0, False),  # shut fingers passed for a part of 6 mm
    ],
)
def test_fingers_hold_what_stops_them(
    monkeypatch: pytest.MonkeyPatch, taught_m: float | None, part_m: float, grasps: bool
) -> None:
    touch, grasp, *rest = pick_and_place()
    program = as_file((touch, grasp.model_copy(update={"gripper_width": taught_m}), *rest))
    monkeypatch.setattr(fake_franky.Gripper, "part_m", part_m)
    made, runner = over_surface(monkeypatch, program, lambda x, y: 0.11)
    with nullcontext() if grasps else pytest.raises(made.Stop, match=r"app 2 .grasp.: nothing"):
        runner.run(made.APPS)


@pytest.mark.parametrize("taught_m", [None, 0.006, 0.05])
def test_a_part_that_slips_out_lets_the_fingers_shut(
    monkeypatch: pytest.MonkeyPatch, taught_m: float | None
) -> None:
    touch, grasp, *rest = pick_and_place()
    program = as_file((touch, grasp.model_copy(update={"gripper_width": taught_m}), *rest))
    monkeypatch.setattr(fake_franky.Gripper, "part_m", taught_m or 0.05)
    made, runner = over_surface(monkeypatch, program, lambda x, y: 0.11)
    grip = runner.gripper.grasp

    def slipped(width: float, *values: float, epsilon_inner: float, epsilon_outer: float) -> bool:
        grasped = grip(width, *values, epsilon_inner=epsilon_inner, epsilon_outer=epsilon_outer)
        runner.gripper.width = 0.0005
        runner.gripper.is_grasped = width - epsilon_inner < 0.0005 < width + epsilon_outer
        return bool(grasped)

    monkeypatch.setattr(runner.gripper, "grasp", slipped)
    with pytest.raises(made.Stop, match=r"nothing.* between the fingers"):
        runner.run(made.APPS)


@pytest.mark.parametrize("opens_m", [0.0, 0.06])
def test_a_hand_that_does_not_open_as_far_as_taught_stops_the_program_before_it_moves(
    monkeypatch: pytest.MonkeyPatch, opens_m: float
) -> None:
    # libfranka estimates `max_width` by homing. The fingers were opened to 0 mm without it.
    monkeypatch.setattr(fake_franky.Gripper, "max_width", opens_m)
    made, runner = over_surface(monkeypatch, as_file(pick_and_place()), lambda x, y: 0.11)
    with pytest.raises(made.Stop, match=rf"the hand opens to {opens_m} m, expected 0.08 m: home it"):
        runner.run(made.APPS)
    assert not motions(fake_franky.calls)


def test_an_arm_without_a_hand_runs_a_program_that_grips_nothing() -> None:
    # The hand was connected at once, and an arm without one ended the script.
    assert "gripper" not in [name for name, _ in run(as_file(press()))]
    assert "gripper" in [name for name, _ in run(as_file(pick_and_place()))]


def test_points_within_a_millisecond_are_no_division_by_zero() -> None:
    (first, *_) = (move(0.0, (0.3, -0.3, 0.3), (0.3, -0.3, 0.4)),)
    assert first.path is not None
    short = first.model_copy(update={"path": first.path.model_copy(update={"tn": 0.0003})})
    assert len(motions(run(as_file((short,))))[-1].waypoints) == 1


def test_orientations_have_unit_length_whatever_the_file_has() -> None:
    # libfranka refuses a pose whose rotation is none; a rate of turn of 1.5 rad/s came from the length alone.
    x, y, z, w = (0.96 * value for value in DOWN)
    calls = run(as_file((move(0.0, (0.3, -0.3, 0.3), (0.3, -0.3, 0.4), (x, y, z, w)),)))
    to_start, way = motions(calls)
    for pose in (to_start.target, way.waypoints[0].target.pose):
        assert np.linalg.norm(pose.quaternion) == pytest.approx(1.0, abs=2e-6)
    assert [a["value"] for name, a in calls if name == "turn"][-1] == pytest.approx(0.02)

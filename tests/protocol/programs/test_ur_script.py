"""URScript: it runs against functions of the script manual, and has the poses and numbers of the program."""

from __future__ import annotations

import itertools
import math
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_clients.cli.program_speed import at_speed
from caesura_protocol.messages import App, AppPath, ScrewMotion, Vector, ViaPoint
from caesura_protocol.programs.checks import gripper_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.planned_apps import planned_apps
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.straight_legs import CHORD_M, LEGS
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from caesura_protocol.reproduced_path import curve_of
from caesura_protocol.robots import GripperDescription
from harness.programs import (
    DOWN,
    app,
    as_file,
    barrel_m,
    circle,
    over_barrel,
    path_from,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    slid,
    squeezed,
    wiped,
)

from .fake_ur_controller import Controller, Halted, MovingController, as_python

MOVES = ("movej", "movel", "movep")


def on_ur(apps: tuple[App, ...], **changed: Any) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": "ur5e", "gripper": "robotiq_2f_85"} | changed)


def played(program: ProgramFile, **world: Any) -> Controller:
    controller = Controller(**world)
    controller.play(ur_script(program))
    return controller


def places(controller: Controller) -> list[list[float]]:
    return [move.get("pose") or move["q"] for move in controller.named(*MOVES)]


def test_a_press_has_the_poses_and_the_force_of_the_program():
    controller = played(on_ur(press()), table_m=0.185)
    assert controller.named("set_tcp") == [{"pose": [0.0] * 6}]
    touch, pressed, away = press()
    begun, left = places(controller)
    np.testing.assert_allclose(begun[:3], np.add(touch.target, (0.0, 0.0, 0.02)), atol=1e-6)  # the stand-off
    np.testing.assert_allclose(left[:3], away.target, atol=1e-6)
    for pose in (begun, left):
        turned = Rotation.from_rotvec(pose[3:]) * Rotation.from_quat(DOWN).inv()
        assert turned.magnitude() < 1e-5
    (mode,) = controller.named("force_mode")
    pushes = Rotation.from_rotvec(mode["frame"][3:]).apply([0.0, 0.0, mode["wrench"][2]])
    np.testing.assert_allclose(pushes, pressed.force, atol=1e-3)
    assert (mode["selection"], mode["kind"]) == ([0, 0, 1, 0, 0, 0], 2)
    held_s = sum(one["t"] for one in controller.named("sleep") if one["t"] == 0.02)
    assert held_s == pytest.approx(pressed.tn - pressed.t0, abs=0.02)
    searched = controller.named("speedl")
    assert all(one["xd"] == [0, 0, -0.03, 0, 0, 0] for one in searched)
    names = [name for name, _ in controller.calls]
    assert names.index("zero_ftsensor") < names.index("speedl") < names.index("force_mode")
    assert names.index("force_mode") < names.index("end_force_mode")


def test_what_people_call_an_app_and_its_target_stands_in_a_comment():
    """Every other script has these names."""
    touch, pressed, away = press()
    named = away.model_copy(update={"name": 'Lift "Ü" # end', "target_name": "above the tray"})
    text = ur_script(as_file((touch, pressed, named)).model_copy(update={"robot": "ur5e"}))
    assert text.count("# called: ") == 1
    assert '  # called: Lift "\\xdc" # end: above the tray\n  begin_app("app 3 (move)")\n' in text
    as_python(text)


def test_a_contact_that_is_not_there_stops_the_program():
    controller = Controller()
    with pytest.raises(Halted):
        controller.play(ur_script(on_ur(press())))
    (said,) = controller.named("popup")
    assert said["s"].startswith("app 1 (move to contact): no contact, past where it was taught by 0.04")
    assert ", at most 0.04 m" in said["s"]
    way = np.subtract(places(controller)[0][:3], controller.pose[:3])
    assert 0.06 < np.linalg.norm(way) < 0.062  # the stand-off, and 40 mm past the target


def test_pick_and_place_grips_carries_its_load_and_lets_it_go():
    controller = played(on_ur(pick_and_place()), table_m=0.11)
    counts = [one["value"] for one in controller.named("socket_set_var") if one["name"] == "POS"]
    assert counts == [123, 16]  # 40 mm, 10 mm less than what is grasped, and 80 mm of 85
    settings = {one["name"]: one["value"] for one in controller.named("socket_set_var")}
    assert settings["FOR"] == 0  # 20 N is the least that it has
    assert settings["SPE"] == round(255 * (0.05 - 0.02) / 0.13)
    assert [one["m"] for one in controller.named("set_payload")] == pytest.approx(
        [1.15, 0.9]
    )  # each zeroes the sensor
    of_tool, carrying = [0.0, 0.0, 0.05], [0.25 * 0.01 / 1.15, 0.0, (0.9 * 0.05 + 0.25 * 0.16) / 1.15]
    centres = [one["cog"] for one in controller.named("set_payload")]
    assert centres == [pytest.approx(carrying), of_tool]


def test_a_grip_is_eased_by_opening_the_fingers_and_grasping_again():
    controller = played(on_ur(squeezed()), table_m=0.11)
    counts = [one["value"] for one in controller.named("socket_set_var") if one["name"] == "POS"]
    assert counts == [123, 177, 96, 123, 16]  # 40, 20, 50, 40 and 80 mm of 85


@pytest.mark.parametrize(
    ("second_kg", "stated_kg"),
    [(0.24, [1.15, 0.9]), (None, [1.15, 0.9]), (0.6, [1.15, 1.5, 0.9])],
    ids=["as heavy", "not measured", "heavier"],
)
def test_the_load_of_what_is_held_is_stated_once(second_kg, stated_kg):
    """Each carry stated its own: the sensor was zeroed on what it pressed, and lost a load that was known."""
    apps = pick_and_place()
    last = max(i for i, one in enumerate(apps) if one.kind == "transport")
    apps = (*apps[:last], apps[last].model_copy(update={"load_kg": second_kg}), *apps[last + 1 :])
    controller = played(on_ur(apps), table_m=0.11)
    assert [one["m"] for one in controller.named("set_payload")] == pytest.approx(stated_kg)
    assert "carry(0.000)" not in ur_script(on_ur(apps))


def heavy() -> ProgramFile:
    apps = tuple(
        one.model_copy(update={"load_kg": 4.0}) if one.load_kg is not None else one
        for one in pick_and_place()
    )
    program = on_ur(apps)
    return program.model_copy(update={"safety": program.safety.model_copy(update={"load_kg": 5.0})})


def test_a_heavy_part_that_was_gripped_where_it_lies_is_no_force_beyond_the_limit():
    # The controller zeroes its sensor with the payload, and the part still lies then: it was felt as 39 N.
    controller = played(heavy(), table_m=0.11, part_kg=4.0)
    np.testing.assert_allclose(controller.pose[:3], heavy().apps[-1].target, atol=1e-6)


class Shelf(Controller):
    """Something presses from below with 45 N on what is lifted beyond a height."""

    def get_tcp_force(self) -> list[float]:
        force = super().get_tcp_force()
        force[2] += 45.0 if self.pose[2] > 0.15 else 0.0
        return force


def test_a_heavy_part_that_hangs_hides_no_force_from_below():
    # 45 N from below, less the table's 8 N at the grip, were felt as 2 N, as if the part still lay.
    controller = Shelf(table_m=0.11, part_kg=4.0)
    with pytest.raises(Halted):
        controller.play(ur_script(heavy()))
    said = controller.named("textmsg")[-1]
    assert said["s1"] == "app 3 (transport): stopped at the limit of force [N]: "
    assert said["s2"] == pytest.approx(37.0)


def test_what_is_not_grasped_stops_the_program():
    controller = Controller(table_m=0.11, grasped=3)
    with pytest.raises(Halted):
        controller.play(ur_script(on_ur(pick_and_place())))
    assert controller.named("popup")[0]["s"] == "app 2 (grasp): nothing between the fingers"


class Drops(Controller):
    """What is held falls on the first way that begins with it."""

    def movel(self, pose: list[float], a: float = 1.2, v: float = 0.25, t: float = 0, r: float = 0) -> None:
        super().movel(pose, a, v, t, r)
        if self.variables["OBJ"] == 2:
            self.variables["OBJ"] = 3


def test_what_falls_on_its_way_stops_the_program_before_it_is_set_down():
    # The empty fingers went on to where the part was to be set down, and up to 40 mm beyond.
    controller = Drops(table_m=0.11)
    with pytest.raises(Halted):
        controller.play(ur_script(on_ur(pick_and_place())))
    carry = next(i for i, (name, _) in enumerate(controller.calls) if name == "set_payload")
    assert controller.named("popup")[0]["s"] == "app 3 (transport): nothing between the fingers any more"
    assert not any(name == "speedl" for name, _ in controller.calls[carry:])  # no surface is looked for


def test_suction_switches_its_output():
    controller = played(on_ur(pick_and_place(), gripper="suction"), table_m=0.11)
    assert [tuple(one.values()) for one in controller.named("set_standard_digital_out")] == [
        (0, True),
        (0, False),
    ]


@pytest.mark.parametrize(
    ("width_m", "shuts", "named"), [(0.0, True, False), (0.05, False, False), (0.02, False, True)]
)
def test_switched_fingers_shut_where_they_were_taught_to(
    monkeypatch: pytest.MonkeyPatch, width_m: float, shuts: bool, named: bool
):
    # Every move of the fingers opened them, also one that shuts them before something is pushed.
    fields = {"interface": "digital_output", "output": 3, "opening_m": 0.05, "force_n": 40.0, "event": "none"}
    switched = GripperDescription.model_validate({"title": "pneumatic gripper", **fields})
    monkeypatch.setattr("caesura_protocol.programs.ur_script.gripper_of", lambda program: switched)
    leaves = press()[2]
    moves = app("gripper_move", leaves.tn, leaves.tn + 1.0, leaves.target, gripper_width=width_m)
    switches = played(on_ur((leaves, moves))).named("set_standard_digital_out")
    assert [tuple(one.values()) for one in switches] == [(3, shuts)]
    said = [one.reason for one in gripper_findings((leaves, moves), Safety(), switched)]
    assert any("is open at 50 mm or shut, so it opens" in reason for reason in said) == named


def test_legs_keep_to_a_fine_tolerance_of_their_path():
    """A small circle was one leg to its own start, which stays within 1 mm: nothing moved."""
    way, fine_m = circle(radius=0.001), 0.0003
    assert way.path is not None
    way = way.model_copy(update={"path": way.path.model_copy(update={"tolerance_m": fine_m})})
    controller = played(on_ur((way,)))
    corners = np.array(places(controller))[:, :3]
    legs = np.diff(corners, axis=0)
    for row in curve_of(way).sampled(16):
        way_to = row[:3] - corners[:-1]
        share = np.clip(np.vecdot(way_to, legs) / np.vecdot(legs, legs), 0.0, 1.0)
        assert np.linalg.norm(way_to - share[:, None] * legs, axis=1).min() < 0.5 * fine_m + 1e-6
    assert all(move["r"] <= 2.0 * fine_m for move in controller.named("movel"))


@pytest.mark.parametrize("write", [ur_script, xarm_script])
def test_a_script_with_legs_states_how_they_follow_a_path(write):
    text = write(as_file(press()))
    said = text.replace(" degrees", "°").split(LEGS)
    assert len(said) == 2
    assert "Limits. Lower them for a first run" in said[1]


def test_a_path_is_followed_closely_by_legs_whose_blends_do_not_overlap():
    way = circle()
    controller = played(on_ur((way,)))
    moves = controller.named("movel")
    poses = np.array(places(controller))  # from the start on
    curve = curve_of(way).sampled(64)
    legs = np.diff(poses[:, :3], axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    for row in curve:
        way_to = row[:3] - poses[:-1, :3]
        share = np.clip(np.vecdot(way_to, legs) / lengths**2, 0.0, 1.0)
        off = np.linalg.norm(way_to - share[:, None] * legs, axis=1)
        assert off.min() < CHORD_M + 1e-5
    blends = np.array([move["r"] for move in moves])
    assert blends[-1] == 0.0
    assert (blends[:-1] > 0.0).all()
    assert (blends[:-1] + np.append(0.0, blends[:-2]) < lengths[:-1]).all()
    seconds = lengths / [move["v"] for move in moves]
    assert seconds.sum() == pytest.approx(4.0, rel=0.1)  # as taught
    turned = Rotation.from_rotvec(poses[-1, 3:]) * Rotation.from_rotvec(poses[0, 3:]).inv()
    assert turned.magnitude() == pytest.approx(math.pi / 2, abs=1e-4)


def test_no_leg_is_faster_than_the_limit():
    slow = Safety(speed_m_per_s=0.1, turn_rad_per_s=0.2)
    controller = played(on_ur((circle(seconds=1.0),), safety=slow))
    lengths = np.linalg.norm(np.diff(np.array(places(controller))[:, :3], axis=0), axis=1)
    speeds = np.array([move["v"] for move in controller.named("movel")])
    assert speeds.max() <= 0.1
    assert (lengths / speeds).sum() > math.pi / 2 / 0.2  # the turn is slower yet
    assert "MAX_SPEED_M_PER_S = 0.1" in ur_script(on_ur((circle(),), safety=slow))


def test_a_small_limit_has_no_exponent():
    slow = Safety(contact_speed_m_per_s=0.00005, felt_force_n=123.4567891)
    text = ur_script(on_ur(press(), safety=slow))
    assert "  CONTACT_SPEED_M_PER_S = 0.00005  #" in text
    assert "  STOP_FORCE_N = 123.4567891  #" in text


@pytest.mark.parametrize("drift_m", [0.0, 0.0001, 0.0003, 0.00049, 0.0006])
@pytest.mark.parametrize("degrees", [0.0, 90.0, 360.0, 900.0])
def test_a_turn_nearly_in_place_is_divided_into_legs(drift_m: float, degrees: float):
    # A drift beyond half of the tolerance and below 0.5 mm was divided for ever: no script was written.
    before = press()[2]
    x, y, z = before.target
    shares = np.linspace(0.0, 1.0, 41)
    points = [
        ViaPoint(
            t=before.tn + 10.0 * share,
            position=(x + share * drift_m, y, z),
            orientation=tuple(
                (Rotation.from_euler("z", share * degrees, degrees=True) * Rotation.from_quat(DOWN)).as_quat()
            ),
        )
        for share in shares
    ]
    path = AppPath(
        start=points[0], via=tuple(points[1:-1]), tn=points[-1].t, length_m=drift_m, deviation_m=0.0,
        deviation_rad=0.0, tolerance_m=0.0003, tolerance_rad=0.017,
    )  # fmt: skip
    ends = {"orientation": points[-1].orientation, "path": path}
    turn = app("cartesian_motion", before.tn, path.tn, points[-1].position, **ends)
    (*_, last) = planned_apps(as_file((before, turn)), 1.2)
    led = [Rotation.from_quat(DOWN), *(Rotation.from_quat(leg.orientation) for leg in last.legs)]
    turned = sum((b * a.inv()).magnitude() for a, b in itertools.pairwise(led))
    assert turned == pytest.approx(math.radians(degrees), abs=0.01)
    if last.legs:
        assert last.legs[-1].position == pytest.approx(points[-1].position, abs=1e-9)


def test_a_turn_in_place_takes_its_time():
    touched = press()[2]
    turned = app(
        "cartesian_motion", touched.tn, touched.tn + 2.0, touched.target, orientation=(0.0, 1.0, 0.0, 0.0)
    )
    path = AppPath(
        start=ViaPoint(t=touched.tn, position=touched.target, orientation=DOWN), via=(), tn=turned.tn,
        length_m=0.0, deviation_m=0.0, deviation_rad=0.0, tolerance_m=0.002, tolerance_rad=0.02,
    )  # fmt: skip
    controller = played(on_ur((touched, turned.model_copy(update={"path": path}))))
    moves = controller.named("movel")
    assert {move["t"] > 0 for move in moves} == {True}
    assert sum(move["t"] for move in moves) == pytest.approx(2.0, abs=0.01)


def test_a_hold_stays_as_long_as_it_was_taught():
    touch, grasp, carry, *_ = pick_and_place()
    hold = app("hold", carry.tn, carry.tn + 1.5, carry.target, load_kg=0.25, load_sd_kg=0.01)
    controller = played(on_ur((touch, grasp, carry, hold)), table_m=0.11)
    assert len(controller.named("movel")) == 1
    assert controller.named("sleep")[-1] == {"t": 1.5}


@pytest.mark.parametrize("drift_m", [0.003, 0.012])
def test_a_hold_that_drifts_lasts_as_long_as_it_was_taught(drift_m: float):
    # Its way was followed with 5 mm/s at least: a vessel was tilted for 0.6 s in place of 6 s.
    touch, grasp, carry, *_ = pick_and_place()
    x, y, z = carry.target
    path = path_from(carry.target, carry.tn, carry.tn + 6.0, drift_m)
    hold = app("hold", carry.tn, carry.tn + 6.0, (x + drift_m, y, z), load_kg=0.25, path=path)
    controller = played(on_ur((touch, grasp, carry, hold)), table_m=0.11)
    said = [i for i, (name, one) in enumerate(controller.calls) if name == "textmsg" and "hold" in one["s1"]]
    calls = controller.calls[said[0] :]
    took = sum(one["t"] for name, one in calls if name == "sleep")
    took += sum(drift_m / one["v"] for name, one in calls if name == "movel")
    assert took == pytest.approx(6.0, abs=0.1)


def test_a_hold_that_a_contact_ends_rests_in_the_air_before_it():
    # It searched the contact at once: 6 s of holding were lost.
    touch, grasp, lift, carry, *_ = pick_and_place()
    hold = app("hold", carry.tn, carry.tn + 6.0, carry.target, load_kg=0.25)
    pressed = app("apply_force", hold.tn, hold.tn + 1.0, carry.target, force=(0.0, 0.0, -5.0))
    apps = (touch, grasp, lift, carry, hold, pressed)
    controller = played(on_ur(apps), table_m=0.11)
    said = [i for i, (name, one) in enumerate(controller.calls) if name == "textmsg" and "hold" in one["s1"]]
    calls = [(name, one) for name, one in controller.calls[said[0] :] if name in ("sleep", "movel", "speedl")]
    (rested,) = [index for index, (name, one) in enumerate(calls) if name == "sleep" and one["t"] > 1.0]
    assert rested == 0  # nothing is searched before it
    assert 4.9 < calls[rested][1]["t"] <= 6.0  # less the way back to the place before a contact


def test_a_slide_follows_its_path_in_force_mode():
    slide = circle(force=(0.0, 0.0, -8.0)).model_copy(update={"kind": "apply_force"})
    touch = app("move_to_contact", 0.0, 1.0, slide.path.start.position)
    controller = played(on_ur((touch, slide)), table_m=0.295)
    names = [name for name, _ in controller.calls]
    assert names.index("force_mode") < names.index("movep") < names.index("end_force_mode")
    np.testing.assert_allclose(places(controller)[-1][:3], slide.target, atol=1e-6)


def test_a_screw_ends_where_it_is_tight():
    screw = ScrewMotion(
        axis=(0, 0, 1), point=(0.4, 0, 0.3), angle=1.6, pitch_m=0.001, pitch_sd_m=0.0, torque=(0.0, 0.0, 1.0)
    )
    text = ur_script(on_ur((circle(screw=screw),)))
    assert "not arrived and torque_about([0.000000, 0.000000, 1.000000], [0.400000" in text
    assert ") < 1.5" in text


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (
            on_ur(press(), robot="panda"),
            "Universal Robots, and the program's robot is panda: use --format franky",
        ),
        (on_ur(press(), robot="iiwa14"), "and the program's robot is iiwa14: use --format bt"),
        (
            on_ur(pick_and_place(), gripper="franka_hand"),
            "app 2 .grasp.: URScript does not drive a Franka Hand",
        ),
        (on_ur(pick_and_place(), gripper=None), "app 2 .grasp.: .*--gripper.* robotiq_2f_85, robotiq_2f_140"),
        (on_ur(press(), safety=Safety(force_n=5.0)), "app 2 .apply force.: force 10.0 N, at most 5.0 N"),
        (
            on_ur(press(), safety=Safety(workspace_low=(0.0, -1.0, 0.0))),
            "target at x -20 mm, the workspace is 0 to 750 mm; state that of the cell with --cell",
        ),
        (on_ur((circle().model_copy(update={"load_kg": 9.0}),)), "load 9.0 kg, at most 3.0 kg"),
        (on_ur((app("cartesian_motion", 0.0, 1.0, (math.nan, 0.0, 0.3)),)), "app 1 .move.: target.0 is nan"),
    ],
)
def test_what_cannot_be_run_is_refused_by_name(program, said):
    with pytest.raises(ValueError, match=said):
        ur_script(program)


def test_a_program_without_orientation_keeps_that_of_the_flange():
    place: Vector = (0.3, 0.1, 0.4)
    free = app("cartesian_motion", 0.0, 1.0, place).model_copy(update={"orientation": None})
    controller = played(on_ur((free,), robot=None))
    assert places(controller) == [[*place, 0.0, 3.14, 0.0]]


def test_a_controller_recognises_a_script():
    """It needs `def` first, an indentation in every other line, and `end` last (script manual)."""
    noted = (press()[0].model_copy(update={"note": "ümlaut"}), *press()[1:])
    first, *lines, last = ur_script(on_ur(noted, name="wipe")).split("\n")[:-1]
    assert first == "def caesura_program():"
    assert all(line.startswith("  ") for line in lines)
    assert last == "end"


def test_every_block_of_a_script_ends():
    as_python(ur_script(on_ur(pick_and_place())))
    with pytest.raises(SyntaxError, match="1 blocks have no end"):
        as_python("def caesura_program():\nif True:\nend\n")


def test_a_stroke_presses_before_its_way_and_after_it_as_long_as_it_was_taught():
    controller = played(on_ur(wiped()), table_m=0.19)
    names = [name for name, _ in controller.calls]
    ways = [i for i, name in enumerate(names) if name.startswith("move")]
    stroke = next(i for i in ways if i > names.index("force_mode"))
    waits = [
        one["t"] for name, one in controller.calls[names.index("force_mode") : stroke] if name == "sleep"
    ]
    assert sum(waits) == pytest.approx(0.8, abs=0.02)
    last = max(i for i in ways if i < names.index("end_force_mode"))
    holds = [
        one["t"] for name, one in controller.calls[last : names.index("end_force_mode")] if name == "sleep"
    ]
    assert sum(holds) == pytest.approx(0.5)


def test_the_sensor_is_zeroed_where_nothing_is_touched():
    # At the start of a carry the tool still pressed on the table: the force that ended passed for a contact.
    class NotesZeros(Controller):
        zeroed_m: tuple[float, ...] = ()

        def zero_ftsensor(self) -> None:
            self.zeroed_m += (self.pose[2],)
            super().zero_ftsensor()

    controller = NotesZeros(table_m=0.11)
    controller.play(ur_script(on_ur(set_down_at_once())))
    assert len(controller.zeroed_m) == 3
    assert min(controller.zeroed_m) > 0.11
    searches = [i for i, (name, _) in enumerate(controller.calls) if name == "speedl"]
    grasps = [i for i, (name, _) in enumerate(controller.calls) if name == "set_payload"]
    assert searches[-1] > grasps[0]  # it looks for the table again


class EndsBeyondAnEdge(Controller):
    """Past its path a stroke has no surface below it: force mode moves the flange at its full speed."""

    def __init__(self, **world: Any) -> None:
        super().__init__(**world)
        self.is_pressed_after_its_way = False

    def movep(self, pose: list[float], a: float = 1.2, v: float = 0.25, r: float = 0) -> None:
        super().movep(pose, a, v, r)
        self.is_pressed_after_its_way = True

    def end_force_mode(self) -> None:
        self.is_pressed_after_its_way = False

    def sleep(self, t: float) -> None:
        if self.is_pressed_after_its_way:
            self.pose[2] -= 0.03 * t


def test_a_rest_after_a_way_that_has_lost_its_surface_stops_the_program():
    # The rest was one sleep: without a surface the flange went on at 30 mm/s for as long as it lasted.
    stroke = wiped()
    at = next(i for i, one in enumerate(stroke) if one.kind == "apply_force")
    long_rest = stroke[at].model_copy(update={"tn": stroke[at].tn + 4.0})
    later = [
        one.model_copy(update={"t0": one.t0 + 4.0, "tn": one.tn + 4.0, "path": None})
        for one in stroke[at + 1 :]
    ]
    controller = EndsBeyondAnEdge(table_m=0.19)
    with pytest.raises(Halted):
        controller.play(ur_script(on_ur((*stroke[:at], long_rest, *later))))
    assert controller.named("popup")[0]["s"].startswith(
        "app 2 (apply force): nothing to press on, beyond its"
    )


def test_a_rest_beside_a_way_is_pressed_with_its_own_force():
    controller = played(on_ur(pressed_harder_before()), table_m=0.19)
    newtons = [call["wrench"][2] for call in controller.named("force_mode")]
    assert newtons == pytest.approx([12.0, 10.0, 5.0])
    names = [name for name, _ in controller.calls]
    second, third = (
        i for i, name in enumerate(names) if name == "force_mode" and i > names.index("force_mode")
    )
    ways = [i for i, name in enumerate(names) if name.startswith("move") and i > second]
    assert second < ways[0] <= ways[-1] < third < names.index("end_force_mode")


def stopped(program: ProgramFile, controller: Controller) -> str:
    """What a script says where it stops by itself; the robot holds then, and presses nothing."""
    with pytest.raises(Halted):
        controller.play(ur_script(program))
    names = [name for name, _ in controller.calls]
    said = names.index("popup")
    assert "stopl" in names[names.index("end_force_mode", said - 12) : said]
    assert not any(name.startswith(("move", "speedl", "force_mode")) for name in names[said:])
    return str(controller.named("popup")[0]["s"])


def test_a_surface_that_ends_in_the_middle_of_a_stroke_stops_the_program():
    # Only the rests beside a way were looked at: on its way the flange fell at 30 mm/s.
    controller = MovingController(lambda x, y: 0.19 if x < 0.02 else 0.0)
    said = stopped(on_ur(slid(4.0)), controller)
    assert said.startswith("app 2 (apply force): nothing to press on, beyond its way by 0.04")
    assert ", at most 0.04 m; felt [N]: 0" in said
    assert 0.0 < controller.pose[0] < 0.078  # in the middle of its way
    assert controller.pose[2] == pytest.approx(0.15, abs=0.002)
    kills = [i for i, (name, _) in enumerate(controller.calls) if name == "kill"]
    ends = [i for i, (name, _) in enumerate(controller.calls) if name == "end_force_mode"]
    assert kills[-1] < ends[0]  # two threads must not move the robot


def test_a_surface_that_leads_down_is_followed_as_it_was_taught():
    def slope_m(x: float, y: float) -> float:
        return 0.19 - 0.6 * max(x + 0.02, 0.0)

    controller = MovingController(slope_m)
    controller.play(ur_script(on_ur(slid(4.0, down_m=0.06))))
    assert controller.pose[2] == pytest.approx(0.13, abs=0.002)


@pytest.mark.parametrize("early_m", [0.1, 0.03])
def test_a_contact_far_before_where_it_was_taught_stops_the_program(early_m: float):
    # What was met 100 mm above the table was pressed.
    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    apps = (touch.model_copy(update={"path": from_above}), pressed, away)
    controller = MovingController(lambda x, y: 0.19 + early_m)
    if early_m < Safety().search_m:
        controller.play(ur_script(on_ur(apps)))
        assert controller.named("force_mode")
        return
    said = stopped(on_ur(apps), controller)
    assert said.startswith("app 1 (move to contact): contact away from where it was taught by 0.0998")
    assert ", at most 0.04 m" in said
    assert not controller.named("force_mode")


def test_what_was_met_and_goes_away_far_before_a_contact_stops_the_program():
    # The arm searched on from where a hand had stopped it, off its way.
    class Brushed(MovingController):
        def get_tcp_force(self) -> list[float]:
            return [0.0, 0.0, 8.0 * (0.295 < self.pose[2] < 0.3), 0.0, 0.0, 0.0]

        def stopl(self, a: float) -> None:
            self.pose[2] = min(self.pose[2], 0.29) if self.pose[2] < 0.3 else self.pose[2]

    touch, pressed, away = press()
    from_above = path_from((-0.02, -0.52, 0.4), touch.t0, touch.tn, 0.21)
    apps = (touch.model_copy(update={"path": from_above}), pressed, away)
    said = stopped(on_ur(apps), Brushed(lambda x, y: 0.19))
    assert said.startswith("app 1 (move to contact): contact away from where it was taught by 0.1")


def test_the_limit_of_speed_is_one_of_the_running_script():
    # The comment asks to lower it for a first run; nothing used it.
    text = ur_script(on_ur((circle(),))).replace("MAX_SPEED_M_PER_S = 0.6", "MAX_SPEED_M_PER_S = 0.03")
    controller = Controller()
    controller.play(text)
    assert max(move["v"] for move in controller.named("movel")) == 0.03


def test_rests_beside_a_way_that_is_none_are_pressed_with_their_own_forces():
    # A stroke without legs was pressed with one force.
    touch, stroke = pressed_harder_before()
    assert stroke.path is not None
    still = path_from(stroke.path.start.position, stroke.path.start.t, stroke.path.tn, 0.0)
    pressed = stroke.model_copy(update={"path": still, "target": stroke.path.start.position})
    controller = played(on_ur((touch, pressed)), table_m=0.19)
    assert [call["wrench"][2] for call in controller.named("force_mode")] == pytest.approx([12.0, 10.0, 5.0])
    names = [name for name, _ in controller.calls]
    begun = [i for i, name in enumerate(names) if name == "force_mode"]
    ends = [*begun[1:], names.index("end_force_mode")]
    held = [
        sum(one["t"] for name, one in controller.calls[first:last] if name == "sleep")
        for first, last in zip(begun, ends, strict=True)
    ]
    assert held == pytest.approx([0.8, 1.0, 0.5], abs=0.02)


def test_the_force_turns_with_a_tool_that_is_tilted():
    # Over a barrel it kept the direction of the top: at both ends it leaned by 30° from the normal.
    controller = MovingController(barrel_m)
    controller.play(ur_script(on_ur(over_barrel())))
    pushes = [
        Rotation.from_rotvec(mode["frame"][3:]).apply([0.0, 0.0, 1.0])
        for mode in controller.named("force_mode")
    ]
    angles = [math.degrees(math.atan2(-push[1], -push[2])) for push in pushes]
    assert angles == sorted(angles)
    assert angles[0] == pytest.approx(-30.0, abs=6.0)
    assert angles[-1] == pytest.approx(30.0, abs=6.0)
    assert all(abs(push[0]) < 1e-3 for push in pushes)
    assert all(mode["wrench"][2] == 10.0 for mode in controller.named("force_mode"))


@pytest.mark.parametrize(("off_m", "closes"), [(0.02, True), (0.05, False)])
def test_the_fingers_do_not_close_where_the_arm_stands_elsewhere(off_m: float, closes: bool):
    # A recording that begins at the object has no way there: the fingers closed wherever the arm stood.
    controller = Controller()
    controller.pose = [-0.014, -0.673, 0.107 + off_m, 0.0, 3.14, 0.0]
    with nullcontext() if closes else pytest.raises(Halted):
        controller.play(ur_script(on_ur(pick_and_place()[1:2])))
    said = "app 1 (grasp): bring the arm to where it grasps first, it is away by [m]: 0.05"
    assert any(call["s"].startswith(said) for call in controller.named("popup")) != closes
    assert ("POS" in [call["name"] for call in controller.named("socket_set_var")]) == closes


def test_a_script_at_half_the_speed_does_not_call_its_times_taught():
    # It read "app 1 (move), 8.00 s as taught" of a movement that was taught in 4 s.
    slow = ur_script(at_speed(on_ur((circle(),)), "0.5", ()))
    assert "# app 1 (move), 8.00 s\n" in slow

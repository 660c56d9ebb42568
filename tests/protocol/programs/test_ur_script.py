"""URScript: it runs against functions of the script manual, and has the poses and numbers of the program."""

from __future__ import annotations

import itertools
import math
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_clients.cli.program_speed import at_speed
from caesura_protocol.messages import AppPath, Vector, ViaPoint
from caesura_protocol.programs.checks import gripper_findings
from caesura_protocol.programs.planned_apps import planned_apps
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.straight_legs import CHORD_M, LEGS
from caesura_protocol.programs.ur_script import ur_script
from caesura_protocol.programs.xarm_script import xarm_script
from caesura_protocol.reproduced_path import curve_of
from caesura_protocol.robots import GripperDescription
from harness.programs import DOWN, app, as_file, circle, path_from, pick_and_place, press, squeezed

from .fake_ur_controller import Controller, Halted, as_python
from .ur_runs import on_ur, places, played


def test_what_people_call_an_app_and_its_target_stands_in_a_comment():
    """Every other script has these names."""
    touch, pressed, away = press()
    named = away.model_copy(update={"name": 'Lift "Ü" # end', "target_name": "above the tray"})
    text = ur_script(as_file((touch, pressed, named)).model_copy(update={"robot": "ur5e"}))
    assert text.count("# called: ") == 1
    assert '  # called: Lift "\\xdc" # end: above the tray\n  begin_app("app 3 (move)")\n' in text
    as_python(text)


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


def test_the_limit_of_speed_is_one_of_the_running_script():
    # The comment asks to lower it for a first run; nothing used it.
    text = ur_script(on_ur((circle(),))).replace("MAX_SPEED_M_PER_S = 0.6", "MAX_SPEED_M_PER_S = 0.03")
    controller = Controller()
    controller.play(text)
    assert max(move["v"] for move in controller.named("movel")) == 0.03


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

"""Contacts of a URScript: searches, presses, strokes and their rests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import ScrewMotion
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.programs.ur_script import ur_script
from harness.programs import (
    DOWN,
    app,
    barrel_m,
    circle,
    over_barrel,
    path_from,
    pick_and_place,
    press,
    pressed_harder_before,
    set_down_at_once,
    slid,
    wiped,
)

from .fake_ur_controller import Controller, Halted, MovingController
from .ur_runs import on_ur, places, played


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


def test_a_contact_that_is_not_there_stops_the_program():
    controller = Controller()
    with pytest.raises(Halted):
        controller.play(ur_script(on_ur(press())))
    (said,) = controller.named("popup")
    assert said["s"].startswith("app 1 (move to contact): no contact, past where it was taught by 0.04")
    assert ", at most 0.04 m" in said["s"]
    way = np.subtract(places(controller)[0][:3], controller.pose[:3])
    assert 0.06 < np.linalg.norm(way) < 0.062  # the stand-off, and 40 mm past the target


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

"""What stands in the simulated cell of a program whose own cell is not known."""

from __future__ import annotations

import pytest

from caesura_lab.execution.taught_cell import AROUND_M, cell_as_taught, taught_cell_in_words
from caesura_lab.teacher.scenarios import FINGERS_BELOW_FLANGE_M
from caesura_protocol.errors import CaesuraError
from caesura_protocol.messages import AppPath, ScrewMotion, ViaPoint
from clients.examples import example
from harness.programs import DOWN, app, pick_and_place, press, wiped


def test_a_surface_yields_as_deep_as_it_was_pushed_in_and_bears_the_force_there():
    (surface,) = cell_as_taught(press()).scenario.surfaces
    assert surface.touch_height_m == pytest.approx(0.19 - FINGERS_BELOW_FLANGE_M)
    assert surface.travel_m == pytest.approx(0.025)
    assert surface.static_force(0.999 * surface.travel_m) == pytest.approx(10.0, rel=0.01)
    assert surface.center_m == pytest.approx((-0.02, -0.52))
    assert surface.radius_m == pytest.approx(AROUND_M)


def test_where_it_sets_down_and_grasps_something_stands_as_heavy_and_wide_as_taught():
    cell = cell_as_taught(pick_and_place())
    assert [one.touch_height_m for one in cell.scenario.surfaces] == pytest.approx(
        [0.107 - FINGERS_BELOW_FLANGE_M] * 2
    )
    assert [one.travel_m for one in cell.scenario.surfaces] == [0.0, 0.0]
    (grasp,) = cell.scenario.steps
    assert (grasp.kind, grasp.to) == ("grasp", (-0.014, -0.673, 0.107))
    assert (cell.load_kg, cell.width_m) == (0.25, 0.05)
    assert taught_cell_in_words(cell).startswith("cell as taught: 2 level surfaces, one object, nothing else")


def test_a_surface_is_as_large_as_what_slides_on_it():
    start = ViaPoint(t=1.0, position=(0.4, -0.1, 0.15), orientation=DOWN)
    path = AppPath(
        start=start,
        tn=2.0,
        length_m=0.3,
        deviation_m=0.0,
        deviation_rad=0.0,
        tolerance_m=0.002,
        tolerance_rad=0.02,
    )
    slid = app("apply_force", 1.0, 2.0, (0.4, 0.2, 0.149), force=(1.0, 0.0, -12.0)).model_copy(
        update={"path": path}
    )
    (surface,) = cell_as_taught((app("move_to_contact", 0.0, 1.0, (0.4, -0.1, 0.15)), slid)).scenario.surfaces
    assert surface.center_m == pytest.approx((0.4, 0.05))
    assert surface.radius_m == pytest.approx(0.15 + AROUND_M)
    assert surface.travel_m == 0.0


def test_friction_along_a_stroke_makes_no_surface_slant():
    # A wiping by hand leaned by 24° along its strokes: the simulated robot refused it.
    touch, stroke = wiped()
    cell = cell_as_taught((touch, stroke.model_copy(update={"force": (5.0, 0.0, -10.0)})))
    assert len(cell.scenario.surfaces) == 1


def test_a_program_in_free_space_has_nothing_around_it():
    cell = cell_as_taught([app("cartesian_motion", 0.0, 1.0, (0.4, 0.0, 0.4))])
    assert cell.scenario.surfaces == ()
    assert cell.scenario.start == (0.4, 0.0, 0.4)
    assert taught_cell_in_words(cell).startswith("cell as taught: nothing else;")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"force": (0.0, 6.0, -6.0)}, r"app 2 \(apply force\) exerts \(0\.0, 6\.0, -6\.0\) N; surfaces"),
        ({"force": (0.0, 0.0, 9.0)}, r"exerts \(0\.0, 0\.0, 9\.0\) N"),
        ({"screw": example(ScrewMotion)}, "turns in contact"),
    ],
)
def test_what_no_level_surface_does_is_refused_with_its_app(changed, said):
    touch, pressed, *_ = press()
    with pytest.raises(CaesuraError, match=said):
        cell_as_taught([touch, pressed.model_copy(update=changed)])


def test_a_second_object_is_refused_and_the_same_one_may_be_gripped_again():
    apps = pick_and_place()
    again = app("grasp", 13.0, 14.0, (-0.021, -0.475, 0.107), gripper_width=0.05)
    assert len(cell_as_taught([*apps, again]).scenario.steps) == 1
    other = app("grasp", 13.0, 14.0, (0.1, -0.673, 0.107), gripper_width=0.05)
    with pytest.raises(CaesuraError, match=r"app 7 \(grasp\) grips a second object"):
        cell_as_taught([*apps, other])


def test_without_a_target_there_is_nothing_to_run():
    with pytest.raises(CaesuraError, match="no target"):
        cell_as_taught([app("gripper_move", 0.0, 1.0, gripper_width=0.0)])

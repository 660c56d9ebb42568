"""At a contact a tool is not turned to where the next path begins."""

from __future__ import annotations

import pytest
from scipy.spatial.transform import Rotation

from caesura_protocol.messages import Quaternion
from caesura_protocol.programs.checks import precondition_findings
from harness.programs import DOWN, as_file, move, pick_and_place, press, squeezed


def leaned(degrees: float) -> Quaternion:
    x, y, z, w = (Rotation.from_euler("x", degrees, degrees=True) * Rotation.from_quat(DOWN)).as_quat()
    return float(x), float(y), float(z), float(w)


@pytest.mark.parametrize(("degrees", "is_refused"), [(14.0, False), (16.0, True), (-40.0, True)])
def test_a_path_that_begins_turned_is_refused_at_a_contact(degrees: float, is_refused: bool) -> None:
    """A press that was turned by 34° in the program drove the tip into the table with 104 N as it ended."""
    down, push, _ = press()
    leave = move(4.2, (-0.02, -0.52, 0.165), (-0.02, -0.53, 0.29))
    found = precondition_findings((down, push.model_copy(update={"orientation": leaned(degrees)}), leave))
    assert bool(found) is is_refused
    if found:
        (one,) = found
        assert (one.severity, one.index) == ("error", 2)
        assert one.reason.startswith(
            f"begins turned by {abs(degrees):.0f}° from the end of the app before it"
        )
        assert one.value == pytest.approx(abs(degrees), abs=1e-6)
        assert one.limit == pytest.approx(15.0)


def test_in_the_air_a_path_may_begin_turned() -> None:
    first = move(1.0, (0.3, -0.5, 0.3), (0.3, -0.4, 0.3))
    second = move(2.0, (0.3, -0.4, 0.3), (0.3, -0.3, 0.3), leaned(40.0))
    assert precondition_findings((first, second)) == []


def test_a_carry_in_a_program_without_a_grasp_says_what_was_not_recorded() -> None:
    # Ten recordings without a gripper's state had 19 such errors; pushing had been read as loads.
    carried = move(1.0, (0.3, -0.5, 0.3), (0.3, -0.4, 0.3)).model_copy(update={"kind": "transport"})
    first, second = (one.reason for one in precondition_findings((carried, carried)))
    assert second == "carries, but nothing was grasped: an app 'grasp' must come before it"
    assert first.startswith(f"{second}. The program has none: was the gripper's state recorded?")
    _, grasp, carry, _, opened, _ = pick_and_place()
    (late,) = precondition_findings((carry, grasp, carry, opened))
    assert late.reason == second


def test_what_is_gripped_where_it_stands_is_touched_and_may_be_pressed() -> None:
    """What was gripped on a table and pushed along it was said to be pressed without a contact."""
    _, grasp, _, _, opened, _ = pick_and_place()
    _, push, _ = press()
    first = move(1.0, (0.3, -0.5, 0.3), (0.3, -0.4, 0.3))
    assert precondition_findings((first, grasp, push, opened)) == []
    (missing,) = precondition_findings((first, push))
    assert missing.reason.startswith("presses without a contact")


@pytest.mark.parametrize(("width_m", "is_refused"), [(0.0, False), (0.02, True), (None, True)])
def test_fingers_that_are_shut_release_nothing(width_m: float | None, is_refused: bool) -> None:
    """A program that shuts its empty fingers before it pushes with them was refused, at both moves."""
    first = move(1.0, (0.3, -0.5, 0.3), (0.3, -0.4, 0.3))
    *_, opened, _ = pick_and_place()
    shut = opened.model_copy(update={"gripper_width": width_m})
    found = [one.index for one in precondition_findings((first, shut, first, opened))]
    assert found == ([1] if is_refused else [])


def test_what_is_held_may_be_squeezed_and_the_grip_eased() -> None:
    """A pipette that was squeezed could not be run: something was held already."""
    apps = squeezed()
    squeeze, ease = precondition_findings(apps)
    assert [(one.severity, one.index) for one in (squeeze, ease)] == [("warning", 3), ("warning", 4)]
    assert squeeze.reason.startswith("closes from 50 to 30 mm on the object of app 2 (grasp)")
    assert ease.reason.startswith("opens from 30 to 50 mm around the object of app 2 (grasp)")
    preconditions = [app.preconditions for app in as_file(apps).apps if app.kind == "grasp"]
    assert preconditions == [("not_holding",), ("holding",), ("holding",)]


def test_where_nothing_was_weighed_a_second_grasp_may_be_the_first_one() -> None:
    reach, grasp, lift, squeeze, *rest = squeezed()
    light = lift.model_copy(update={"load_kg": None})
    named = "If that grasp holds nothing, make it a 'move gripper'"
    assert precondition_findings((reach, grasp, light, squeeze, *rest))[0].reason.endswith(named)
    assert named not in precondition_findings(squeezed())[0].reason


@pytest.mark.parametrize("width", [0.05, 0.06, None])
def test_what_is_held_is_not_grasped_as_wide_again(width: float | None) -> None:
    reach, grasp, lift, squeeze, _, *rest = squeezed()
    other = squeeze.model_copy(update={"gripper_width": width})
    (found,) = precondition_findings((reach, grasp, lift, other, *rest))
    assert (found.severity, found.index) == ("error", 3)
    assert found.reason.startswith("grasps, but app 2 (grasp) holds something already")

"""What table and report say of a recording and its preset beside the results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.recording_warnings import UPWARD_N, recording_warnings, upward_force_of_load
from caesura_protocol.formats.read import load_recording
from caesura_protocol.recording import ASSUMED_ORDER
from caesura_protocol.rotations import matrices_of
from caesura_service.offline_segmentation import segment_recording
from harness.tilted import tilted

PICK_AND_PLACE = load_recording(Path(__file__).parents[2] / "data" / "pick_and_place.npz")


def gripper(recording, values):
    return replace(recording, signals={**recording.signals, "gripper": values})


def test_a_gripper_that_never_moved_is_named():
    assert recording_warnings(PICK_AND_PLACE, "default") == ()
    still = gripper(PICK_AND_PLACE, np.full((PICK_AND_PLACE.t.size, 1), 0.08))
    (note,) = recording_warnings(still, "default")
    assert note.startswith("The gripper never moved: it is taken to hold nothing")
    assert recording_warnings(replace(still, wrench_source="flange_sensor_with_hand"), "default") == ()


@pytest.mark.parametrize(
    ("preset", "on", "found"),
    [
        ("default", (True, True), "contact and load are on, for a base whose z axis points up. "),
        ("force", (True, False), "contact is on, load is off: preset force has no model of load. "),
        (
            "constant_velocity",
            (False, False),
            "contact and load are off: preset constant_velocity has no model of contact or load. ",
        ),
    ],
)
def test_what_is_on_is_what_wrench_and_preset_have(preset, on, found):
    """The wrench's note said "contact and load are on" whatever the preset."""
    view = segment_recording(PICK_AND_PLACE, preset)
    assert f"not the guiding hand; {found}" in view.wrench.note
    assert view.notes[0] in view.wrench.note
    assert (view.wrench.contact_models, view.wrench.transport_models) == on
    assert recording_warnings(PICK_AND_PLACE, preset) == ()


def signals(**changes):
    return replace(PICK_AND_PLACE, signals={**PICK_AND_PLACE.signals, **changes})


def test_quaternions_that_fit_the_joints_in_another_order_are_named():
    # w, x, y, z passed for x, y, z, w in silence. Only the joints show it.
    reordered = signals(quat=PICK_AND_PLACE.signals["quat"][:, [3, 0, 1, 2]])
    (warning,) = recording_warnings(reordered, "default")
    assert warning.startswith("Warning: the quaternions agree with the joints in the order w, x, y, z")
    assert "quaternion_order wxyz" in warning


def test_an_order_that_is_stated_and_that_the_joints_do_not_fit_is_named(tmp_path: Path):
    """A program had the orientations of a wrong order, because the file stated one."""
    file = tmp_path / "stated.npz"
    PICK_AND_PLACE.save(file)
    stored = {**np.load(file), "quaternion_order": "wxyz"}
    np.savez(file, **stored)
    (warning,) = recording_warnings(load_recording(file), "default")
    assert "in the order x, y, z, w and not in w, x, y, z, which the file states" in warning
    stored["quat"] = stored["quat"][:, [3, 0, 1, 2]]
    np.savez(file, **stored)
    assert recording_warnings(load_recording(file), "default") == ()


def test_an_assumed_order_is_shown_unless_the_joints_confirm_it():
    assert ASSUMED_ORDER in PICK_AND_PLACE.assumed
    assert recording_warnings(PICK_AND_PLACE, "default") == ()
    alone = {name: values for name, values in PICK_AND_PLACE.signals.items() if name != "q"}
    assert recording_warnings(replace(PICK_AND_PLACE, signals=alone), "default") == (ASSUMED_ORDER,)


def test_a_load_that_pulls_upwards_while_it_is_lifted_is_named():
    # A reversed press was a load of 1.2 kg.
    right, wrong = PICK_AND_PLACE, signals(force=-PICK_AND_PLACE.signals["force"])
    assert upward_force_of_load(right) == pytest.approx(-upward_force_of_load(wrong))
    assert upward_force_of_load(right) < 0.0 < UPWARD_N < upward_force_of_load(wrong)
    (warning,) = recording_warnings(wrong, "default")
    assert "the force points upwards by 2.1 N, at most 2 N are plausible" in warning
    assert "Negate force and torque" in warning
    assert warning.endswith(
        "State --up where the arm is tilted or hangs: the z axis of its base is taken as up."
    )


def test_a_load_pulls_against_the_direction_that_is_up():
    hangs = tilted(PICK_AND_PLACE, np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, -1.0))
    hangs = replace(hangs, assumed=())  # its joints, which confirm the order of its quaternions, are left out
    assert upward_force_of_load(hangs) == pytest.approx(upward_force_of_load(PICK_AND_PLACE))
    assert recording_warnings(hangs, "default") == ()
    wrong = replace(hangs, signals={**hangs.signals, "force": -hangs.signals["force"]})
    (warning,) = recording_warnings(wrong, "default")
    assert "the force points upwards by 2.1 N" in warning
    assert "--up" not in warning


def test_what_is_not_used_is_a_warning():
    frozen = replace(PICK_AND_PLACE, wrench_source="none", cautions=("The force is frozen.",))
    assert recording_warnings(frozen, "default") == ("Warning: The force is frozen.",)


def flange_axes():
    """Rotations (n, 3, 3) of the flange in the base frame."""
    return matrices_of(PICK_AND_PLACE.signals["quat"])


def test_positions_of_a_tool_centre_point_are_named_with_the_offset():
    """A controller's TCP passed for the flange in silence: targets of the program were off by its length."""
    offset = flange_axes() @ np.array([0.0, 0.0, 0.174])
    (warning,) = recording_warnings(signals(pos=PICK_AND_PLACE.signals["pos"] + offset), "default")
    assert "lie 174 mm (median) from the flange of panda as the joints have it" in warning
    assert "a point at (0, 0, 174) mm in the axes of the flange" in warning
    assert "or leave the positions out" in warning


def test_positions_in_the_base_frame_of_ros_are_named():
    turned = PICK_AND_PLACE.signals["pos"] * [-1.0, -1.0, 1.0]
    (warning,) = recording_warnings(signals(pos=turned), "default")
    assert "turned by 180° about z" in warning


def test_joints_of_another_arm_are_named_stated_or_assumed():
    other = replace(PICK_AND_PLACE, setting=PICK_AND_PLACE.setting._replace(robot="iiwa14"))
    found = recording_warnings(other, "default")
    assert any("from the flange of iiwa14 as the joints have it. Is it another arm" in one for one in found)
    moved = signals(q=PICK_AND_PLACE.signals["q"] + 0.3)
    unstated = replace(moved, setting=moved.setting._replace(robot=None))
    found = recording_warnings(unstated, "default")
    assert any("of panda, which is assumed, as the joints have it. State --robot" in one for one in found)


def test_an_arm_that_is_calibrated_otherwise_agrees_with_its_joints():
    assert recording_warnings(signals(pos=PICK_AND_PLACE.signals["pos"] + 0.004), "default") == ()

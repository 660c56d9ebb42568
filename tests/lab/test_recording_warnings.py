"""What table and report say of a recording and its preset beside the results."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from caesura_lab.recording_warnings import recording_warnings
from caesura_protocol.formats.read import load_recording
from caesura_service.offline_segmentation import segment_recording

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
        ("default", (True, True), "contact and load are on. "),
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

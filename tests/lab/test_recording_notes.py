"""What table and report say of a recording and its preset beside the results."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from caesura_lab.recording_notes import recording_notes
from caesura_protocol.formats.read import load_recording

PICK_AND_PLACE = load_recording(Path(__file__).parents[2] / "data" / "pick_and_place.npz")


def gripper(recording, values):
    return replace(recording, signals={**recording.signals, "gripper": values})


def test_a_gripper_that_never_moved_is_named():
    assert recording_notes(PICK_AND_PLACE, "default") == ()
    still = gripper(PICK_AND_PLACE, np.full((PICK_AND_PLACE.t.size, 1), 0.08))
    (note,) = recording_notes(still, "default")
    assert note.startswith("The gripper never moved: it is taken to hold nothing")
    assert recording_notes(replace(still, wrench_source="flange_sensor_with_hand"), "default") == ()


def test_a_preset_without_contact_models_says_so():
    # The wrench's own note says that contact and load are on.
    (note,) = recording_notes(PICK_AND_PLACE, "constant_velocity")
    assert note == "Preset constant_velocity has no models of contact and load, which stay off."
    assert recording_notes(PICK_AND_PLACE, "force") == ()

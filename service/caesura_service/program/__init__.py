"""Task programs: segments and gripper events become apps that a robot can run."""

from caesura_protocol.reproduced_path import TOLERANCE_M, TOLERANCE_RAD
from caesura_service.program.apps.app_builder import task_program
from caesura_service.program.apps.paths import Paths
from caesura_service.program.gaps import Gaps, observed_share
from caesura_service.program.interpretation.carried_loads import away_from_contacts
from caesura_service.program.interpretation.contacts import may_press_in
from caesura_service.program.interpretation.joined_movements import is_end_of_movement
from caesura_service.program.interpretation.joined_strokes import may_end_movement
from caesura_service.program.interpretation.regrips import with_regrips
from caesura_service.program.interpretation.segment_interpretation import kept_steps
from caesura_service.program.notes.parts_in_no_app import (
    BEGINS_MOVING,
    ENDS_MOVING,
    detours,
    parts_in_no_app_note,
)
from caesura_service.program.notes.turned_biases import turned_biases_note
from caesura_service.program.notes.unreproduced_finger_motion import unreproduced_finger_motion
from caesura_service.program.notes.unreproduced_load_changes import unreproduced_load_changes_note
from caesura_service.program.notes.unreproduced_pulls import unreproduced_pulls_note
from caesura_service.program.notes.unreproduced_torques import unreproduced_torques_note
from caesura_service.program.notes.unreproduced_touches import unreproduced_touches_note
from caesura_service.program.program_segment import (
    GRIP_SLACK_S,
    Context,
    GripperAction,
    Moment,
    MomentAt,
    ProgramSegment,
    holds,
)

__all__ = [
    "BEGINS_MOVING",
    "ENDS_MOVING",
    "GRIP_SLACK_S",
    "TOLERANCE_M",
    "TOLERANCE_RAD",
    "Context",
    "Gaps",
    "GripperAction",
    "Moment",
    "MomentAt",
    "Paths",
    "ProgramSegment",
    "away_from_contacts",
    "detours",
    "holds",
    "is_end_of_movement",
    "kept_steps",
    "may_end_movement",
    "may_press_in",
    "observed_share",
    "parts_in_no_app_note",
    "task_program",
    "turned_biases_note",
    "unreproduced_finger_motion",
    "unreproduced_load_changes_note",
    "unreproduced_pulls_note",
    "unreproduced_torques_note",
    "unreproduced_touches_note",
    "with_regrips",
]

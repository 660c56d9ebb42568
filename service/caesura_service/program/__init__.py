"""Task programs: segments and gripper events become apps that a robot can run."""

from caesura_protocol.reproduced_path import TOLERANCE_M, TOLERANCE_RAD
from caesura_service.program.builder import task_program
from caesura_service.program.contacts import may_press_in
from caesura_service.program.draft_cache import DraftCache
from caesura_service.program.edit_log import EditLog, log_of
from caesura_service.program.edits import at_edit, check_applies, with_edits
from caesura_service.program.gaps import Gaps, observed_share
from caesura_service.program.left_out import BEGINS_MOVING, ENDS_MOVING, left_out_note
from caesura_service.program.movements import is_end_of_movement
from caesura_service.program.paths import Paths
from caesura_service.program.program_segment import (
    GRIP_SLACK_S,
    GripperAction,
    Moment,
    MomentAt,
    ProgramSegment,
    holds,
)
from caesura_service.program.strokes import may_end_movement

__all__ = [
    "BEGINS_MOVING",
    "ENDS_MOVING",
    "GRIP_SLACK_S",
    "TOLERANCE_M",
    "TOLERANCE_RAD",
    "DraftCache",
    "EditLog",
    "Gaps",
    "GripperAction",
    "Moment",
    "MomentAt",
    "Paths",
    "ProgramSegment",
    "at_edit",
    "check_applies",
    "holds",
    "is_end_of_movement",
    "left_out_note",
    "log_of",
    "may_end_movement",
    "may_press_in",
    "observed_share",
    "task_program",
    "with_edits",
]

"""Task programs: segments and gripper events become apps that a robot can run."""

from caesura_service.program.apps import (
    FORCE_LIMIT_N,
    GRIP_SLACK_S,
    Grip,
    Moment,
    MomentAt,
    Step,
    task_program,
)
from caesura_service.program.gaps import gap_note, observed_share

__all__ = [
    "FORCE_LIMIT_N",
    "GRIP_SLACK_S",
    "Grip",
    "Moment",
    "MomentAt",
    "Step",
    "gap_note",
    "observed_share",
    "task_program",
]

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
from caesura_service.program.gaps import Gaps, observed_share
from caesura_service.program.limiting import with_force_limit

__all__ = [
    "FORCE_LIMIT_N",
    "GRIP_SLACK_S",
    "Gaps",
    "Grip",
    "Moment",
    "MomentAt",
    "Step",
    "observed_share",
    "task_program",
    "with_force_limit",
]

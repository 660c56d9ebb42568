"""Task programs: segments and gripper events become apps that a robot can run."""

from caesura_service.program.apps import FORCE_LIMIT_N, GRIP_SLACK_S, task_program
from caesura_service.program.gaps import Gaps, observed_share
from caesura_service.program.limiting import with_force_limit
from caesura_service.program.steps import Grip, Moment, MomentAt, Step, holds

__all__ = [
    "FORCE_LIMIT_N",
    "GRIP_SLACK_S",
    "Gaps",
    "Grip",
    "Moment",
    "MomentAt",
    "Step",
    "holds",
    "observed_share",
    "task_program",
    "with_force_limit",
]

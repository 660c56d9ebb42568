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

__all__ = ["FORCE_LIMIT_N", "GRIP_SLACK_S", "Grip", "Moment", "MomentAt", "Step", "task_program"]

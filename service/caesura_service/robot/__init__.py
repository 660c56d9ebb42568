"""The robot: Panda kinematics and dynamics behind one typed facade."""

from caesura_service.robot.kinematics import (
    JOINTS,
    HandDynamics,
    Pose,
    ReachError,
    Robot,
    load_panda,
)

__all__ = ["JOINTS", "HandDynamics", "Pose", "ReachError", "Robot", "load_panda"]

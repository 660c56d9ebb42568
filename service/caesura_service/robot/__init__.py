"""The robot: Panda kinematics and dynamics behind one typed facade."""

from caesura_service.robot.kinematics import (
    JOINTS,
    FlangePose,
    HandDynamics,
    ReachError,
    Robot,
    load_panda,
)

__all__ = ["JOINTS", "FlangePose", "HandDynamics", "ReachError", "Robot", "load_panda"]

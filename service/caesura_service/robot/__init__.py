"""The robot: kinematics and dynamics of the Panda behind one typed interface."""

from caesura_service.robot.kinematics import (
    JOINTS,
    FlangePose,
    HandDynamics,
    ReachError,
    Robot,
    load_panda,
)

__all__ = ["JOINTS", "FlangePose", "HandDynamics", "ReachError", "Robot", "load_panda"]

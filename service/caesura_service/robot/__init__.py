"""The robot: kinematics and dynamics of the Panda behind one typed interface."""

from caesura_service.robot.kinematics import (
    FlangePose,
    HandDynamics,
    ReachError,
    Robot,
    load_panda,
)

__all__ = ["FlangePose", "HandDynamics", "ReachError", "Robot", "load_panda"]

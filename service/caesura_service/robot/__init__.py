"""The robot: kinematics and dynamics of an arm behind one typed interface."""

from caesura_service.robot.robot_model import (
    FlangePose,
    HandDynamics,
    ReachError,
    Robot,
    load_panda,
    load_robot,
)

__all__ = ["FlangePose", "HandDynamics", "ReachError", "Robot", "load_panda", "load_robot"]

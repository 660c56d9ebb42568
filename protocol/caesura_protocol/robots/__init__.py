"""Robots as data: one folder each, with a description and a URDF."""

from caesura_protocol.robots.description import (
    RobotDescription,
    RobotError,
    robot_description,
    robot_names,
)

__all__ = ["RobotDescription", "RobotError", "robot_description", "robot_names"]

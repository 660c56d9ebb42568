"""Robots as data: one folder each, with a description and a URDF."""

from caesura_protocol.robots.description import (
    RobotDescription,
    RobotError,
    robot_description,
    robot_names,
)
from caesura_protocol.robots.grippers import GripperDescription, GripperError, gripper, grippers

__all__ = [
    "GripperDescription",
    "GripperError",
    "RobotDescription",
    "RobotError",
    "gripper",
    "grippers",
    "robot_description",
    "robot_names",
]

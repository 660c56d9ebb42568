"""The limits of a program whose cell states none: defaults that depend on its robot."""

from __future__ import annotations

from pathlib import Path

from caesura_protocol.programs.safety import DEFAULT, Safety, read_safety
from caesura_protocol.robots import RobotError, robot_description

OF_ROBOT = ("load_kg", "workspace_low", "workspace_high")  # fields that follow from the robot
DEFAULT_ROBOT = "panda"  # whose limits are the default


def safety_for(robot: str | None) -> Safety:
    """Return the default limits of a cell: the robot's payload, and a box that fits its reach.

    The box is a Panda's, scaled by the reach of a longer arm; its floor is constant. robot: its name; None or
    an unknown name: the default.
    """
    try:
        arm = None if robot is None else robot_description(robot)
    except RobotError:
        arm = None
    if arm is None:
        return DEFAULT
    longer = max(arm.reach_m / robot_description(DEFAULT_ROBOT).reach_m, 1.0)
    x, y, z = (round(longer * most, 2) for most in DEFAULT.workspace_high)
    box = {"workspace_low": (-x, -y, DEFAULT.workspace_low[2]), "workspace_high": (x, y, z)}
    return DEFAULT.model_copy(update={"load_kg": arm.payload_kg, **box})


def cell_safety(path: Path, robot: str | None) -> Safety:
    """Return the limits in a cell's file, completed by the defaults of the robot.

    Raises CaesuraError as `read_safety`.
    """
    stated, own = read_safety(path), safety_for(robot)
    unstated = {name: getattr(own, name) for name in OF_ROBOT if name not in stated.model_fields_set}
    return stated.model_copy(update=unstated)


def re_targeted(safety: Safety, before: str | None, robot: str | None) -> Safety:
    """Return the limits of a program on another robot.

    Limits that were the earlier robot's defaults become those of the new one.
    """
    was, now = safety_for(before), safety_for(robot)
    own = [name for name in OF_ROBOT if getattr(safety, name) == getattr(was, name)]
    return safety.model_copy(update={name: getattr(now, name) for name in own})

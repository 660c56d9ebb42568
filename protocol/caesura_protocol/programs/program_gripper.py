"""The gripper of a program, stated or its robot's, and the program's limits with it."""

from __future__ import annotations

from collections.abc import Container, Sequence

from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.safety import Safety
from caesura_protocol.robots import GripperDescription, gripper, grippers, robot_description

GRIP_REACH_M = 0.04  # an object is between the fingers within this distance from where it was grasped
GRIPS = ("grasp", "gripper_move")
SURE_SDS = 2.0  # deviations of a load from nothing, or from another one, above which it is significant
SHUT_M = 0.003  # between fingers that hold nothing


def held_loads(apps: Sequence[App]) -> list[float | None]:
    """Return the load [kg] that each app carries; None where nothing is carried, or its load is unknown.

    Of what is held since a grip, a load that was not measured, or whose difference is not significant, is
    that of the app before.
    """
    loads: list[float | None] = []
    held: float | None = None
    for app in apps:
        if app.kind in GRIPS:
            held = None
        carries, kg = APP_KINDS[app.kind].carries, app.load_kg
        if carries and kg is not None:
            held = kg if held is None or abs(kg - held) > SURE_SDS * (app.load_sd_kg or 0.0) else held
        loads.append(held if carries else None)
    return loads


def with_held_loads(program: ProgramFile) -> ProgramFile:
    """Return the program with `held_loads`: a controller is given the load of what is held once.

    Some zero their sensor with it, which may touch something at the next carry.
    """
    apps = tuple(
        app if load is None else app.model_copy(update={"load_kg": load})
        for app, load in zip(program.apps, held_loads(program.apps), strict=True)
    )
    return program.model_copy(update={"apps": apps})


def gripper_of(program: ProgramFile) -> GripperDescription | None:
    """Return the gripper that a program states, or that its robot has; None if neither is known.

    Raises GripperError or RobotError for an unknown name.
    """
    if program.gripper is not None:
        return gripper(program.gripper)
    return None if program.robot is None else robot_description(program.robot).gripper


def with_gripper(program: ProgramFile, name: str | None) -> ProgramFile:
    """Return the program with a gripper, by its name; None: unchanged. Raises GripperError."""
    if name is None:
        return program
    gripper(name)
    return program.model_copy(update={"gripper": name})


def within_gripper(safety: Safety, held_by: GripperDescription | None) -> Safety:
    """Return the limits for a gripper: its opening, and force and speed within its range."""
    if held_by is None:
        return safety
    force, speed = held_by.clamped(safety.grasp_force_n, safety.gripper_m_per_s)
    limits: dict[str, float] = {"grasp_force_n": force, "gripper_m_per_s": speed}
    if held_by.opening_m is not None:
        limits["gripper_width_m"] = held_by.opening_m
    return safety.model_copy(update=limits)


def not_driven(
    where: str, script: str, held_by: GripperDescription | None, interfaces: Container[str | None]
) -> str:
    """Return the error for a gripper that a script cannot drive, with the names of those that it can.

    interfaces: those that the script drives; where: names the part of the program.
    """
    title = "no gripper is stated" if held_by is None else f"{script} does not drive a {held_by.title}"
    known = [name for name, one in grippers().items() if one.interface in interfaces]
    return f"{where}: {title}, expected --gripper, or Gripper in the dashboard: {', '.join(known)}"

"""Checks of a task program before a run: a program that cannot be run is refused before the robot moves.

There are seven checks, one module each. Six need no robot and are in `caesura_protocol.programs.checks`:
`timing` of re-timed apps, `value_ranges` of each app, `gripper_capability`, `preconditions` of each
app, `workspace` of targets, and `fidelity` to the demonstration; the last two need finite numbers. If none of
their numbers is out of range, `reachability` checks the arm: joints, inverse kinematics along the path, and
obstacles.
"""

from __future__ import annotations

from collections.abc import Sequence

from caesura_lab.execution.cell_limits import Cell
from caesura_lab.execution.checks.reachability import reach_findings
from caesura_protocol.messages import App
from caesura_protocol.programs.checks import (
    DemonstrationQuality,
    are_numbers_finite,
    fidelity_findings,
    gripper_findings,
    precondition_findings,
    timing_findings,
    value_findings,
    workspace_findings,
)
from caesura_protocol.programs.checks.findings import CheckReport, Finding, with_names
from caesura_protocol.programs.program_gripper import within_gripper
from caesura_protocol.robots import GripperDescription
from caesura_service.robot import Robot

__all__ = ["DemonstrationQuality", "check"]

NO_ROBOT = Finding(
    "warning", None, None, "reach was not checked: the program states no robot; state it with --robot"
)


def check(
    apps: Sequence[App],
    cell: Cell | None = None,
    quality: DemonstrationQuality | None = None,
    robot: Robot | None = None,
    gripper: GripperDescription | None = None,
) -> CheckReport:
    """Return all findings on a program, app by app; deterministic.

    cell: limits, obstacles and the robot's start; quality: facts about the demonstration; robot: without one,
    reach is not checked, and a warning states that; gripper: without one, the fingers' widths are compared
    with the limits of the cell.
    """
    cell = cell or Cell()
    if not apps:
        return CheckReport((Finding("error", None, None, "has no apps, there is nothing to run"),))
    found = [
        *timing_findings(None if quality is None else quality.timing),
        *value_findings(apps, within_gripper(cell.safety, gripper)),
        *gripper_findings(apps, cell.safety, gripper),
    ]
    finite, broken = are_numbers_finite(apps), any(one.severity == "error" for one in found)
    found += precondition_findings(apps)
    if finite:
        found += workspace_findings(apps, cell.safety)
    if not broken:
        found += [NO_ROBOT] if robot is None else reach_findings(apps, cell, robot)
    if finite:
        found += fidelity_findings(apps, quality, cell.safety)
    named = with_names(found, apps)
    return CheckReport(tuple(sorted(named, key=lambda one: -1 if one.index is None else one.index)))

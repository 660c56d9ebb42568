"""Pre-run checks of a task program: what cannot be run is refused before anything moves.

Seven checks, one module each, of which six need no robot and are in `caesura_protocol.programs.checks`:
`timing` of what was re-timed, `value_ranges` of every app for itself, `gripper_capability` of what the
gripper has, `preconditions` of what holds before each app, `workspace` of targets, and `fidelity` of what was
taught and is not reproduced. Once the numbers are sane, `reachability` checks the arm: joints, inverse
kinematics along the way, what stands in it.
"""

from __future__ import annotations

from collections.abc import Sequence

from caesura_lab.execution.cell import Cell
from caesura_lab.execution.checks.reachability import reach_findings
from caesura_protocol.messages import App
from caesura_protocol.programs.checks import (
    DemonstrationQuality,
    fidelity_findings,
    gripper_findings,
    order_findings,
    timing_findings,
    value_findings,
    workspace_findings,
)
from caesura_protocol.programs.checks.findings import CheckReport, Finding
from caesura_protocol.programs.gripping import within_gripper
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
    """Return everything that is wrong with a program, app by app; deterministic.

    cell: limits, what stands there and where the robot begins; quality: what is known of the demonstration;
    robot: without one, reach is not checked, and a warning says so; gripper: without one, the fingers' widths
    are compared with the limits of the cell.
    """
    cell = cell or Cell()
    if not apps:
        return CheckReport((Finding("error", None, None, "has no apps, there is nothing to run"),))
    found = [
        *timing_findings(None if quality is None else quality.timing),
        *value_findings(apps, within_gripper(cell.safety, gripper)),
        *(() if gripper is None else gripper_findings(apps, cell.safety, gripper)),
    ]
    broken = any(one.severity == "error" for one in found)
    found += order_findings(apps)
    if not broken:
        found += workspace_findings(apps, cell.safety)
        found += [NO_ROBOT] if robot is None else reach_findings(apps, cell, robot)
        found += fidelity_findings(apps, quality, cell.safety)
    return CheckReport(tuple(sorted(found, key=lambda one: -1 if one.index is None else one.index)))

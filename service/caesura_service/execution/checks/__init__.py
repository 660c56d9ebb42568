"""Pre-run checks of a task program: what cannot be run is refused before anything moves.

Three looks, one module each: `values` at every app for itself, `order` at what holds before each app, `reach`
at the arm: joints, inverse kinematics along the way, what stands in it, once the numbers are sane.
"""

from __future__ import annotations

from collections.abc import Sequence

from caesura_protocol.messages import App
from caesura_service.execution.checks.order import order_findings
from caesura_service.execution.checks.reach import reach_findings
from caesura_service.execution.checks.values import note_findings, value_findings
from caesura_service.execution.findings import Finding, Report
from caesura_service.execution.limits import Cell
from caesura_service.robot import Robot, load_panda

__all__ = ["check"]


def check(
    apps: Sequence[App], cell: Cell | None = None, notes: Sequence[str] = (), robot: Robot | None = None
) -> Report:
    """Everything that is wrong with a program, app by app; deterministic.

    cell: limits, what stands there and where the robot begins; notes: the program's, which name gaps.
    """
    cell = cell or Cell()
    if not apps:
        return Report((Finding("error", None, None, "has no apps, there is nothing to run"),))
    found = [*value_findings(apps, cell.safety), *note_findings(apps, notes)]
    broken = any(one.severity == "error" for one in found)
    found += order_findings(apps)
    if not broken:
        found += reach_findings(apps, cell, robot or load_panda())
    return Report(tuple(sorted(found, key=lambda one: -1 if one.index is None else one.index)))

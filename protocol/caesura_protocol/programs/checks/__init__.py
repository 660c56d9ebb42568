"""Checks of a program that need no robot: numbers, order, timing, workspace, mounting, and fidelity.

`caesura check` adds the check of reach from the lab, because it needs the kinematics of a robot.
"""

from __future__ import annotations

from collections.abc import Iterator

from caesura_protocol.number_words import fixed
from caesura_protocol.programs.apps_by_phase import groups_by_first
from caesura_protocol.programs.checks.fidelity import DemonstrationQuality, fidelity_findings
from caesura_protocol.programs.checks.findings import Finding, with_names
from caesura_protocol.programs.checks.gripper_capability import gripper_findings
from caesura_protocol.programs.checks.mounting import mounting_findings
from caesura_protocol.programs.checks.preconditions import precondition_findings
from caesura_protocol.programs.checks.timing import timing_findings
from caesura_protocol.programs.checks.value_ranges import are_numbers_finite, value_findings
from caesura_protocol.programs.checks.workspace import workspace_findings
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.program_gripper import gripper_of, within_gripper
from caesura_protocol.robots import GripperError, RobotError

__all__ = [
    "DemonstrationQuality",
    "are_numbers_finite",
    "document_findings",
    "fidelity_findings",
    "findings_beside_notes",
    "gripper_findings",
    "group_findings",
    "mounting_findings",
    "precondition_findings",
    "timing_findings",
    "unfinished_findings",
    "value_findings",
    "workspace_findings",
]


def document_findings(program: ProgramFile) -> list[Finding]:
    """Return all findings on a program that need no robot, errors first."""
    quality = DemonstrationQuality(program.gaps, program.wrench, program.timing, program.notes)
    found = [*unfinished_findings(program), *mounting_findings(program.up), *group_findings(program)]
    try:
        held_by = gripper_of(program)
    except (GripperError, RobotError) as error:
        held_by = None
        found.append(Finding("warning", None, None, f"the gripper was not checked: {error}"))
    found += [
        *timing_findings(program.timing),
        *value_findings(program.apps, within_gripper(program.safety, held_by)),
        *gripper_findings(program.apps, program.safety, held_by),
    ]
    found += precondition_findings(program.apps)
    if are_numbers_finite(program.apps):
        found += workspace_findings(program.apps, program.safety)
        found += fidelity_findings(program.apps, quality, program.safety)
    return sorted(with_names(found, program.apps), key=lambda one: one.severity)


def unfinished_findings(program: ProgramFile) -> Iterator[Finding]:
    """Yield a warning on a program whose demonstration had not ended."""
    if not program.complete:
        reason = f"was still being taught at {fixed(program.t, 1)} s: what was taught after that is missing"
        yield Finding("warning", None, None, reason, program.t, None)


def group_findings(program: ProgramFile) -> Iterator[Finding]:
    """Yield a warning on each group that a program with these apps cannot have."""
    shown = groups_by_first(program.groups, len(program.apps)).values()
    for group in program.groups:
        if group not in shown:
            reason = (
                f"group {group.heading} is not shown: it has apps of another group, or ones that do not exist"
            )
            yield Finding("warning", None, None, reason)


def findings_beside_notes(program: ProgramFile) -> list[Finding]:
    """Return the findings of `document_findings`, errors first, without those that the notes state.

    None of a program that is being taught and has no edits: what is missing may still be taught.
    """
    if not program.apps or not (program.complete or program.edits):
        return []
    return [
        one
        for one in document_findings(program)
        if one.index is not None or (one.on_page or one.reason) not in program.notes
    ]

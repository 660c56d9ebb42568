"""Findings of a check on the program of a segmentation, for its tables."""

from __future__ import annotations

from caesura_protocol.messages import MAX_GAPS, Program
from caesura_protocol.programs.checks import findings_beside_notes
from caesura_protocol.programs.document import document
from caesura_service.segmentation.pipeline_interface import PipelineView


def program_findings(view: PipelineView) -> tuple[str, ...]:
    """Return the findings that need no robot kinematics, without those that the notes of the view state."""
    program = Program(
        station="file",
        session="recording",
        instance="file",
        epoch=0,
        version=0,
        t=max((app.tn for app in view.apps), default=0.0),
        complete=True,
        apps=tuple(view.apps),
        notes=view.notes,
        gaps=view.gaps[-MAX_GAPS:],
        wrench=view.wrench,
        force_limit_n=view.force_limit_n,
        robot=view.robot,
        up=view.up,
    )
    found, noted = findings_beside_notes(document(program)), view.wrench.note
    said = (one for one in found if one.index is not None or (one.on_page or one.reason) not in noted)
    return tuple(map(str, said))

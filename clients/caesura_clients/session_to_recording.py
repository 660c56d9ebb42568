"""A session's samples as a recording that declares the same as the session."""

from __future__ import annotations

from collections.abc import Sequence

from caesura_protocol.codec import signals_of
from caesura_protocol.formats.unvalidated_recording import Array
from caesura_protocol.messages import LengthUnit, Program, SessionStatus
from caesura_protocol.programs.safety import CellSettings
from caesura_protocol.recording import ASSUMED, ASSUMED_FRAME, Recording


def stated_recording(
    columns: Sequence[str], rows: Array, status: SessionStatus, program: Program, *, unit: LengthUnit
) -> Recording:
    """Return samples (n, columns), time first, as a recording that declares the same as their session.

    Declared are the wrench source, the hand, the frame of the force, robot, up and force limit. unit: length
    unit of the positions. The results do not contain the tolerances of paths; the service's defaults apply.
    """
    wrench = status.wrench
    said = (*program.notes, *(() if wrench.frame_stated else (ASSUMED_FRAME,)))
    return Recording(
        rows[:, 0],
        signals_of(columns, rows),
        wrench_source=wrench.source if wrench.stated else None,
        hand_on_robot=wrench.hand_on_robot,
        force_frame=wrench.frame,
        assumed=tuple(words for words in ASSUMED.values() if words in said),
        length_unit=unit,
        name=status.session,
        setting=CellSettings(program.force_limit_n, robot=program.robot, up=wrench.up),
        description=status.description,
        changes=program.revision + program.edit_revision,
    )

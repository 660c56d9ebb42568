"""Writes a session as an MCAP file (`formats.mcap_write`); poses of joints are computed by kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from caesura_lab.export.session_from_journal import SessionExport
from caesura_protocol.formats.mcap_write import (
    NO_POSES,
    TRANSFORM_S,
    UPRIGHT,
    Array,
    McapContent,
    McapMessage,
    Poses,
    decimate,
)
from caesura_protocol.formats.mcap_write import entries as entries_of
from caesura_protocol.formats.mcap_write import write_mcap as write
from caesura_service.segmentation.opening_layout import layout_of
from caesura_service.signals import SampleLayout
from caesura_service.signals.flange_pose_and_force import columns_of, flange_rows


def write_mcap(path: Path, session: SessionExport) -> int:
    """Write the file, completely or not at all; return the number of messages. Raises OSError."""
    return write(path, content_of(session))


def entries(session: SessionExport) -> list[McapMessage]:
    """Return every message in order of time."""
    return list(entries_of(content_of(session)))


def content_of(session: SessionExport) -> McapContent:
    """Return the content of a session's MCAP file."""
    opening, view = session.opening, session.view
    return McapContent(
        station=session.station,
        session=opening.session,
        preset=opening.preset or "",
        recording=session.recording,
        began_s=session.began_s,
        columns=opening.columns,
        poses=_poses(session),
        segments=tuple(view.segments),
        phases=tuple(view.phases),
        changepoints=tuple(view.changepoints),
        gaps=view.gaps,
        program=session.program,
        wrench_note=view.wrench.note,
    )


def _poses(session: SessionExport) -> Poses:
    """Return times and poses of the flange, TRANSFORM_S apart or more; upright without an orientation."""
    opening = session.opening.model_copy(update={"columns": session.recording.columns})
    layout = layout_of(opening)
    times, values = _read(layout, session.recording.matrix())
    kept = decimate(times, TRANSFORM_S)
    if not kept:
        return NO_POSES
    columns = columns_of(layout)
    rows = flange_rows(layout, columns, values[kept])
    upright = np.tile(UPRIGHT, (len(kept), 1))
    turned = upright if columns.orientation is None else rows[:, columns.orientation]
    return Poses(times[kept], rows[:, columns.position], turned)


def _read(layout: SampleLayout, samples: Array) -> tuple[Array, Array]:
    """Return times and used columns, without the samples that the service refused."""
    try:
        return layout.read(samples)
    except ValueError:
        good = [row for row in np.split(samples, len(samples)) if _is_possible(layout, row)]
        return layout.read(np.concatenate(good or [samples[:0]]))


def _is_possible(layout: SampleLayout, sample: Array) -> bool:
    try:
        layout.read(sample)
    except ValueError:
        return False
    return True

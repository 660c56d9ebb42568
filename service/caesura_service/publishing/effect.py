"""What an edit changes: the segments, apps and phases in which two states of a session differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Generic, NamedTuple, TypeVar

from caesura_protocol.messages import (
    MAX_EFFECT_ROWS,
    App,
    AppOutline,
    EditEffect,
    Message,
    Phase,
    PhaseOutline,
    Segment,
    SegmentOutline,
)
from caesura_service.cooperative_scheduler import give_way
from caesura_service.publishing.session_state import SessionState, program_of
from caesura_service.segmentation.encoded_log import AT_ONCE, M, alike

Row = TypeVar("Row", bound=Message)


class _Difference(NamedTuple, Generic[Row]):
    """Rows from the first to the last that differ, as many as an effect lists."""

    first: int  # so many equal ones come before them
    before: tuple[Row, ...]
    after: tuple[Row, ...]
    left_out: int  # of both, that are not listed


def effect_of(before: SessionState, after: SessionState) -> EditEffect:
    """State what differs between two states of a session; gives way meanwhile."""
    segments = _difference(before.view.segments, after.view.segments, _segment)
    apps = _difference(program_of(before).apps, program_of(after).apps, _app)
    phases = _difference(before.view.phases, after.view.phases, _phase)
    return EditEffect(
        first_segment=segments.first,
        segments_before=segments.before,
        segments_after=segments.after,
        first_app=apps.first,
        apps_before=apps.before,
        apps_after=apps.after,
        first_phase=phases.first,
        phases_before=phases.before,
        phases_after=phases.after,
        more=segments.left_out + apps.left_out + phases.left_out,
    )


def _difference(before: Sequence[M], after: Sequence[M], outline: Callable[[M], Row]) -> _Difference[Row]:
    known = alike(before, after)
    old, new = (_outlines(rows, known, outline) for rows in (before, after))
    shorter = min(len(old), len(new))
    first = next((i for i in range(shorter) if old[i] != new[i]), shorter)
    behind = next((i for i in range(shorter - first) if old[-1 - i] != new[-1 - i]), shorter - first)
    differing = tuple(tuple(rows[first : len(rows) - behind]) for rows in (old, new))
    listed = [rows[:MAX_EFFECT_ROWS] for rows in differing]
    left_out = sum(map(len, differing)) - sum(map(len, listed))
    return _Difference(known + first, listed[0], listed[1], left_out)


def _outlines(rows: Sequence[M], first: int, outline: Callable[[M], Row]) -> list[Row]:
    outlines: list[Row] = []
    for start in range(first, len(rows), AT_ONCE):
        outlines += [outline(one) for one in rows[start : start + AT_ONCE]]
        give_way()
    return outlines


def _segment(one: Segment) -> SegmentOutline:
    return SegmentOutline(t0=one.t0, tn=one.tn, kind=one.kind)


def _phase(one: Phase) -> PhaseOutline:
    return PhaseOutline(t0=one.t0, tn=one.tn, kind=one.kind, name=one.name)


def _app(one: App) -> AppOutline:
    return AppOutline(
        kind=one.kind,
        t0=one.t0,
        tn=one.tn,
        target=one.target,
        force=one.force,
        load_kg=one.load_kg,
        gripper_width=one.gripper_width,
    )

"""The effect of an edit: the segments, apps and phases in which two states of a session differ."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from operator import attrgetter
from typing import Generic, NamedTuple, TypeVar

from caesura_protocol.messages import (
    MAX_EFFECT_ROWS,
    AppOutline,
    EditEffect,
    Message,
    PhaseOutline,
    SegmentOutline,
)
from caesura_service.cooperative_scheduler import give_way
from caesura_service.publishing.session_state import SessionState, program_of
from caesura_service.segmentation.encoded_log import AT_ONCE, M, alike

Row = TypeVar("Row", bound=Message)

_LOAD, _SPREAD = ("load_kg", "load_sd_kg"), ("load_sd_kg",)


class _Difference(NamedTuple, Generic[Row]):
    """The range of rows that differ, first to last, as far as an effect lists them."""

    first: int  # so many equal ones come before them
    before: tuple[Row, ...]
    after: tuple[Row, ...]
    left_out: int  # of both, that are not listed


def effect_of(before: SessionState, after: SessionState) -> EditEffect:
    """Return the differences between two states of a session; gives way to other work meanwhile."""
    segments = _difference(before.view.segments, after.view.segments, SegmentOutline, apart=_LOAD)
    apps = _difference(program_of(before).apps, program_of(after).apps, AppOutline, apart=_SPREAD)
    phases = _difference(before.view.phases, after.view.phases, PhaseOutline)
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


def is_alike(one: SessionState, other: SessionState) -> bool:
    """Return whether two states of a session have the same outlines; gives way to other work meanwhile."""
    effect = effect_of(one, other)
    segments, apps = (effect.segments_before, effect.segments_after), (effect.apps_before, effect.apps_after)
    return not any((*segments, *apps, effect.phases_before, effect.phases_after))


def _difference(
    before: Sequence[M], after: Sequence[M], outline: type[Row], apart: Collection[str] = ()
) -> _Difference[Row]:
    """Return the outlines of rows that differ. apart: fields whose difference does not count."""
    known = alike(before, after)
    compared = attrgetter(*(name for name in outline.model_fields if name not in apart))
    old, new = (_values(rows, known, compared) for rows in (before, after))
    shorter = min(len(old), len(new))
    first = next((i for i in range(shorter) if old[i] != new[i]), shorter)
    behind = next((i for i in range(shorter - first) if old[-1 - i] != new[-1 - i]), shorter - first)
    counts = [len(rows) - behind - first for rows in (old, new)]
    listed = [
        tuple(_outline(outline, rows[known + first + i]) for i in range(min(count, MAX_EFFECT_ROWS)))
        for rows, count in zip((before, after), counts, strict=True)
    ]
    left_out = sum(counts) - sum(map(len, listed))
    return _Difference(known + first, listed[0], listed[1], left_out)


def _values(rows: Sequence[M], first: int, compared: Callable[[M], object]) -> list[object]:
    values: list[object] = []
    for start in range(first, len(rows), AT_ONCE):
        values += map(compared, rows[start : start + AT_ONCE])
        give_way()
    return values


def _outline(outline: type[Row], one: Message) -> Row:
    return outline(**{name: getattr(one, name) for name in outline.model_fields})

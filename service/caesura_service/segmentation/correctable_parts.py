"""The parts of a view that an operator may correct: changepoints, segments, apps and phases."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from itertools import pairwise

from caesura_service.cooperative_scheduler import give_way
from caesura_service.segmentation.corrections import EditContext, VisibleChangepoint, VisibleSegment
from caesura_service.segmentation.finalized_segments import SegmentEntry
from caesura_service.segmentation.pipeline_interface import PipelineView


def edit_context(
    parts: Sequence[SegmentEntry],
    gaps: Container[int],
    view: PipelineView,
    kinds: Sequence[str],
    *,
    t_first: float,
    finished: bool,
    place_of: Callable[[float], float | None],
    force_limit_n: float | None,
) -> EditContext:
    """Return the changepoints, segments, apps and phases that an operator may correct.

    parts: every segment; gaps: the observations that follow a gap; t_first: time of the first observation
    [s]; place_of: returns where a changepoint that is inserted at a time lies [s].
    """
    spans = [
        VisibleSegment(
            t0=part.segment.t0,
            tn=part.segment.tn,
            start=part.start,
            end=part.end,
            grows=i == len(parts) - 1 and not finished,
        )
        for i, part in enumerate(parts)
    ]
    return EditContext(
        t_first=t_first,
        t_last=view.t,
        finished=finished,
        marks=[_visible(before, part, gaps) for before, part in pairwise(parts)],
        spans=spans,
        kinds=kinds,
        apps=view.apps,
        phases=view.phases,
        place_of=place_of,
        force_limit_n=force_limit_n,
    )


def _visible(before: SegmentEntry, part: SegmentEntry, gaps: Container[int]) -> VisibleChangepoint:
    """Return a changepoint, with the observations between its neighbours."""
    give_way()
    shown = part.changepoint
    return VisibleChangepoint(
        t=shown.t,
        start=part.start,
        t_low=shown.t if shown.t_low is None else shown.t_low,
        t_high=shown.t if shown.t_high is None else shown.t_high,
        between=tuple(index for index in range(before.start + 1, part.end) if index not in gaps),
        after_gap=part.start in gaps,
    )

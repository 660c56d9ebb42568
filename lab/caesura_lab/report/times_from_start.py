"""Converts a report's times to seconds from the session's start, if samples have the time of day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from caesura_lab.report.report_data import ReportData
from caesura_protocol.messages import Changepoint, Gap, Phase, Segment
from caesura_protocol.programs.app_time_shifts import earlier
from caesura_protocol.session_time_display import clock_of
from caesura_service.segmentation.pipeline_interface import PipelineView

Span = TypeVar("Span", Segment, Phase, Gap)


def from_start(content: ReportData) -> ReportData:
    """Return the same data with times from the first segment on; a note states its date.

    Data whose clock is not the time of day is unchanged.
    """
    clock = clock_of(content.view.segments)
    if not clock.start_s:
        return content
    start_s, signals, changes, runs = clock.start_s, content.signals, content.changes, content.run_lengths
    return replace(
        content,
        signals=replace(signals, t=signals.t - start_s),
        changes=replace(changes, t=changes.t - start_s),
        run_lengths=replace(runs, t=runs.t - start_s, start_t=runs.start_t - start_s),
        view=_view(content.view, start_s),
        truth=None if content.truth is None else content.truth.at_times(lambda t: t - start_s),
        notes=(f"{clock.words[0].upper()}{clock.words[1:]}.", *map(clock.text, content.notes)),
    )


def _view(view: PipelineView, start_s: float) -> PipelineView:
    return view._replace(
        t=view.t - start_s,
        changepoints=tuple(_changepoint(one, start_s) for one in view.changepoints),
        segments=_spans(view.segments, start_s),
        phases=_spans(view.phases, start_s),
        gaps=_spans(view.gaps, start_s),
        apps=tuple(earlier(app, start_s) for app in view.apps),
    )


def _spans(spans: Sequence[Span], start_s: float) -> tuple[Span, ...]:
    return tuple(one.model_copy(update={"t0": one.t0 - start_s, "tn": one.tn - start_s}) for one in spans)


def _changepoint(one: Changepoint, start_s: float) -> Changepoint:
    times = {name: getattr(one, name) for name in ("t", "t_low", "t_high")}
    return one.model_copy(update={name: t - start_s for name, t in times.items() if t is not None})

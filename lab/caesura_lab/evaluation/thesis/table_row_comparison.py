"""Measures one row of the thesis on one demonstration, and lists the differences from the thesis.

A boundary is right within `TOLERANCE_S` of the thesis' time, or of its event in the simulated demonstration.
A row is reproduced if it has the same number of segments, every boundary is right, and so is the state of
every segment for which the thesis gives one. There is no minimum time filter: the thesis' tables are from
before its filter, and have segments of 0.4 s. The end of the last segment is the recording's.

An online row is reproduced if every boundary is shown at the end of the demonstration; further boundaries do
not count, because the thesis states only which of its boundaries were found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from time import perf_counter

import numpy as np

from caesura_lab.evaluation.scoring.linear_assignment import best_pairs
from caesura_lab.evaluation.scoring.metrics import ROUNDING_S, TimedEstimate
from caesura_lab.evaluation.thesis.reference_segments import ThesisBoundary, ThesisRow
from caesura_lab.ground_truth import Truth
from caesura_protocol.recording import Recording
from caesura_service.changepoint.hazard import Uniform
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import PRESETS, Preset
from caesura_service.changepoint.segments import verdict
from caesura_service.conditioned_recording import ConditionedRecording, condition
from caesura_service.constants import GRAVITY
from caesura_service.offline_segmentation import views
from caesura_service.signals import ConditioningParameters

TOLERANCE_S = 0.3
SAME_EVENT_S = 0.6  # further from the thesis' time than this an event is another one
STATES = {"free": "1", "contact": "2", "transport": "3"}


@dataclass(frozen=True)
class FoundDivision:
    """A division of a recording: boundaries [s] without its ends, and the state of every segment, 1 2 or 3.

    forces_n: vertical force [N] with which each segment ends; loads_kg: mean weight in it as a mass [kg].
    """

    inner: tuple[float, ...]
    states: str
    forces_n: tuple[float, ...]
    loads_kg: tuple[float, ...]


@dataclass(frozen=True)
class RowOutcome:
    """The outcome of one row of the thesis on one demonstration.

    faults: what differs from the thesis, in words; values: as the row's, where every boundary is right;
    delays_s: for each boundary of an online row, how long after its event it was there for good, None if
    never.
    """

    row: str
    seed: int
    segments: int
    faults: tuple[str, ...]
    values: tuple[float, ...] = ()
    delays_s: tuple[float | None, ...] = ()
    cycle_ms: float | None = None

    @property
    def came_out(self) -> bool:
        """Whether the row is reproduced."""
        return not self.faults


@dataclass(frozen=True, eq=False)
class ConditionedDemonstration:
    """A demonstration with its conditioned signals."""

    recording: Recording
    truth: Truth
    conditioned: ConditionedRecording


def condition_demonstration(
    recording: Recording, truth: Truth, parameters: ConditioningParameters | None = None
) -> ConditionedDemonstration:
    """Condition a demonstration as a session does."""
    return ConditionedDemonstration(recording, truth, condition(recording, parameters))


def measure(
    row: ThesisRow,
    demonstration: ConditionedDemonstration,
    seed: int,
    preset: Preset | None = None,
    *,
    best: bool = False,
    any_length: bool = True,
) -> RowOutcome:
    """Measure one row of the thesis on one demonstration.

    preset: instead of the row's; best: the best segmentation decides, whatever the row's threshold;
    any_length: as for `divide`, whose rows alone it concerns.
    """
    row = replace(row, threshold=None) if best else row
    right = references(row, demonstration)
    if row.online:
        return _online(row, demonstration.recording, seed, right)
    found = divide(demonstration, preset or PRESETS[row.preset], row.threshold, any_length=any_length)
    faults = tuple(differences(row, found, right))
    values: tuple[float, ...] = ()
    if len(found.inner) == len(right) and all(map(is_right, found.inner, right)):
        of = {"force_n": found.forces_n, "load_kg": found.loads_kg}
        values = tuple(of[value.what][value.segment] for value in row.values)
    return RowOutcome(row.name, seed, len(found.states), faults, values)


def references(row: ThesisRow, demonstration: ConditionedDemonstration) -> list[tuple[float, ...]]:
    """Return, for each boundary, the accepted times [s]: the thesis', and that of its event, if any."""
    return [(b.t, *(() if b.also is None else (b.also,)), *_event(b, demonstration)) for b in row.inner]


def _event(boundary: ThesisBoundary, demonstration: ConditionedDemonstration) -> tuple[float, ...]:
    if boundary.event is None:
        return ()
    if isinstance(boundary.event, str):
        times = [point.t for point in demonstration.truth.points if point.kind == boundary.event]
        near = [t for t in times if abs(t - boundary.t) <= SAME_EVENT_S]
        return (min(near, key=lambda t: abs(t - boundary.t)),) if near else ()
    t = demonstration.recording.t
    inside = np.flatnonzero(np.abs(t - boundary.t) <= SAME_EVENT_S)
    distance = np.linalg.norm(demonstration.recording.signals["pos"][inside] - boundary.event, axis=1)
    return (float(t[inside[np.argmin(distance)]]),)


def is_right(t: float, right: Sequence[float]) -> bool:
    """Whether a time [s] is within the tolerance of one of the right times [s]."""
    return any(abs(t - one) <= TOLERANCE_S + ROUNDING_S for one in right)


def differences(row: ThesisRow, found: FoundDivision, right: Sequence[Sequence[float]]) -> Iterator[str]:
    """Yield the differences of a division from the row: boundaries off, missing or extra, other states."""
    if len(found.inner) == len(row.inner):
        for boundary, t, times in zip(row.inner, found.inner, right, strict=True):
            if not is_right(t, times):
                yield f"{boundary.t:.1f} {'early' if t < boundary.t else 'late'}"
        for i, (want, have) in enumerate(zip(row.states, found.states, strict=bool(row.states))):
            if want not in ("?", have):
                yield f"{want} is {have} in segment {i + 1}"
    else:
        yield from _lost_and_extra(row, found.inner, right)


def _lost_and_extra(
    row: ThesisRow, inner: Sequence[float], right: Sequence[Sequence[float]]
) -> Iterator[str]:
    partners = pair_boundaries(inner, right)
    for boundary, partner in zip(row.inner, partners, strict=True):
        if partner is None:
            yield f"no {boundary.t:.1f}"
    edges = [0.0, *(boundary.t for boundary in row.inner), np.inf]
    for a, b in pairwise(edges):
        extra = sum(a <= t < b for i, t in enumerate(inner) if i not in partners)
        if extra:
            yield f"{extra} more after {a:.1f}"


def pair_boundaries(inner: Sequence[float], right: Sequence[Sequence[float]]) -> list[int | None]:
    """Return the index of the found boundary for each of the row's, or None; one to one.

    As many as possible are paired within the tolerance, then the closest.
    """
    distance = np.array([[min(abs(t - one) for one in times) for t in inner] for times in right])
    partners: list[int | None] = [None] * len(right)
    if not inner:
        return partners
    within = distance <= TOLERANCE_S + ROUNDING_S
    gain = np.where(within, 1.0 + len(right) - distance, 0.0)
    for i, j in zip(*best_pairs(gain), strict=True):
        if within[i, j]:
            partners[int(i)] = int(j)
    return partners


def divide(
    demonstration: ConditionedDemonstration,
    preset: Preset,
    threshold: float | None,
    *,
    any_length: bool = True,
) -> FoundDivision:
    """Divide a whole recording at once, thesis 2.1.4, 4.1; without a threshold the best segmentation.

    any_length: a segment is as likely to have any length up to the recording's, (2.9) put right, as the
    thesis asks of what is divided offline; otherwise the preset's prior holds, as online.
    """
    online, rows = demonstration.conditioned.make_filter(preset), demonstration.conditioned.inputs
    hazard = Uniform(len(rows)) if any_length else online.hazard
    offline = segment_offline(online.lattice, hazard, rows)
    path = offline.path if threshold is None else offline.threshold_path(threshold)
    starts = [ended.start for ended in path]
    kinds = [verdict(online.lattice, ended).kind for ended in path]
    joins = int(preset.continuous)
    forces_n = np.array([row.force[2] for row in rows])
    parts = [forces_n[a:b] for a, b in pairwise([*starts, len(rows)])]
    return FoundDivision(
        inner=tuple(demonstration.conditioned.observations[start - joins].t for start in starts[1:]),
        states="".join(STATES[kind.contact] for kind in kinds),
        forces_n=tuple(float(part[-1]) for part in parts),
        loads_kg=tuple(float(-part.mean() / GRAVITY) for part in parts),
    )


def _online(row: ThesisRow, recording: Recording, seed: int, right: Sequence[Sequence[float]]) -> RowOutcome:
    began = perf_counter()
    observations, timed_estimates = _timed_estimates(recording, row)
    cycle_ms = 1e3 * (perf_counter() - began) / observations
    since = present_since(timed_estimates, right)
    delays = tuple(None if t is None else t - times[-1] for t, times in zip(since, right, strict=True))
    faults = tuple(f"no {b.t:.1f}" for b, t in zip(row.inner, since, strict=True) if t is None)
    segments = len(timed_estimates[-1].changepoints) + 1
    return RowOutcome(row.name, seed, segments, faults, delays_s=delays, cycle_ms=cycle_ms)


def _timed_estimates(recording: Recording, row: ThesisRow) -> tuple[int, list[TimedEstimate]]:
    """Return the number of observations, and the changepoints that a session shows after each batch."""
    latest = np.maximum.accumulate(recording.t)
    timed_estimates: list[TimedEstimate] = []
    for view in views(recording, row.preset, threshold=row.threshold):
        times = tuple(one.t for one in view.changepoints)
        if not timed_estimates or timed_estimates[-1].changepoints != times:
            timed_estimates.append(
                TimedEstimate(float(latest[max(view.samples, 1) - 1]), times, (False,) * len(times))
            )
    return view.observations, timed_estimates


def present_since(
    timed_estimates: Sequence[TimedEstimate], right: Sequence[Sequence[float]]
) -> list[float | None]:
    """Return the time [s] since which each boundary is continuously present; None if it is not."""
    since: list[float | None] = [None] * len(right)
    for estimate in timed_estimates:
        for i, partner in enumerate(pair_boundaries(estimate.changepoints, right)):
            since[i] = None if partner is None else estimate.t if since[i] is None else since[i]
    return since

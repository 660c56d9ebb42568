"""Scores one method on one recording: all counts and errors from which tables are made.

Within `EDGE_S` of the window's edges nothing is counted: a true point there is optional, and a changepoint
there is no false alarm. No annotated rest fits into this interval.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from caesura_lab.evaluation.scoring.metrics import (
    ROUNDING_S,
    Labelled,
    Matching,
    TimedEstimate,
    confusion,
    covering,
    match,
    overlap,
    paired_since,
    segments_with_events,
    withdrawn,
)
from caesura_lab.ground_truth import MeasuredQuantity, ScrewStroke, TrueChangepoint, Truth

Vector = tuple[float, float, float]

EDGE_S = 0.3  # the annotators' shortest rest
FOLLOW_S = 0.3  # by which a shown changepoint may move at once and be the same
PHASE_S = 0.5  # how far a boundary between phases may be off
NEAR_S = 1.0  # a changepoint further off has nothing to do with a miss
CARRIED = ("transport", "hold")
TOUCHING = ("contact", "sliding")


@dataclass(frozen=True)
class FoundSegment:
    """A found segment: from t0 to t1 [s]; load_kg [kg], force_n [N], if the method states them.

    probability: stated for the class, None if the method states none. screw: axis and advance in one turn [m]
    of a turning, None where the method states none.
    """

    t0: float
    t1: float
    kind: str
    load_kg: float | None = None
    force_n: float | None = None
    probability: float | None = None
    screw: tuple[Vector, float] | None = None


@dataclass(frozen=True)
class FoundSegmentation:
    """Segmentation of a recording by a method.

    changepoints: (m,) [s]; parts: None if it does not classify; timed_estimates: estimates over time, None if
    the method needs the whole recording; intervals: changepoint → [s] between which it lies with probability
    0.9; probabilities: changepoint → the probability stated for it; phases: (p,) [s] where one phase ends and
    the next begins, None if the method finds none.
    """

    changepoints: tuple[float, ...]
    parts: tuple[FoundSegment, ...] | None = None
    timed_estimates: tuple[TimedEstimate, ...] | None = None
    intervals: Mapping[float, tuple[float, float]] = field(default_factory=dict)
    probabilities: Mapping[float, float] = field(default_factory=dict)
    phases: tuple[float, ...] | None = None


class StatedProbability(NamedTuple):
    """A stated probability with its outcome: `right` out of `of`, in changepoints or seconds."""

    probability: float
    right: float
    of: float


class Hit(NamedTuple):
    """A true point that was found, and the delay of the changepoint after it."""

    kind: str
    offset_s: float


class Miss(NamedTuple):
    """A true point that was not found; offset_s: of the nearest changepoint, None if none is near."""

    kind: str
    between: str
    offset_s: float | None


class FalseAlarm(NamedTuple):
    """A changepoint without a true point: its true class, and the found classes on both sides."""

    within: str
    between: str


@dataclass(frozen=True)
class Score:
    """Counts and errors of one method on one recording."""

    method: str
    recording: str
    hits: int
    false_alarms: int
    misses: int
    covering: float
    cut: tuple[int, int]  # true stretches with a false alarm, and all
    merged: tuple[int, int]  # found stretches with a miss, and all
    confusion: Counter[tuple[str, str]] = field(default_factory=Counter)  # (true, found) → s
    #: The same, further than the tolerance inside of true segments.
    confusion_inside: Counter[tuple[str, str]] = field(default_factory=Counter)
    load_errors_kg: tuple[float, ...] = ()
    loads: int = 0
    force_errors_n: tuple[float, ...] = ()
    forces: int = 0
    provisional_s: tuple[float, ...] = ()
    final_s: tuple[float, ...] = ()
    withdrawn: tuple[int, int] = (0, 0)  # shown changepoints that vanished again, and all that were shown
    intervals: tuple[tuple[float, bool], ...] = ()  # of a hit: length [s], and whether the truth is in it
    missed: tuple[Miss, ...] = ()
    found: tuple[Hit, ...] = ()
    alarms: tuple[FalseAlarm, ...] = ()
    tags: tuple[str, ...] = ()  # what kind of recording it is
    groups: tuple[str, ...] = ()  # robot, if stated, and set
    subject: str = ""  # its person or demonstration, "" if no other recording has the same
    cautions: tuple[str, ...] = ()  # of the recording, and doubts of its units
    slack_s: float = 0.0  # that was added to the points' own tolerances
    excused: int = 0  # changepoints away from the window's edges that find an optional point
    phase_hits: int = 0  # of boundaries between phases, where the truth has phases and the method finds them
    phase_misses: int = 0
    phase_false_alarms: int = 0
    stated_points: tuple[StatedProbability, ...] = ()  # of every changepoint that counts
    stated_classes: tuple[StatedProbability, ...] = ()  # of every segment whose class is scored for some time
    axis_errors_deg: tuple[float, ...] = ()  # of every screw that was noticed, the sense of its turn included
    pitch_errors: tuple[float, ...] = ()  # relative
    screws: int = 0


def score(method: str, truth: Truth, found: FoundSegmentation) -> Score:
    """Compare the segmentation of a method with the truth; return its counts and errors."""
    points = _judged_points(truth)
    times = sorted(found.changepoints)
    matching = match(**_accepted(points)._asdict(), found_s=times)
    pairs = [(points[i], times[j]) for i, j in _pairs(matching)]
    misses = [points[i] for i in matching.misses]
    alarms = [t for t in (times[i] for i in matching.false_alarms) if _is_counted(t, truth.window)]
    missed_s = [p.t for p in misses]
    major_s = [*(p.nearest_s(t) for p, t in pairs), *missed_s]
    counted_s = [*(t for _, t in pairs), *alarms]
    parts = _stretched_to(found.parts or (), truth.window)
    base = Score(
        method=method,
        recording=truth.name,
        hits=len(pairs),
        false_alarms=len(alarms),
        misses=len(misses),
        excused=sum(_is_counted(t, truth.window) for t in _excused(matching, times)),
        covering=covering(major_s, counted_s, truth.window),
        cut=segments_with_events(major_s, alarms, truth.window),
        merged=segments_with_events(counted_s, missed_s, truth.window),
        intervals=_intervals(pairs, found.intervals),
        missed=tuple(_miss(p, alarms, truth) for p in misses),
        found=tuple(Hit(p.kind, t - p.nearest_s(t)) for p, t in pairs),
        alarms=tuple(FalseAlarm(_true_kind(truth, t), _between(parts, t)) for t in alarms),
        stated_points=_stated_points([t for _, t in pairs], alarms, found.probabilities),
    )
    base = _with_phases(base, truth, found.phases)
    base = _with_classes(base, truth, found, parts)
    return _with_delays(base, points, _pairs(matching), times, found.timed_estimates, truth.window)


def _with_phases(base: Score, truth: Truth, found: Sequence[float] | None) -> Score:
    if found is None or not truth.phases:
        return base
    edges = {t for phase in truth.phases for t in (phase.t0, phase.t1)}
    true = sorted(t for t in edges if _is_counted(t, truth.window))
    times = sorted(t for t in found if _is_counted(t, truth.window))
    matching = match(true, [PHASE_S] * len(true), [False] * len(true), times)
    return replace(
        base,
        phase_hits=matching.hits.size,
        phase_misses=matching.misses.size,
        phase_false_alarms=matching.false_alarms.size,
    )


def _is_counted(t: float, window: tuple[float, float]) -> bool:
    """Return whether a time [s] lies far enough inside of the window [s] to be counted."""
    return window[0] + EDGE_S - ROUNDING_S <= t <= window[1] - EDGE_S + ROUNDING_S


def _judged_points(truth: Truth) -> list[TrueChangepoint]:
    """Return the points of the window; those that are too close to its edges to be counted are optional."""
    first, last = truth.window
    inside = [p for p in truth.points if any(first < t < last for t in p.accepted_s)]
    return [
        replace(p, optional=p.optional or not all(_is_counted(t, truth.window) for t in p.accepted_s))
        for p in inside
    ]


class _Accepted(NamedTuple):
    """The arguments of `match` that describe true points, each (p,)."""

    points_s: list[float]
    tolerances_s: list[float]
    optional: list[bool]
    alternatives_s: list[float]


def _accepted(points: Sequence[TrueChangepoint]) -> _Accepted:
    return _Accepted(
        [p.t for p in points],
        [p.tolerance_s for p in points],
        [p.optional for p in points],
        [float("nan") if p.t_alt is None else p.t_alt for p in points],
    )


def class_accuracy(one: Score) -> float:
    """Return the share of the time with a known class that has the right one; nan without such time."""
    total = sum(one.confusion.values())
    right = sum(s for (true, found), s in one.confusion.items() if true == found)
    return right / total if total else float("nan")


def _with_classes(
    base: Score, truth: Truth, found: FoundSegmentation, parts: Sequence[FoundSegment]
) -> Score:
    if found.parts is None:
        return base
    labels = [Labelled(part.t0, part.t1, part.kind) for part in parts]
    base = replace(
        base,
        confusion=confusion(_classified_spans(truth), labels),
        confusion_inside=confusion(_inside_tolerance(truth), labels),
        stated_classes=_stated_classes(_classified_spans(truth), parts),
    )
    if all(part.force_n is None for part in parts):
        return base  # it measures nothing
    screws = _screw_errors(truth.screws, parts)
    return replace(
        base,
        axis_errors_deg=tuple(axis for axis, _ in screws),
        pitch_errors=tuple(pitch for _, pitch in screws),
        screws=len(truth.screws),
        load_errors_kg=_load_errors(truth.loads, parts),
        loads=len(truth.loads),
        force_errors_n=_force_errors(truth.forces, parts),
        forces=len(truth.forces),
    )


def _with_delays(
    base: Score,
    points: Sequence[TrueChangepoint],
    pairs: Sequence[tuple[int, int]],
    times: Sequence[float],
    timed_estimates: Sequence[TimedEstimate] | None,
    window: tuple[float, float],
) -> Score:
    """Return the score with the delays [s] until each found point is found for good, and by a final one.

    It also has the number of shown changepoints that vanished again.
    """
    if timed_estimates is None:
        return base
    accepted = _accepted(points)._asdict()

    def delays(*, final: bool) -> tuple[float, ...]:
        since = paired_since(timed_estimates, **accepted, final=final)
        found = ((since[i], points[i].nearest_s(times[j])) for i, j in pairs)
        return tuple(at - t for at, t in found if at is not None)

    gone, stayed = (
        sum(_is_counted(t, window) for t in some) for some in withdrawn(timed_estimates, FOLLOW_S)
    )
    return replace(
        base,
        provisional_s=delays(final=False),
        final_s=delays(final=True),
        withdrawn=(gone, gone + stayed),
    )


def _intervals(
    pairs: Sequence[tuple[TrueChangepoint, float]], stated: Mapping[float, tuple[float, float]]
) -> tuple[tuple[float, bool], ...]:
    """Return the length [s] of the stated interval of each hit, and whether it contains the true time."""
    return tuple(
        (stated[t][1] - stated[t][0], stated[t][0] <= point.nearest_s(t) <= stated[t][1])
        for point, t in pairs
        if t in stated
    )


def _stated_points(
    hits: Sequence[float], alarms: Sequence[float], stated: Mapping[float, float]
) -> tuple[StatedProbability, ...]:
    """Return the probability of every changepoint that counts, with whether it was right."""
    outcomes = [*((t, 1.0) for t in hits), *((t, 0.0) for t in alarms)]
    return tuple(StatedProbability(stated[t], right, 1.0) for t, right in outcomes if t in stated)


def _stated_classes(
    spans: Sequence[Labelled], parts: Sequence[FoundSegment]
) -> tuple[StatedProbability, ...]:
    """Return the probability of every part's class, with the seconds that were right of those scored."""
    stated = []
    for part in parts:
        shared = [(s.kind == part.kind, overlap(s, part)) for s in spans]
        of = sum(seconds for _, seconds in shared if seconds > 0.0)
        if part.probability is not None and of > ROUNDING_S:
            right = sum(seconds for is_right, seconds in shared if is_right and seconds > 0.0)
            stated.append(StatedProbability(part.probability, right, of))
    return tuple(stated)


def _pairs(matching: Matching) -> list[tuple[int, int]]:
    """Return each found true point with its changepoint."""
    hits = set(matching.hits.tolist())
    return [(i, j) for j, i in enumerate(matching.partner.tolist()) if i in hits]


def _excused(matching: Matching, times: Sequence[float]) -> list[float]:
    """Return the changepoints [s] that are paired with an optional point."""
    return [
        t for t, i in zip(times, matching.partner.tolist(), strict=True) if i >= 0 and matching.optional[i]
    ]


def _stretched_to(parts: Sequence[FoundSegment], window: tuple[float, float]) -> list[FoundSegment]:
    """Return parts extended to the ends of the window, because filters begin a little later."""
    filled = list(parts)
    if filled:
        filled[0] = replace(filled[0], t0=min(filled[0].t0, window[0]))
        filled[-1] = replace(filled[-1], t1=max(filled[-1].t1, window[1]))
    return filled


def _classified_spans(truth: Truth) -> list[Labelled]:
    """Return the spans without the time between the two accepted times of a point."""
    return _without(truth, [(min(p.accepted_s), max(p.accepted_s)) for p in truth.points])


def _inside_tolerance(truth: Truth) -> list[Labelled]:
    """Return the spans without the times within tolerance of a major point, whose class is uncertain."""
    around = [(p, 0.0 if p.optional else p.tolerance_s) for p in truth.points]
    return _without(truth, [(min(p.accepted_s) - s, max(p.accepted_s) + s) for p, s in around])


def _without(truth: Truth, holes: Sequence[tuple[float, float]]) -> list[Labelled]:
    """Return the spans without the holes [s]; a hole of length 0 has no effect."""
    spans = [Labelled(s.t0, s.t1, s.kind) for s in truth.spans]
    for left, right in holes:
        if left < right:
            pieces = ((s._replace(t1=min(s.t1, left)), s._replace(t0=max(s.t0, right))) for s in spans)
            spans = [piece for both in pieces for piece in both if piece.t0 < piece.t1]
    return spans


def _load_errors(loads: Sequence[MeasuredQuantity], parts: Sequence[FoundSegment]) -> tuple[float, ...]:
    """Return the absolute error [kg] of each found load: mean over the carried parts, weighted by time."""
    errors = []
    for load in loads:
        weighed = [
            (part.load_kg, overlap(part, load))
            for part in parts
            if part.kind in CARRIED and part.load_kg is not None and overlap(part, load) > 0.0
        ]
        if weighed:
            mean = sum(kg * s for kg, s in weighed) / sum(s for _, s in weighed)
            errors.append(abs(mean - load.value))
    return tuple(errors)


def _force_errors(forces: Sequence[MeasuredQuantity], parts: Sequence[FoundSegment]) -> tuple[float, ...]:
    """Return the absolute error [N] of each found pressing force: the largest at the end of its parts."""
    errors = []
    for force in forces:
        pressed = [
            part.force_n
            for part in parts
            if part.kind in TOUCHING and part.force_n is not None and overlap(part, force) > 0.0
        ]
        if pressed:
            errors.append(abs(max(pressed) - force.value))
    return tuple(errors)


def _screw_errors(screws: Sequence[ScrewStroke], parts: Sequence[FoundSegment]) -> list[tuple[float, float]]:
    """Return the errors of each found screw: angle [°] of its axis, and relative error of its advance.

    The found screw is the part with a screw motion that has the most time in common with its stroke.
    """
    errors = []
    for true in screws:
        shared = [(overlap(part, true), part.screw) for part in parts if part.screw is not None]
        most, screw = max(shared, key=lambda one: one[0], default=(0.0, None))
        if screw is not None and most > 0.0:
            axis, pitch_m = screw
            errors.append((_degrees_between(axis, true.axis), abs(pitch_m / true.pitch_m - 1.0)))
    return errors


def _degrees_between(one: Sequence[float], other: Sequence[float]) -> float:
    cosine = sum(map(operator.mul, one, other)) / (math.hypot(*one) * math.hypot(*other))
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _miss(point: TrueChangepoint, alarms: Sequence[float], truth: Truth) -> Miss:
    nearest = min((t - point.nearest_s(t) for t in alarms), key=abs, default=None)
    before = _true_kind(truth, point.t - point.tolerance_s)
    after = _true_kind(truth, point.t + point.tolerance_s)
    near = nearest if nearest is not None and abs(nearest) <= NEAR_S else None
    return Miss(point.kind, f"{before} → {after}", near)


def _true_kind(truth: Truth, t: float) -> str:
    return next((span.kind for span in truth.spans if span.t0 <= t < span.t1), "unclear")


def _between(parts: Sequence[FoundSegment], t: float) -> str:
    """Return the classes of the parts that meet closest to t, as text."""
    if len(parts) < 2:
        return "–"
    at = min(range(1, len(parts)), key=lambda i: abs(parts[i].t0 - t))
    return f"{parts[at - 1].kind} → {parts[at].kind}"

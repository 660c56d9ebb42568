"""One method on one recording: all counts and errors from which tables are made."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from caesura_service.judge.metrics import (
    Labelled,
    Look,
    Matching,
    confusion,
    covering,
    disturbed,
    match,
    overlap,
    standing_since,
)
from caesura_service.truth import Point, Quantity, Truth

NEAR_S = 1.0  # a changepoint further off has nothing to do with a miss
CARRIED = ("transport", "hold")
TOUCHING = ("contact", "sliding")


@dataclass(frozen=True)
class Part:
    """A found segment: from t0 to t1 [s]; load_kg [kg] and force_n [N] where the method says so."""

    t0: float
    t1: float
    kind: str
    load_kg: float | None = None
    force_n: float | None = None


@dataclass(frozen=True)
class Found:
    """What a method makes of a recording.

    changepoints: (m,) [s]; parts: None if it does not classify; looks: what was known when, None if the
    method wants the whole recording; intervals: changepoint → [s] between which it lies with probability 0.9.
    """

    changepoints: tuple[float, ...]
    parts: tuple[Part, ...] | None = None
    looks: tuple[Look, ...] | None = None
    intervals: Mapping[float, tuple[float, float]] = field(default_factory=dict)


class Hit(NamedTuple):
    """A true point that was found, and how much later than it is."""

    kind: str
    offset_s: float


class Miss(NamedTuple):
    """A true point that was not found; offset_s: of the nearest changepoint, None if none is near."""

    kind: str
    between: str
    offset_s: float | None


class FalseAlarm(NamedTuple):
    """A changepoint that belongs to nothing: within which true class, between which found ones."""

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
    confusion_inside: Counter[tuple[str, str]] = field(
        default_factory=Counter
    )  # further than tolerance inside
    load_errors_kg: tuple[float, ...] = ()
    loads: int = 0
    force_errors_n: tuple[float, ...] = ()
    forces: int = 0
    provisional_s: tuple[float, ...] = ()
    final_s: tuple[float, ...] = ()
    intervals: tuple[tuple[float, bool], ...] = ()  # of a hit: length [s], and whether the truth is in it
    missed: tuple[Miss, ...] = ()
    found: tuple[Hit, ...] = ()
    alarms: tuple[FalseAlarm, ...] = ()
    tags: tuple[str, ...] = ()  # what kind of recording it is


def score(method: str, truth: Truth, found: Found) -> Score:
    """Judge what a method found."""
    first, last = truth.window
    points = [p for p in truth.points if first < p.t < last]
    times = sorted(t for t in found.changepoints if first < t < last)
    matching = match(
        [p.t for p in points], [p.tolerance_s for p in points], [p.optional for p in points], times
    )
    hits, misses = ([points[i] for i in which] for which in (matching.hits, matching.misses))
    alarms = [times[i] for i in matching.false_alarms]
    major = [p.t for p in points if not p.optional]
    counted = [times[i] for i in matching.counted]
    parts = _filling(found.parts or (), truth.window)
    base = Score(
        method=method,
        recording=truth.name,
        hits=len(hits),
        false_alarms=len(alarms),
        misses=len(misses),
        covering=covering(major, counted, truth.window),
        cut=disturbed(major, alarms, truth.window),
        merged=disturbed(counted, [p.t for p in misses], truth.window),
        intervals=_intervals(points, times, matching, found.intervals),
        missed=tuple(_miss(p, times, matching, truth) for p in misses),
        found=tuple(Hit(points[i].kind, times[j] - points[i].t) for i, j in _pairs(matching)),
        alarms=tuple(FalseAlarm(_true_kind(truth, t), _between(parts, t)) for t in alarms),
    )
    return _with_delays(_with_classes(base, truth, found, parts), hits, found.looks)


def class_accuracy(one: Score) -> float:
    """Share of the time with a known class that has the right one; nan where there is none."""
    total = sum(one.confusion.values())
    right = sum(s for (true, found), s in one.confusion.items() if true == found)
    return right / total if total else float("nan")


def _with_classes(base: Score, truth: Truth, found: Found, parts: Sequence[Part]) -> Score:
    if found.parts is None:
        return base
    labels = [Labelled(part.t0, part.t1, part.kind) for part in parts]
    base = replace(
        base,
        confusion=confusion([Labelled(s.t0, s.t1, s.kind) for s in truth.spans], labels),
        confusion_inside=confusion(_inside(truth), labels),
    )
    if all(part.force_n is None for part in parts):
        return base  # it measures nothing
    return replace(
        base,
        load_errors_kg=_load_errors(truth.loads, parts),
        loads=len(truth.loads),
        force_errors_n=_force_errors(truth.forces, parts),
        forces=len(truth.forces),
    )


def _with_delays(base: Score, hits: Sequence[Point], looks: Sequence[Look] | None) -> Score:
    """How long after each point that was found a changepoint near it stood, and stood for good [s]."""
    if looks is None:
        return base

    def delays(*, final: bool) -> tuple[float, ...]:
        since = [(p.t, standing_since(looks, p.t, p.tolerance_s, final=final)) for p in hits]
        return tuple(at - t for t, at in since if at is not None)

    return replace(base, provisional_s=delays(final=False), final_s=delays(final=True))


def _intervals(
    points: Sequence[Point],
    times: Sequence[float],
    matching: Matching,
    stated: Mapping[float, tuple[float, float]],
) -> tuple[tuple[float, bool], ...]:
    """Length [s] of each interval that a hit was stated with, and whether the true time lies in it."""
    pairs = ((points[i], stated.get(times[j])) for i, j in _pairs(matching))
    return tuple((s[1] - s[0], s[0] <= point.t <= s[1]) for point, s in pairs if s is not None)


def _pairs(matching: Matching) -> list[tuple[int, int]]:
    """Each true point that was found, with its changepoint."""
    hits = set(matching.hits.tolist())
    return [(i, j) for j, i in enumerate(matching.partner.tolist()) if i in hits]


def _filling(parts: Sequence[Part], window: tuple[float, float]) -> list[Part]:
    """Parts that reach from one end of the window to the other: filters need a little before they begin."""
    filled = list(parts)
    if filled:
        filled[0] = replace(filled[0], t0=min(filled[0].t0, window[0]))
        filled[-1] = replace(filled[-1], t1=max(filled[-1].t1, window[1]))
    return filled


def _inside(truth: Truth) -> list[Labelled]:
    """The spans without what lies within tolerance of a major point, where the class itself is uncertain."""
    spans = [Labelled(s.t0, s.t1, s.kind) for s in truth.spans]
    for point in truth.points:
        left, right = point.t - point.tolerance_s, point.t + point.tolerance_s
        pieces = ((s._replace(t1=min(s.t1, left)), s._replace(t0=max(s.t0, right))) for s in spans)
        if not point.optional:
            spans = [piece for both in pieces for piece in both if piece.t0 < piece.t1]
    return spans


def _shared(part: Part, one: Quantity) -> float:
    return overlap(Labelled(part.t0, part.t1, ""), Labelled(one.t0, one.t1, ""))


def _load_errors(loads: Sequence[Quantity], parts: Sequence[Part]) -> tuple[float, ...]:
    """Absolute error [kg] of each load that was weighed: mean over the carried parts, weighted by time."""
    errors = []
    for load in loads:
        weighed = [
            (part.load_kg, _shared(part, load))
            for part in parts
            if part.kind in CARRIED and part.load_kg is not None and _shared(part, load) > 0.0
        ]
        if weighed:
            mean = sum(kg * s for kg, s in weighed) / sum(s for _, s in weighed)
            errors.append(abs(mean - load.value))
    return tuple(errors)


def _force_errors(forces: Sequence[Quantity], parts: Sequence[Part]) -> tuple[float, ...]:
    """Absolute error [N] of each pressing force that was noticed: the largest that its parts end with."""
    errors = []
    for force in forces:
        pressed = [
            part.force_n
            for part in parts
            if part.kind in TOUCHING and part.force_n is not None and _shared(part, force) > 0.0
        ]
        if pressed:
            errors.append(abs(max(pressed) - force.value))
    return tuple(errors)


def _miss(point: Point, times: Sequence[float], matching: Matching, truth: Truth) -> Miss:
    free = [times[i] - point.t for i in matching.false_alarms]
    nearest = min(free, key=abs, default=None)
    before = _true_kind(truth, point.t - point.tolerance_s)
    after = _true_kind(truth, point.t + point.tolerance_s)
    near = nearest if nearest is not None and abs(nearest) <= NEAR_S else None
    return Miss(point.kind, f"{before} → {after}", near)


def _true_kind(truth: Truth, t: float) -> str:
    return next((span.kind for span in truth.spans if span.t0 <= t < span.t1), "unclear")


def _between(parts: Sequence[Part], t: float) -> str:
    """The classes of the parts that meet closest to t."""
    if len(parts) < 2:
        return "–"
    at = min(range(1, len(parts)), key=lambda i: abs(parts[i].t0 - t))
    return f"{parts[at - 1].kind} → {parts[at].kind}"

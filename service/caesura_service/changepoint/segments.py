"""Segments from a filter: their starts, kinds and probabilities."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from types import MappingProxyType

from caesura_service.changepoint.constant_models import HoldingStates
from caesura_service.changepoint.evidence_window import NOTHING, PathSegment, outline_of
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.probability_threshold_segmenter import ThresholdSegmenter
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.smoothed_probabilities import INTERVAL_REACH

INTERVAL_PROBABILITY = 0.9
PLACE_STEPS = 0.9  # by which a boundary may lie from the middle between two observations (`boundary_time`)
TURNING = "turning"
MOST_ODDS = 700.0  # log, against a kind: the exponential of more is infinite


IsTurn = Callable[[], bool]


@dataclass(frozen=True, slots=True)
class Classification:
    """The kind of a segment, given its start and end, with its probability."""

    kind: SegmentKind
    probability: float
    runner_up: SegmentKind | None  # None where the lattice has a single kind
    log_odds: float  # of the kind over the runner-up; 0 without one


@dataclass(frozen=True, slots=True)
class InferredSegment:
    """Observations start to end, the end not included, as one segment."""

    start: int
    end: int
    verdict: Classification
    start_probability: float  # that a segment starts here or at a neighbouring observation
    start_interval: tuple[float, float]  # in observations, in which it starts with INTERVAL_PROBABILITY
    start_final: bool
    end_final: bool
    start_stands: bool = False  # nothing that is said of its start can change any more

    @property
    def stands(self) -> bool:
        """Whether later observations can no longer change any figure of this segment."""
        return self.start_stands and self.end_final


def verdict(
    lattice: SegmentModelSet,
    ended: PathSegment,
    is_turn: IsTurn | None = None,
    states: HoldingStates | None = None,
) -> Classification:
    """Return the best kind in the group that the best segmentation has, and the probability of its name.

    It is conditional on the segment's start and end, and on the group of the segment before: a kind that may
    not follow that group has probability 0, unless the best segmentation repeats it, as it may after a gap.

    is_turn: whether a movement is a turn in place. Such a movement is named a turning, and its probability is
    that of the movement and of the turning together. states: the gripper's in the segment; None where none is
    known.
    """
    kinds, values = lattice.kinds, lattice.weigh(ended.kind_log_evidence, states)
    if ended.before not in (NOTHING, ended.group):
        values = values + lattice.log_transition[ended.before][lattice.groups]
    values, best = values.tolist(), lattice.best_kind(ended.kind_log_evidence, ended.group)
    possible = [kind for kind, value in enumerate(values) if kind != best and value > -math.inf]
    possible.sort(key=values.__getitem__, reverse=True)
    odds = [math.exp(min(values[kind] - values[best], MOST_ODDS)) for kind in possible]
    shown = _shown(lattice, ended, best, is_turn)
    alike = [kinds[kind].name in (kinds[best].name, shown.name) for kind in possible]
    others = [kind for kind, same in zip(possible, alike, strict=True) if not same]
    in_favour = 1.0 + sum([value for value, same in zip(odds, alike, strict=True) if same])
    odds_against = sum([value for value, same in zip(odds, alike, strict=True) if not same])
    probability = in_favour / (in_favour + odds_against)
    if not others:
        return Classification(shown, probability, None, 0.0)
    second = others[0]
    return Classification(shown, probability, kinds[second], values[best] - values[second])


def _shown(lattice: SegmentModelSet, ended: PathSegment, best: int, is_turn: IsTurn | None) -> SegmentKind:
    """Return the kind that a segment is given: the best one, or turning in place for a movement."""
    kind = lattice.kinds[best]
    if is_turn is None or kind.motion != "motion" or kind.name == TURNING:
        return kind
    turns = [
        number
        for number, other in enumerate(lattice.kinds)
        if other.name == TURNING and other.contact == kind.contact
    ]
    if not turns or not is_turn():
        return kind
    return lattice.kinds[max(turns, key=ended.kind_log_evidence.tolist().__getitem__)]


def outline(
    online: ChangepointFilter, decided: ThresholdSegmenter | None = None
) -> tuple[int, list[tuple[int, int]]]:
    """Return the number of final segments, and (start, number of the kind) of each segment after them.

    decided: the threshold segmenter to take the segments from; None takes the best segmentation.
    """
    if decided is None:
        return len(online.final), online.outline()
    return len(decided.final), outline_of(online.lattice, decided.path())


def stretches(
    online: ChangepointFilter,
    first: int = 0,
    *,
    decided: ThresholdSegmenter | None = None,
    known: Mapping[int, InferredSegment] = MappingProxyType({}),
    is_turn: Callable[[int, int], bool] | None = None,
    states: Callable[[int, int], HoldingStates | None] = lambda start, end: None,
) -> list[InferredSegment]:
    """Return the segments of the best segmentation from the final segment number `first` on, or those of
    `decided`.

    known: segments of an earlier call, by their start; those that can no longer change are reused. is_turn:
    whether the movement from one observation to another, the last not included, is a turn in place. states:
    the known states of the gripper between two observations, None where none is known.
    """
    final, growing = _ended(online, decided)
    settled, path = len(final), [*final[first:], *growing]
    before = final[first - 1].start if first else -1
    starts = [before, *(ended.start for ended in path), online.count]
    found: list[InferredSegment] = []
    for i, ended in enumerate(path):
        stretch = known.get(ended.start)
        if stretch is None or not stretch.stands:
            around = starts[i], starts[i + 1], starts[i + 2]
            turns = None if is_turn is None else partial(is_turn, *around[1:])
            found_kind = verdict(online.lattice, ended, turns, states(*around[1:]))
            stretch = _stretch(online, found_kind, around, first + i, settled, stretch)
        found.append(stretch)
    return found


def _ended(
    online: ChangepointFilter, decided: ThresholdSegmenter | None
) -> tuple[Sequence[PathSegment], Sequence[PathSegment]]:
    """Return the final segments, and those after them."""
    return (online.final, online.map_path()) if decided is None else (decided.final, decided.path())


def _stretch(
    online: ChangepointFilter,
    found: Classification,
    starts: tuple[int, int, int],
    number: int,
    settled: int,
    known: InferredSegment | None,
) -> InferredSegment:
    """Return the inferred segment with this number, of which the first `settled` are final.

    starts: of the segment before, of this one, and of the one after; known: the segment as inferred before.
    """
    before, start, after = starts
    is_over = number < settled
    if known is not None and known.start_stands and min(known.end, after) > start + INTERVAL_REACH:
        return replace(known, end=after, verdict=found, end_final=is_over)
    return InferredSegment(
        start=start,
        end=after,
        verdict=found,
        start_probability=online.event_probability(start, others=(before, after)),
        start_interval=_interval(online, before, start, after),
        start_final=number <= settled,
        end_final=is_over,
        start_stands=number <= settled and online.stands(start),
    )


def _interval(online: ChangepointFilter, before: int, start: int, after: int) -> tuple[float, float]:
    """Return the ends of the central interval of a start, among observations that may be the same event."""
    if start == 0:
        return 0.0, 0.0
    first, last = max(start - INTERVAL_REACH, before + 1, 1), min(start + INTERVAL_REACH, after - 1)
    mass = [*online.changepoint_probabilities(first, last, about=start)]
    if not any(mass):
        return float(start), float(start)
    tail = 0.5 * (1.0 - INTERVAL_PROBABILITY)
    low, high = (first + interpolated_quantile(mass, share) for share in (tail, 1.0 - tail))
    return max(min(low, start), 0.0), min(max(high, start), online.count - 1.0)


def interpolated_quantile(mass: Iterable[float], share: float) -> float:
    """Return the place at which the cumulative mass reaches a share of the total.

    mass: of the places 0, 1, …, each spread evenly within `PLACE_STEPS` around its place; at least one is
    above 0.
    """
    known = (0.0, *mass, 0.0)
    left, alone = 2.0 * PLACE_STEPS * share * sum(known), 1.0 - PLACE_STEPS
    for middle, (before, here) in enumerate(pairwise(known)):
        # Between two middles both masses lie, and around a middle its own alone.
        for end, width, density in (
            (middle - alone, PLACE_STEPS - alone, before + here),
            (middle + alone, 2.0 * alone, here),
        ):
            if density and left <= width * density:
                return end - width + left / density
            left -= width * density
    return len(known) - 3.0 + PLACE_STEPS

"""Tracks the phases of a live demonstration: final ones are stored, the others regrouped at each update.

Settled segments are processed one at a time, so the phases do not depend on when they are read. After each
settled segment, states with a probability below `posterior.ALIVE` are dropped. A phase is final once all
remaining states agree on it; no later segment changes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from caesura_protocol.messages import Certainty, Phase, PhaseKind, Segment
from caesura_service.phases.model import Array, Chain, SegmentFeatures, seen
from caesura_service.phases.posterior import (
    ForwardStep,
    best_last,
    best_states,
    decided,
    first_step,
    next_step,
    posterior,
    settled,
)
from caesura_service.phases.retraced_path import NO_WAY, Way, way_of

PlacesBetween = Callable[[float, float], Array]

WAY_S = 60.0  # of a segment, its end, whose way is grouped at


class _PhaseRun(NamedTuple):
    """Consecutive segments, first to last, of one phase. aside: whether the last one is an interruption."""

    kind: PhaseKind
    probability: float
    t0: float
    tn: float
    first: int
    last: int
    strokes: int = 1
    aside: bool = False


class _CachedStep(NamedTuple):
    """A segment with its forward step, for reuse while the segment is unchanged."""

    segment: Segment
    seen: SegmentFeatures
    step: ForwardStep


class PhaseTracker:
    """Groups the segments of one demonstration.

    places_between: returns the positions (n, 3) [m] between two times [s].
    """

    def __init__(self, chain: Chain, places_between: PlacesBetween) -> None:
        self._chain, self._places_between = chain, places_between
        self._first = 0  # the segment of the first step that is kept
        self._settled = 0  # segments that have settled
        self._kept: list[_CachedStep] = []  # settled segments from `_first` on
        self._before: list[SegmentFeatures] = []  # up to `memory` segments before them
        self._open: _PhaseRun | None = None  # the phase of segment `_first` before it, where it began earlier
        self._unsettled: list[_CachedStep] = []  # segments that had not settled at the last call
        self._decided: list[Phase] = []  # since the last call of `update`

    @property
    def settled(self) -> int:
        """The number of settled segments; the next `update` begins with this one."""
        return self._settled

    def update(self, segments: Sequence[Segment], *, finished: bool) -> tuple[list[Phase], list[Phase]]:
        """Group the segments from number `settled` on, which may still change, with those before them.

        finished: the demonstration is over. Returns the phases that have been decided since the last call,
        and those after them.
        """
        grouped = self._follow(segments, finished=finished)
        newly, self._decided = self._decided, []
        shown = [*self._kept, *grouped]
        if not shown:
            return newly, []
        steps = [one.step for one in shown]
        states = best_states(steps, best_last(self._chain, steps[-1], ended=finished))
        groups = self._groups(shown, states, posterior(self._chain, steps, ended=finished))
        return newly, [_phase(group, "final" if finished else "provisional") for group in groups]

    def settle(self, segment: Segment) -> None:
        """Process segment number `settled`, which can no longer change."""
        self._unsettled = []
        one = self._step(segment, self._kept, grows=False)
        self._kept.append(one._replace(step=settled(one.step)))
        self._settled += 1
        index, state = decided([kept.step for kept in self._kept])
        if index > 0:
            self._decide(index, state)

    def _decide(self, index: int, state: int) -> None:
        """Store the phases before a segment, by its number among the kept ones, from its state's best
        path.
        """
        steps = [one.step for one in self._kept]
        states = best_states(steps[: index + 1], state)
        sure = posterior(self._chain, steps, ended=False)
        groups = self._groups(self._kept[:index], states[:index], sure)
        self._open = None if self._chain.age[state] == 1 else groups.pop()
        self._decided += [_phase(group, "final") for group in groups]
        self._before = [*self._before, *(one.seen for one in self._kept[:index])]
        self._before = self._before[-self._chain.parameters.memory :]
        self._kept, self._first = self._kept[index:], self._first + index

    def _follow(self, segments: Sequence[Segment], *, finished: bool) -> list[_CachedStep]:
        """Return the forward steps of the unsettled segments; unchanged segments keep their steps."""
        grouped: list[_CachedStep] = []
        for segment in segments:
            grows = segment is segments[-1] and not finished
            known = self._unsettled[len(grouped)] if len(grouped) < len(self._unsettled) else None
            if known is None or known.segment is not segment or known.seen.grows != grows:
                self._unsettled = []
                known = self._step(segment, [*self._kept, *grouped], grows=grows)
            grouped.append(known)
        self._unsettled = grouped
        return grouped

    def _step(self, segment: Segment, before: Sequence[_CachedStep], *, grows: bool) -> _CachedStep:
        parameters = self._chain.parameters
        earlier = [*self._before, *(one.seen for one in before)][-parameters.memory :]
        shown = seen(segment, parameters, self._way_of(segment), earlier, grows=grows)
        if not before:
            return _CachedStep(segment, shown, first_step(self._chain, shown))
        return _CachedStep(segment, shown, next_step(self._chain, before[-1].step, shown, earlier))

    def _way_of(self, segment: Segment) -> Way:
        if segment.motion != "motion":
            return NO_WAY
        return way_of(self._places_between(max(segment.t0, segment.tn - WAY_S), segment.tn))

    def _groups(
        self, grouped: Sequence[_CachedStep], states: Sequence[int], sure: Sequence[Array]
    ) -> list[_PhaseRun]:
        """Return the phases on a path of states; sure: (states,) state probabilities at each segment."""
        chain, groups = self._chain, [] if self._open is None else [self._open]
        for number, (one, state) in enumerate(zip(grouped, states, strict=True), start=self._first):
            aside, segment = bool(chain.aside[state]), one.segment
            if chain.age[state] == 1:
                kind = chain.parameters.kinds[chain.kind[state]].name
                probability = min(float(sure[number - self._first] @ chain.starts(kind)), 1.0)
                groups.append(_PhaseRun(kind, probability, segment.t0, segment.tn, number, number))
            else:
                last = groups[-1]
                strokes = last.strokes + (last.aside and not aside)
                groups[-1] = last._replace(tn=segment.tn, last=number, strokes=strokes, aside=aside)
        return groups


def _phase(group: _PhaseRun, certainty: Certainty) -> Phase:
    return Phase(
        t0=group.t0,
        tn=group.tn,
        kind=group.kind,
        probability=group.probability,
        certainty=certainty,
        first_segment=group.first,
        last_segment=group.last,
        strokes=group.strokes,
    )

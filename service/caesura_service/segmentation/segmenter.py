"""The segmenter of a session: the filter, and the segments and changepoints that it shows.

Settled segments are stored, and unchanged ones are reused.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

from caesura_protocol.messages import Changepoint, ScrewMotion, Segment, Vector
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.preset import STEP_S, Preset
from caesura_service.changepoint.probability_threshold_segmenter import ThresholdSegmenter
from caesura_service.changepoint.segment_model_set import SegmentKind
from caesura_service.changepoint.segments import Classification, InferredSegment, outline, stretches
from caesura_service.changepoint.turn_in_place import centre_of
from caesura_service.constants import GRID_HZ, TARED_BIAS_N
from caesura_service.cooperative_scheduler import give_way
from caesura_service.segmentation.corrections import FilterConstraints
from caesura_service.segmentation.finalized_segments import FinalizedSegments, SegmentEntry
from caesura_service.segmentation.observation_store import ObservationStore
from caesura_service.segmentation.payload_estimation import Load, is_baseline, weigh
from caesura_service.segmentation.screw_motion_fit import screw_of
from caesura_service.segmentation.turn_in_place_check import is_turn_in_place
from caesura_service.signals import WrenchCapabilities
from caesura_service.signals.tare import UNTARED_BIAS_N


class _Seen(NamedTuple):
    """A segment and its start in the last view, and the data from which they were made."""

    stretch: InferredSegment
    load: Load | None
    segment: Segment
    changepoint: Changepoint


def filter_of(
    preset: Preset, source: WrenchCapabilities, *, tared: bool, orientation: bool, torque: bool = False
) -> ChangepointFilter:
    """Return a filter for the signals that a session reports: its wrench, and perhaps an orientation.

    torque: whether there is one; it is used if it is tared and the wrench is not an estimate. Raises
    ValueError if the preset uses no reported signal.
    """
    return preset.online(
        contact=source.contact_models,
        transport=source.transport_models,
        orientation=orientation,
        torque=torque and tared and source.bias == "tare",
        bias_n=_bias_n(source, tared=tared),
    )


class Segmenter:
    """Filters the observations of a history one by one, with the corrections of each."""

    def __init__(
        self,
        preset: Preset,
        source: WrenchCapabilities,
        history: ObservationStore,
        heeded: FilterConstraints,
        *,
        tared: bool,
        orientation: bool,
        torque: bool = False,
    ) -> None:
        """Raise ValueError if the preset uses no reported signal."""
        self.tared, self._orientation = tared, orientation
        self.online = filter_of(preset, source, tared=tared, orientation=orientation, torque=torque)
        self.settled = FinalizedSegments()
        # [s] Where a segment begins whose first own observation is this one: midway from the one before, as
        # the posterior has it, and where the speed has it, as it is shown.
        self.places, self._starts_t = array("d"), array("d")
        self._preset, self._history, self._heeded = preset, history, heeded
        self._bias_n = _bias_n(source, tared=tared)
        self._decided = (
            None if preset.threshold is None else ThresholdSegmenter(self.online, preset.threshold)
        )
        self._baseline: list[InferredSegment] = []  # the last free space that has settled
        self._seen: dict[int, _Seen] = {}  # of what has not settled, by its first observation
        self._finished = False
        self._final = 0  # segments that were final at the last look

    @property
    def unlooked(self) -> int:
        """The number of segments that have become final since the last `look`."""
        return len((self._decided or self.online).final) - self._final

    def step(self, index: int) -> None:
        """Filter an observation, with its corrections.

        With a continuous preset, a segment without a gap before it begins between two observations. Its start
        is shown midway, until the next observation determines its place.
        """
        history, after_gap = self._history, self._history.after_gap(index)
        joins = index and self._preset.continuous and not after_gap
        place = 0.5 * (history.t(index - 1) + history.t(index)) if joins else history.t(index)
        self._place_before(index)
        self.places.append(place)
        self._starts_t.append(place)
        said = self._heeded.start(index, place + 0.5 * STEP_S)
        follower = self._decided or self.online
        follower.step(history.observed(index), boundary=after_gap, changepoint=said)

    def _place_before(self, index: int) -> None:
        """Move the start at the observation before this one to the place found from the speed.

        A start that an operator has set stays.
        """
        place = self._history.boundary_before(index)
        if place is None or not self._preset.continuous or self._heeded.is_placed(index - 1):
            return
        self._starts_t[index - 1] = max(place, self._starts_t[index - 2] + 1.0 / GRID_HZ)

    def start_t(self, index: int) -> float:
        """Return the shown start [s] of a segment whose first own observation is this one."""
        return self._starts_t[index]

    def place_of(self, t: float) -> float | None:
        """Return the place [s] of a changepoint that is inserted at a time [s].

        None if the time is ahead of the observations.
        """
        index = max(1, bisect_right(self.places, t, key=lambda place: place + 0.5 * STEP_S))
        return self.places[index] if index < len(self.places) else None

    def outline(self) -> tuple[int, list[tuple[int, int]]]:
        """Return the number of final segments, and the start and kind number of every other segment.

        The check for turns in place is not applied: its result is fixed once the segment has ended, and
        before that changes only with its end.
        """
        return outline(self.online, self._decided) if self.online.count else (0, [])

    def look(self, quiet: int, *, finished: bool) -> list[SegmentEntry]:
        """Return every part that has not settled, and store those that have.

        quiet: the number of the first part that a later program may read; finished: whether the demonstration
        has ended, so that everything is decided.
        """
        self._finished = finished
        if not self.online.count:
            return []
        self._final += self.unlooked
        known = {start: seen.stretch for start, seen in self._seen.items()}
        named = self._is_turn if self._orientation and self._preset.turn_share else None
        found = stretches(
            self.online,
            len(self.settled),
            decided=self._decided,
            known=known,
            is_turn=named,
            states=self._history.holding_states,
        )
        fresh = [self._as_said(stretch) for stretch in found]
        every, first = [*self._baseline, *fresh], len(self._baseline)
        seen: list[_Seen] = []
        for i in range(len(fresh)):
            seen.append(self._look_at(every, first + i))
            give_way()
        self._seen = {one.stretch.start: one for one in seen}
        parts = [
            SegmentEntry(one.stretch.start, one.stretch.end, one.segment, one.changepoint) for one in seen
        ]
        count = self._settling(fresh)
        self.settled.add(parts[:count], quiet)
        free = (one for one in reversed(fresh[:count]) if is_baseline(one, self._history, self._bias_n))
        self._baseline = [*islice(free, 1)] or self._baseline
        return parts[count:]

    def _is_turn(self, start: int, end: int) -> bool:
        """Whether the movement from an observation to another, the last not included, is a turn in place."""
        begin, last = start - self._joins(start), end - 1
        duration_s = self._history.t(last) - self._history.t(begin)
        return is_turn_in_place(self._history.course(begin, last), duration_s, self._preset.turn_share)

    def _as_said(self, stretch: InferredSegment) -> InferredSegment:
        """Return the segment with its corrections: a start and a kind set by an operator have probability
        1.
        """
        if self._heeded.is_certain(start := stretch.start):
            stretch = replace(stretch, start_probability=1.0, start_interval=(float(start), float(start)))
        label = self._heeded.label(start, stretch.end)
        if label is None:
            return stretch
        named = [kind for kind in self.online.lattice.kinds if kind.name == label]
        kind = max(named, key=lambda kind: kind.contact == stretch.verdict.kind.contact)
        return replace(stretch, verdict=Classification(kind, 1.0, None, 0.0))

    def _settling(self, fresh: list[InferredSegment]) -> int:
        """Return the number of segments at the beginning that have settled.

        Nothing can change these, not even a later comparison of their load.
        """
        count, weighing = 0, False
        for i, stretch in enumerate(fresh):
            if not stretch.stands or self._awaits_place(stretch.end):
                break
            weighing = weighing or stretch.verdict.kind.contact == "transport"
            compared = is_baseline(stretch, self._history, self._bias_n)
            if compared or (not weighing and count == i):
                count, weighing = i + 1, False
        return count

    def _awaits_place(self, end: int) -> bool:
        """Return whether the next observation may still move an end.

        An end set by a correction is certain.
        """
        is_newest = end == self.online.count - 1
        return is_newest and self._preset.continuous and end not in self.online.boundaries

    def _look_at(self, all_stretches: list[InferredSegment], index: int) -> _Seen:
        """Return the segment and changepoint of a stretch, reused from the last look where unchanged."""
        stretch = all_stretches[index]
        load = weigh(all_stretches, index, self._history, self._bias_n)
        seen = self._seen.get(stretch.start)
        if seen is None or self._finished:
            return _Seen(stretch, load, self._segment(stretch, load), self._changepoint(stretch))
        stays, start_stays = self._stays(seen, stretch, load), self._start_stays(seen, stretch)
        segment = seen.segment if stays else self._segment(stretch, load)
        changepoint = seen.changepoint if start_stays else self._changepoint(stretch)
        return _Seen(stretch, load, segment, changepoint)

    def _stays(self, seen: _Seen, stretch: InferredSegment, load: Load | None) -> bool:
        """Whether a stretch and its load make the same segment as the one shown before."""
        before = seen.stretch
        return (
            (before.end, before.end_final, before.verdict)
            == (stretch.end, stretch.end_final, stretch.verdict)
            and (seen.segment.t0, seen.segment.tn) == (self._starts_t[stretch.start], self._end(stretch.end))
            and seen.load == load
        )

    def _start_stays(self, seen: _Seen, stretch: InferredSegment) -> bool:
        """Whether a stretch makes the same changepoint as the one shown before."""
        before, shown = seen.stretch, seen.changepoint
        known = before.start_probability, before.start_interval, before.start_final
        now = stretch.start_probability, stretch.start_interval, stretch.start_final
        return known == now and (shown.t, shown.t_low, shown.t_high) == self._start_times(stretch)

    def _start_times(self, stretch: InferredSegment) -> tuple[float, float, float]:
        """Return the start [s] of a segment and the interval [s] that holds it with probability 0.9."""
        t, (low, high) = self._starts_t[stretch.start], stretch.start_interval
        return t, min(t, self._place_at(low)), max(t, self._place_at(high))

    def _place_at(self, index: float) -> float:
        """Return the position in time [s] of a fractional observation, interpolated between two of them."""
        whole = int(index)
        here = self.places[whole]
        return here if whole == index else here + (index - whole) * (self.places[whole + 1] - here)

    def _segment(self, stretch: InferredSegment, load: Load | None) -> Segment:
        found, history = stretch.verdict, self._history
        t0, tn = self._starts_t[stretch.start], self._end(stretch.end)
        begin, last = self._ends(stretch, t0, tn)
        turn, centre = self._turn(begin, last, found.kind.name)
        return Segment(
            t0=t0,
            tn=tn,
            kind=found.kind.name,
            motion=found.kind.motion,
            contact=found.kind.contact,
            probability=found.probability,
            runner_up=None if found.runner_up is None else found.runner_up.name,
            log_odds=found.log_odds,
            certainty="final" if stretch.end_final or self._finished else "provisional",
            position_start=history.position(begin),
            position_end=history.position(last),
            force_start=history.force(begin),
            force_end=history.force(last),
            force_held=history.press(stretch.start, stretch.end) if found.kind.contact == "contact" else None,
            load_kg=None if load is None else load.kg,
            load_sd_kg=None if load is None else load.sd_kg,
            corrected=self._heeded.label(stretch.start, stretch.end) is not None,
            turn=turn,
            centre=centre,
            screw=self._screw(begin, last, found.kind),
        )

    def _ends(self, stretch: InferredSegment, t0: float, tn: float) -> tuple[int, int]:
        """Return the first and last observation of a segment from t0 to tn [s], as its path has them."""
        own = stretch.start - self._joins(stretch.start), stretch.end - 1
        if not self._preset.continuous:
            return own
        begin, last = self._history.nearest(t0), self._history.nearest(tn)
        return (begin, last) if begin < last else own

    def _turn(self, begin: int, last: int, kind: str) -> tuple[Vector | None, Vector | None]:
        """Return the turn (3,) [rad] from one observation to another, and a point [m] of its axis.

        The point is None for another kind than `turning`; both are None without an orientation.
        """
        if not self._orientation:
            return None, None
        turned = self._history.turned(begin, last)
        if kind != "turning":
            return turned, None
        middle = (begin + last) // 2
        places = [self._history.position(index) for index in (begin, middle, last)]
        return turned, centre_of(places, [self._history.turned(begin, index) for index in (middle, last)])

    def _screw(self, begin: int, last: int, kind: SegmentKind) -> ScrewMotion | None:
        if kind.name != "turning" or not self._orientation:
            return None
        return screw_of(self._history.course(begin, last), pressed=kind.contact == "contact")

    def _joins(self, start: int) -> bool:
        """Whether a segment with its first own observation at `start` begins where the one before it ends."""
        return self._preset.continuous and start > 0 and start not in self.online.boundaries

    def _end(self, end: int) -> float:
        """Return the end [s] of a segment; end: the observation after its last one."""
        missing = end == self.online.count or end in self.online.boundaries
        return self._history.t(end - 1) if missing else self._starts_t[end]

    def _changepoint(self, stretch: InferredSegment) -> Changepoint:
        final = stretch.start_final or self._finished
        t, t_low, t_high = self._start_times(stretch)
        return Changepoint(
            t=t,
            probability=stretch.start_probability,
            certainty="final" if final else "provisional",
            t_low=t_low,
            t_high=t_high,
            corrected=self._heeded.is_certain(stretch.start),
        )


def _bias_n(source: WrenchCapabilities, *, tared: bool) -> float:
    """Return the scale [N] of the force in free space; a tracked bias is scaled to that of a tared sensor."""
    return TARED_BIAS_N if tared or source.bias == "mixture" else UNTARED_BIAS_N

"""The mathematics behind a session: sample → observation → evidence → posterior → segment → app."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from itertools import islice, pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, Changepoint, Gap, Open, Segment, WrenchReport
from caesura_service.changepoint.filter import Filter
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.preset import STEP_S, TARED_BIAS_N, UNTARED_BIAS_N, Preset
from caesura_service.changepoint.presets import PRESETS, preset_named
from caesura_service.changepoint.segments import Stretch, Verdict, stretches
from caesura_service.changepoint.threshold import OnlineThreshold, check_level
from caesura_service.program import Gaps, Grip, Step, with_force_limit
from caesura_service.robot import load_panda
from caesura_service.session.corrections import (
    Change,
    Correction,
    Heeded,
    Mark,
    Shown,
    Span,
    resolved,
)
from caesura_service.session.growing import GrowingProgram
from caesura_service.session.history import History, holding
from caesura_service.session.settled import Part, Settled
from caesura_service.session.view import Pipeline, View
from caesura_service.session.weighing import Load, is_baseline, weigh
from caesura_service.signals import (
    WRENCH_SOURCES,
    Conditioned,
    Conditioner,
    Layout,
    Observation,
    WrenchSource,
)

METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001}
PROGRAM_EVERY = 5  # observations, while nothing happens but that the last segment goes on


def make_pipeline(opening: Open, default_preset: str, *, threshold: float | None = None) -> Pipeline:
    """The pipeline of a session. Raises ProtocolError `malformed` for a preset or columns that fail.

    threshold: on the smoothed probability, decides what is a changepoint instead of the best segmentation.
    Raises ValueError for one that is not between 0 and 1.
    """
    name = opening.preset or default_preset
    try:
        preset = preset_named(name)
    except KeyError as error:
        raise ProtocolError("malformed", "unknown preset", value=name, expected=sorted(PRESETS)) from error
    if threshold is not None:
        check_level(threshold)
        unconditioned = replace(preset.filter, certain=1.0)
        preset = replace(preset, threshold=threshold, filter=unconditioned)
    try:
        return SegmentationPipeline(layout_of(opening), preset, opening)
    except ValueError as error:
        raise ProtocolError("malformed", str(error), value=list(opening.columns)) from error


def layout_of(opening: Open) -> Layout:
    """How the samples of a session are read. Raises ValueError for columns that cannot be segmented."""
    robot = load_panda() if "q1" in opening.columns else None
    return Layout(
        columns=opening.columns,
        wrench_source=opening.wrench_source,
        force_frame=opening.force_frame,
        metres_per_unit=METRES_PER_UNIT[opening.length_unit],
        pose_of_joints=None if robot is None else robot.flange_poses,
        wrench_of_joint_torques=None if robot is None else robot.wrenches_of_joint_torques,
    )


def filter_of(preset: Preset, source: WrenchSource, *, tared: bool) -> Filter:
    """A filter for what the wrench can carry. Raises ValueError where the preset looks at nothing else."""
    return preset.online(
        contact=source.contact_models,
        transport=source.transport_models,
        bias_n=TARED_BIAS_N if tared else UNTARED_BIAS_N,
    )


def observed(observation: Observation) -> Observed:
    """What the segment models see of an observation."""
    return Observed(observation.position_base, observation.force_base, holding(observation))


class _Seen(NamedTuple):
    """A segment and its start as they were shown, and what they were made of."""

    stretch: Stretch
    load: Load | None
    segment: Segment
    changepoint: Changepoint


class _Built(NamedTuple):
    """A program, and what it was made of: of how many observations, and what had happened until then."""

    observations: int
    happened: tuple[object, ...]
    apps: Sequence[App]


_NEVER = _Built(0, (), ())


class SegmentationPipeline:
    """One demonstration, from samples to task program. See `Pipeline`."""

    def __init__(self, layout: Layout, preset: Preset, opening: Open) -> None:
        self._opening = opening
        self._preset = preset
        self._source = WRENCH_SOURCES[layout.wrench_source]
        self._conditioner = Conditioner(layout)
        self._heeded = Heeded()
        self._begin(tared=True)
        self._history = History()
        self._gaps = Gaps()
        self._grips: list[Grip] = []
        self._program, self._built = self._growing(), _NEVER
        self._lost = False  # the next gap was declared, not seen
        self._began, self._latest = np.inf, -np.inf  # [s] first and last sample
        self._finished = False
        self._view = self._look()

    @property
    def view(self) -> View:
        """What is known now."""
        return self._view

    def push(self, samples: NDArray[np.float64]) -> None:
        """Take the next samples. Raises ValueError for impossible ones; nothing has changed then."""
        conditioned = self._conditioner.push(samples)
        if len(samples):
            times = samples[:, 0].tolist()
            self._latest = max(self._latest, *times)
            self._note_beginning(times[0])
        self._take(conditioned)

    def declare_gap(self) -> None:
        """Say that samples between the last push and the next, or the end, are lost for good."""
        self._conditioner.declare_gap()
        self._lost = True

    def finish(self) -> None:
        """The demonstration is over: what is still open is decided as it stands."""
        self._finished = True
        if self._lost and self._conditioner.samples:
            self._gaps.add(Gap(t0=self._latest, tn=self._latest, reason="evicted"))
        self._take(self._conditioner.finish())

    def resolve(self, change: Change) -> Correction:
        """What a correction comes to. Raises ProtocolError where it points at nothing."""
        return resolved(change, self._shown())

    def corrected(self, corrections: Sequence[Correction]) -> Self:
        """The same demonstration with these corrections from its first sample on; takes the place of this."""
        other = copy(self)
        other._heeded = Heeded(corrections)
        other._program, other._built = other._growing(), _NEVER
        other._begin(tared=self._tared)
        for index in range(len(self._history)):
            other._step(index)
        other._view = other._look()
        return other

    def _note_beginning(self, t: float) -> None:
        """Where the first sample was not the first one sent, say so; it divides nothing."""
        if np.isinf(self._began):
            self._began = t
            if self._lost:
                self._gaps.add(Gap(t0=t, tn=t, reason="evicted"))
                self._lost = False

    def _growing(self) -> GrowingProgram:
        return GrowingProgram(self._history.moment, self._preset.least_segment_s)

    def _begin(self, *, tared: bool) -> None:
        self._settled, self._baseline = Settled(), list[Stretch]()
        self._seen: dict[int, _Seen] = {}  # of what has not settled, by its first observation
        self._places = array("d")  # [s] where a segment begins whose first own observation is this one
        level = self._preset.threshold
        self._tared = tared
        self._online = filter_of(self._preset, self._source, tared=tared)
        self._decided = None if level is None else OnlineThreshold(self._online, level)

    def _take(self, conditioned: Conditioned) -> None:
        for t0, tn in conditioned.gaps:
            self._gaps.add(Gap(t0=t0, tn=tn, reason="evicted" if self._lost else "source"))
            self._lost = False
        grips = [Grip(event.t, event.kind, event.width) for event in conditioned.gripper_events]
        self._grips += grips
        if any(grip.t <= self._program.since for grip in grips):
            self._program = self._growing()
        if conditioned.observations and not self._online.count and self._conditioner.tare is None:
            self._begin(tared=False)
        for observation in conditioned.observations:
            self._history.append(observation)
            self._step(len(self._history) - 1)
        if conditioned.observations or conditioned.gaps or conditioned.gripper_events or self._finished:
            self._view = self._look()
        else:
            counts = self._conditioner
            self._view = self._view._replace(samples=counts.samples, repeats=counts.repeats)

    def _step(self, index: int) -> None:
        """Let the filter take an observation, with what somebody has said of it.

        A segment that joins the one before begins somewhere between two observations: midway, then.
        """
        history, after_gap = self._history, self._history.after_gap(index)
        joins = index and self._preset.continuous and not after_gap
        place = 0.5 * (history.t(index - 1) + history.t(index)) if joins else history.t(index)
        self._places.append(place)
        said = self._heeded.start(index, place + 0.5 * STEP_S)
        follower = self._decided or self._online
        follower.step(history.observed(index), boundary=after_gap, changepoint=said)

    @property
    def _bias_n(self) -> float:
        return UNTARED_BIAS_N if self._conditioner.tare is None else TARED_BIAS_N

    def _look(self) -> View:
        self._unsettled = parts = self._parts()
        return View(
            t=self._history.t_last,
            samples=self._conditioner.samples,
            repeats=self._conditioner.repeats,
            observations=self._online.count,
            changepoints=self._settled.changepoints(parts),
            segments=self._settled.segments(parts),
            posterior_starts=tuple(map(self._places.__getitem__, self._online.starts.tolist())),
            posterior_probabilities=tuple(self._online.posterior.tolist()),
            apps=self._apps(parts),
            notes=self._notes(),
            gaps=self._gaps.all,
            wrench=self._wrench(),
            delay_s=self._conditioner.delay_s,
            hypotheses=self._online.starts.size,
            capped=self._online.capped,
            length_unit=self._opening.length_unit,
        )

    def _parts(self) -> list[Part]:
        """Every stretch that has not settled, with its segment; remembers those that have."""
        if not self._online.count:
            return []
        found = stretches(self._online, len(self._settled), decided=self._decided)
        fresh = [self._as_said(stretch) for stretch in found]
        every, first = [*self._baseline, *fresh], len(self._baseline)
        seen = [self._look_at(every, first + i) for i in range(len(fresh))]
        self._seen = {one.stretch.start: one for one in seen}
        parts = [Part(one.stretch.start, one.stretch.end, one.segment, one.changepoint) for one in seen]
        count = self._settling(fresh)
        self._settled.take(parts[:count], self._program.first)
        free = (one for one in reversed(fresh[:count]) if is_baseline(one, self._history, self._bias_n))
        self._baseline = [*islice(free, 1)] or self._baseline
        return parts[count:]

    def _as_said(self, stretch: Stretch) -> Stretch:
        """As somebody has placed and named it: given its ends, a name is the whole inference."""
        if self._heeded.is_certain(start := stretch.start):
            stretch = replace(stretch, start_probability=1.0, start_interval=(start, start))
        label = self._heeded.label(start, stretch.end)
        if label is None:
            return stretch
        kind = next(kind for kind in self._online.lattice.kinds if kind.name == label)
        return replace(stretch, verdict=Verdict(kind, 1.0, None, 0.0))

    def _settling(self, fresh: list[Stretch]) -> int:
        """How many of these nothing can change any more, not even a later comparison of their load."""
        count, weighing = 0, False
        for i, stretch in enumerate(fresh):
            if not stretch.end_final:
                break
            weighing = weighing or stretch.verdict.kind.contact == "transport"
            compared = is_baseline(stretch, self._history, self._bias_n)
            if stretch.start_stands and (compared or (not weighing and count == i)):
                count, weighing = i + 1, False
        return count

    def _look_at(self, all_stretches: list[Stretch], index: int) -> _Seen:
        """What is shown of a stretch: the same as before, where nothing has changed that it is made of."""
        stretch = all_stretches[index]
        load = weigh(all_stretches, index, self._history, self._bias_n)
        seen = None if self._finished else self._seen.get(stretch.start)
        stays = seen is not None and self._stays(seen, stretch, load)
        segment = seen.segment if seen and stays else self._segment(stretch, load)
        start_stays = seen is not None and _starts_alike(seen.stretch, stretch)
        changepoint = seen.changepoint if seen and start_stays else self._changepoint(stretch)
        return _Seen(stretch, load, segment, changepoint)

    def _stays(self, seen: _Seen, stretch: Stretch, load: Load | None) -> bool:
        """Does this make the same segment as what was seen?"""
        before = seen.stretch
        return (
            (before.end, before.end_final, before.verdict)
            == (stretch.end, stretch.end_final, stretch.verdict)
            and seen.segment.tn == self._end(stretch.end)
            and seen.load == load
        )

    def _segment(self, stretch: Stretch, load: Load | None) -> Segment:
        found, history = stretch.verdict, self._history
        begin, last = stretch.start - self._joins(stretch.start), stretch.end - 1
        return Segment(
            t0=self._places[stretch.start],
            tn=self._end(stretch.end),
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
        )

    def _joins(self, start: int) -> bool:
        """Whether a segment with its first own observation at `start` begins where the one before it ends."""
        return self._preset.continuous and start > 0 and start not in self._online.boundaries

    def _end(self, end: int) -> float:
        """[s] Where a segment ends that has observations up to `end`, which is not its own."""
        missing = end == self._online.count or end in self._online.boundaries
        return self._history.t(end - 1) if missing else self._places[end]

    def _changepoint(self, stretch: Stretch) -> Changepoint:
        final = stretch.start_final or self._finished
        return Changepoint(
            t=self._places[stretch.start],
            probability=stretch.start_probability,
            certainty="final" if final else "provisional",
            t_low=self._places[stretch.start_interval[0]],
            t_high=self._places[stretch.start_interval[1]],
            corrected=self._heeded.is_certain(stretch.start),
        )

    def _apps(self, unsettled: list[Part]) -> Sequence[App]:
        """The program; the last one, where the last segment but goes on and that was built not long ago."""
        count = self._online.count
        segments = tuple((one.start, one.segment.kind, one.segment.certainty) for one in unsettled)
        happened = (segments, len(self._grips), self._gaps.all, self._finished)
        if happened != self._built.happened or count >= self._built.observations + PROGRAM_EVERY:
            self._built = _Built(count, happened, self._apps_now(unsettled))
        return self._built.apps

    def _apps_now(self, unsettled: list[Part]) -> Sequence[App]:
        first = self._program.first
        parts = [*self._settled.since(first), *unsettled]
        starts = [*(part.changepoint.probability for part in parts), 1.0]
        starts[0] = starts[0] if first else 1.0
        steps = [
            Step(first + i, part.segment, part.segment.probability * min(starts[i], starts[i + 1]))
            for i, part in enumerate(parts)
        ]
        apps = self._program.apps(steps, len(self._settled), self._grips, self._gaps.all)
        return tuple(self._limited(app) for app in apps) if self._heeded.limits_forces else apps

    def _limited(self, app: App) -> App:
        limit_n = self._heeded.force_limit(app)
        return app if limit_n is None else with_force_limit(app, limit_n)

    def _shown(self) -> Shown:
        """What there is to correct."""
        parts = [*self._settled.since(0), *self._unsettled]
        spans = [
            Span(
                t0=part.segment.t0,
                tn=part.segment.tn,
                start=part.start,
                end=part.end,
                grows=i == len(parts) - 1 and not self._finished,
            )
            for i, part in enumerate(parts)
        ]
        return Shown(
            t_first=self._history.t(0) if parts else 0.0,
            t_last=self._view.t,
            finished=self._finished,
            marks=[self._mark(before, part) for before, part in pairwise(parts)],
            spans=spans,
            kinds=[kind.name for kind in self._online.lattice.kinds],
            apps=self._view.apps,
        )

    def _mark(self, before: Part, part: Part) -> Mark:
        """A changepoint, with what lies between its neighbours."""
        between = range(before.start + 1, part.end)
        shown, gaps = part.changepoint, self._online.boundaries
        return Mark(
            t=shown.t,
            t_low=shown.t if shown.t_low is None else shown.t_low,
            t_high=shown.t if shown.t_high is None else shown.t_high,
            between=tuple(index for index in between if index not in gaps),
            after_gap=part.start in gaps,
        )

    def _notes(self) -> tuple[str, ...]:
        """What somebody must know who runs the program."""
        wrench = () if self._source.contact_models else (self._source.note,)
        return (*wrench, self._gaps.note(self._began)) if self._gaps.all else wrench

    def _wrench(self) -> WrenchReport:
        source = self._source
        return WrenchReport(
            source=self._opening.wrench_source,
            contact_models=source.contact_models,
            transport_models=source.transport_models,
            tare=self._conditioner.tare,
            note=f"{source.note} {self._conditioner.tare_note}",
            frame=self._opening.force_frame,
        )


def _starts_alike(one: Stretch, other: Stretch) -> bool:
    """Is the same shown of where they begin?"""
    known = one.start_probability, one.start_interval, one.start_final
    return known == (other.start_probability, other.start_interval, other.start_final)

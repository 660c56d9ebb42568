"""The pipeline of a session: sample → observation → evidence → posterior → segment → app."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_force_limit import with_force_limit
from caesura_protocol.errors import ProtocolError
from caesura_protocol.messages import App, Change, Gap, Open, Phase, Segment
from caesura_protocol.number_words import counted
from caesura_protocol.plausibility import FirstSecond
from caesura_protocol.programs.apps_by_phase import ungrouped_notes
from caesura_protocol.robots import RobotError
from caesura_protocol.rotations import upright_rotation
from caesura_protocol.up_direction import UP, up_in_words
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.presets import KNOWN_PRESETS, preset_named
from caesura_service.changepoint.probability_threshold_segmenter import check_level
from caesura_service.coaching import (
    ArmLimits,
    BoundaryCoach,
    CoachingSetup,
    SignalCoach,
    all_hints,
)
from caesura_service.constants import TARED_BIAS_N
from caesura_service.cooperative_scheduler import give_way
from caesura_service.phases import PARAMETERS, Chain, PhaseTracker
from caesura_service.program import (
    TOLERANCE_M,
    TOLERANCE_RAD,
    Gaps,
    GripperAction,
    Moment,
    Paths,
    ProgramSegment,
    unreproduced_finger_motion,
)
from caesura_service.segmentation.correctable_parts import edit_context
from caesura_service.segmentation.corrections import (
    EditContext,
    FilterConstraints,
    ResolvedEdit,
    resolved,
)
from caesura_service.segmentation.encoded_log import EncodedMessageLog, MessageSequence
from caesura_service.segmentation.finalized_segments import SegmentEntry
from caesura_service.segmentation.incremental_program_builder import IncrementalProgramBuilder
from caesura_service.segmentation.input_notes import (
    frozen_note,
    standing_notes,
    too_fast_note,
    wrench_report,
)
from caesura_service.segmentation.notes_on_parts_in_no_app import notes_on_parts_in_no_app
from caesura_service.segmentation.observation_store import ObservationStore, observed_pose
from caesura_service.segmentation.opening_layout import arm_of, robot_of, sample_layout
from caesura_service.segmentation.pipeline_interface import Pipeline, PipelineView
from caesura_service.segmentation.segmenter import Segmenter
from caesura_service.signals import (
    Conditioner,
    ConditioningOutput,
    SampleLayout,
)
from caesura_service.signals.tare import UNTARED_BIAS_N

PHASES = Chain(PARAMETERS)
# Observations from one look at segments to the next, while nothing happens but that the last one goes on or
# others become final; and, at least, from one program, with its phases, to the next.
LOOK_EVERY, PROGRAM_EVERY = 10, 20
# Where many observations are taken at once, what has settled is made and kept on the way, so that no piece of
# work is long: segments every so many that are final, the program and all else every so many observations.
SETTLE_EVERY = 25  # final segments
ALL_EVERY = 150  # observations


def make_pipeline(opening: Open, default_preset: str, *, threshold: float | None = None) -> Pipeline:
    """Make the pipeline of a session. Raises ProtocolError `malformed` for an invalid preset or columns.

    threshold: on the smoothed probability; it defines changepoints instead of the best segmentation. Raises
    ValueError for one that is not between 0 and 1.
    """
    name = opening.preset or default_preset
    try:
        preset = preset_named(name)
    except KeyError as error:
        raise ProtocolError(
            "malformed", "unknown preset", value=name, expected=list(KNOWN_PRESETS)
        ) from error
    if threshold is not None:
        check_level(threshold)
        preset = replace(preset, threshold=threshold, filter=replace(preset.filter, certain=1.0))
    if (opening.wrench_source, opening.hand_on_robot) == ("flange_sensor_with_hand", "no"):
        raise ProtocolError(
            "malformed",
            "hand_on_robot is 'no', which contradicts wrench_source 'flange_sensor_with_hand' "
            "(without a hand: 'flange_sensor' or 'joint_torque_estimate')",
            value="no",
            expected=["yes", "unknown"],
        )
    try:
        robot = robot_of(opening)
        return SegmentationPipeline(
            sample_layout(opening, robot), preset, opening, arm=arm_of(opening, robot)
        )
    except ValueError as error:
        value = opening.robot if isinstance(error, RobotError) else list(opening.columns)
        raise ProtocolError("malformed", str(error), value=value) from error


class _Happened(NamedTuple):
    """The state on which segments and program depend, without the end of the last segment.

    beside: the number of gripper actions, the gaps, and the tare.
    """

    outline: tuple[int, list[tuple[int, int]]] = (0, [])
    beside: tuple[int, tuple[Gap, ...], tuple[float, float, float] | None] = (0, (), None)
    last_start_t: float = 0.0  # [s]

    def is_like(self, before: Self) -> bool:
        """Whether nothing has changed since `before`, other than segments that have become final."""
        (known, growing_before), (final, growing) = before.outline, self.outline
        alike = self.beside == before.beside and self.last_start_t == before.last_start_t
        return alike and growing == growing_before[final - known :]


class _Looked(NamedTuple):
    """The numbers of observations at the last update of segments and of program, and the other inputs."""

    observations: int = -LOOK_EVERY
    program: int = -PROGRAM_EVERY
    happened: _Happened = _Happened()


class SegmentationPipeline:
    """The pipeline of a demonstration, from samples to task program. See `Pipeline`."""

    def __init__(
        self, layout: SampleLayout, preset: Preset, opening: Open, *, arm: ArmLimits | None = None
    ) -> None:
        self._opening = opening
        self._preset = preset
        self._source = layout.source
        self._in_use = layout.source.with_preset(
            preset.name, contact=preset.has_kind_in("contact"), load=preset.has_kind_in("transport")
        )
        if opening.up is not None:
            self._in_use = replace(self._in_use, up=up_in_words(opening.up))
        self._standing_notes = standing_notes(opening, preset, layout, self._in_use)
        self._upright = upright_rotation(opening.up)
        self._conditioner = Conditioner(layout)
        self._first_second = FirstSecond(
            opening.columns, opening.length_unit, opening.declared_units, opening.robot
        )
        self._heeded = FilterConstraints()
        self._history = ObservationStore(self._upright)
        self._paths = Paths(
            self._history.poses,
            opening.path_tolerance_m or TOLERANCE_M,
            opening.path_tolerance_rad or TOLERANCE_RAD,
        )
        self._arm = arm
        self._coach = self._signal_coach(tared=True)
        self._begin(tared=True)
        self._gaps = Gaps()
        self._grips: list[GripperAction] = []
        self._program, self._looked = self._growing(), _Looked()
        self._lost = False  # the next gap was declared, not seen
        self._began = math.inf  # [s] first sample
        self._finished = False
        self._program_part: dict[str, Any] = {"apps": (), "notes": (), "unapplied": {}}  # of the view
        self._due_parts: list[SegmentEntry] | None = None  # not settled, of which a program has to be made
        self._view: PipelineView
        self.refresh()

    @property
    def view(self) -> PipelineView:
        """The view after the last push, with the counts of all samples so far."""
        counts = self._conditioner
        if counts.samples != self._view.samples:
            self._view = self._view._replace(samples=counts.samples, repeats=counts.repeats)
        return self._view

    @property
    def due_s(self) -> float:
        """The time [s] from which on a sample changes the view, as in `Pipeline`."""
        return self._conditioner.due_s if self._first_second.is_over else -math.inf

    def push(self, samples: NDArray[np.float64]) -> bool:
        """Process samples. Raises ValueError for impossible ones, which change no result.

        After samples in an implausible unit every further push raises, too.
        """
        is_news = self.push_without_program(samples)
        self.make_due_program()
        return is_news

    def push_without_program(self, samples: NDArray[np.float64]) -> bool:
        """Push samples as `push` does; a due program is postponed to `make_due_program`. Raises as `push`."""
        if (found := self._first_second.check(samples)) is not None:
            declare = f"declare the unit of {found.quantity} in the opening's `declared_units` if it is right"
            raise ValueError(f"implausible: {found}; {declare}")
        conditioned = self._conditioner.push(samples)
        if self._began == math.inf and len(samples):
            self._note_beginning(float(samples[0, 0]))
        if conditioned.is_quiet:
            return False
        self._take(conditioned)
        return True

    @property
    def has_due_program(self) -> bool:
        """Whether the last update has postponed its program to `make_due_program`."""
        return self._due_parts is not None

    def make_due_program(self) -> None:
        """Make the program that the last update has postponed, if any."""
        if self._due_parts is None:
            return
        parts, self._due_parts = self._due_parts, None
        self._program_part = self._with_notes(self._apps(parts), self._view.segments)
        self._view = self._view._replace(**self._program_part)

    def declare_gap(self) -> None:
        """Declare that samples between the last push and the next, or the end, are permanently lost."""
        self._conditioner.declare_gap()
        self._lost = True

    def finish(self) -> None:
        """End the demonstration: decide everything that is still open as it stands."""
        self._finished = True
        if self._lost and self._conditioner.samples:
            latest = self._conditioner.t_last
            self._gaps.add(Gap(t0=latest, tn=latest, reason="evicted"))
        self._take(self._conditioner.finish())
        self.make_due_program()
        self._close_hints()

    def resolve(self, change: Change) -> ResolvedEdit:
        """Return a correction, resolved against the newest view.

        Raises ProtocolError if it has no target.
        """
        self.refresh()
        return resolved(change, self._shown())

    def refresh(self) -> None:
        """Bring the view up to date; an edit calls this several times at one observation."""
        happened, count = self._happened(), self._division.online.count
        if self._looked == _Looked(count, count, happened) and self._due_parts is None:
            return
        self._view = self._look(happened)
        self.make_due_program()

    @property
    def kinds(self) -> Sequence[str]:
        """The names of the kinds that a segment may have."""
        return [*dict.fromkeys(kind.name for kind in self._division.online.lattice.kinds)]

    def observation_at(self, t: float) -> int:
        """Return the first observation of a segment whose changepoint is inserted at a time [s]."""
        return max(1, bisect_right(range(len(self._history)), t, key=self._history.t))

    def corrected(self, corrections: Sequence[ResolvedEdit]) -> Self:
        """Return the same demonstration with these corrections from its first sample on.

        It replaces this pipeline.
        """
        other = copy(self)
        other._heeded = FilterConstraints(corrections)
        other._program, other._looked = other._growing(), _Looked()
        other._begin(tared=self._division.tared)
        other._finished = False  # what a finished one states, an hour would state every fifteen seconds
        for index in range(len(self._history)):
            other._step(index)
            other._keep_up()  # an hour of it, all at once at the end, would be one slice
            give_way()
        other._finished, other._looked = self._finished, _Looked()
        if self._finished:
            other._close_hints()
        other.refresh()
        return other

    def _close_hints(self) -> None:
        """Clear the active hints at the end of the demonstration."""
        for log in (self._coach.log, self._boundary_coach.log):
            log.clear_all(self._history.t_last)
        self._view = self._view._replace(hints=all_hints(self._coach.log, self._boundary_coach.log))

    def _note_beginning(self, t: float) -> None:
        """Store the time [s] of the first sample, and a gap if samples before it are lost.

        Such a gap divides nothing.
        """
        self._began = t
        if self._lost:
            self._gaps.add(Gap(t0=t, tn=t, reason="evicted"))
            self._lost = False

    def _growing(self) -> IncrementalProgramBuilder:
        opening = self._opening
        return IncrementalProgramBuilder(
            self._history.moment if self._in_use.contact_models else self._moment_without_force,
            self._preset.least_segment_s,
            replace(self._paths),  # what is kept of them stays: a correction changes few
            opening.force_limit_n,
            limited=self._limited if self._heeded.limits_forces else None,
            up=opening.up or UP,
        )

    def _moment_without_force(self, t: float) -> Moment:
        """Return the robot's state at a time [s] without its force, which may be a guiding hand's.

        Otherwise the program would take a change of the hand's force on what is carried for a contact.
        """
        return replace(self._history.moment(t), force=None)

    def _begin(self, *, tared: bool) -> None:
        layout = self._conditioner.layout
        self._division = Segmenter(
            self._preset,
            self._source,
            self._history,
            self._heeded,
            tared=tared,
            orientation=layout.has_orientation,
            torque=layout.has_torque,
        )
        self._boundary_coach = BoundaryCoach()
        self._phases = PhaseTracker(PHASES, lambda t0, tn: self._history.poses(t0, tn)[1][:, :3])
        self._decided_phases = EncodedMessageLog(Phase)

    def _signal_coach(self, *, tared: bool) -> SignalCoach:
        """Return the coach on signals; it uses the force if the wrench is declared to be without a hand."""
        source = self._source
        return SignalCoach(
            CoachingSetup(
                clean_wrench=source.contact_models and source.bias == "tare",
                bias_n=TARED_BIAS_N if tared else UNTARED_BIAS_N,
                path_tolerance_m=self._opening.path_tolerance_m or TOLERANCE_M,
                arm=self._arm,
                is_tared=tared,
                path_tolerance_rad=self._opening.path_tolerance_rad or TOLERANCE_RAD,
            )
        )

    def _step(self, index: int) -> None:
        """Filter an observation, and raise or clear hints from the posterior."""
        self._division.step(index)
        division, t = self._division, self._history.t(index)
        self._boundary_coach.observe(division.online, t, division.places, rests=self._history.rests(index))

    def _take(self, conditioned: ConditioningOutput) -> None:
        for t0, tn in conditioned.gaps:
            self._gaps.add(Gap(t0=t0, tn=tn, reason="evicted" if self._lost else "source"))
            self._lost = False
        grips = [GripperAction(event.t, event.kind, event.width) for event in conditioned.gripper_events]
        self._grips += grips
        if any(grip.t <= self._program.since for grip in grips):
            self._program = self._growing()
        if conditioned.observations and not self._division.online.count and self._conditioner.tare is None:
            self._coach = self._signal_coach(tared=False)
            self._begin(tared=False)
        looked, gaps = self._looked, [*conditioned.gaps]
        for observation in conditioned.observations:
            self._report(gaps, observation.t)
            self._history.append(observation)
            self._coach.observe(observed_pose(observation, self._upright))
            self._step(len(self._history) - 1)
            self._keep_up()
            give_way()
        self._report(gaps, math.inf)
        happened, count = self._happened(), self._division.online.count
        due = self._finished or count >= looked.observations + LOOK_EVERY
        if not due and happened.is_like(looked.happened):
            self._view = self._view._replace(**self._newest())
        elif (
            self._finished
            or count >= looked.program + PROGRAM_EVERY
            or happened.beside != looked.happened.beside
        ):
            self._view = self._look(happened)
        else:
            self._view = self._look(happened, program=False)

    def _report(self, gaps: list[tuple[float, float]], t: float) -> None:
        """Raise hints for the gaps that begin before a time [s], and remove them from `gaps`."""
        while gaps and gaps[0][0] < t:
            self._coach.report_gap(*gaps.pop(0))

    def _keep_up(self) -> None:
        """Store the settled segments once there are many."""
        if self._division.online.count >= self._looked.program + ALL_EVERY:
            self.refresh()
        elif self._division.unlooked >= SETTLE_EVERY:
            self._settle()

    def _settle(self) -> list[SegmentEntry]:
        """Store the segments that have settled, and their phases; return the other segments."""
        division = self._division
        self._unsettled = parts = division.look(self._program.first, finished=self._finished)
        for part in division.settled.since(self._phases.settled):
            self._phases.settle(part.segment)
            give_way()
        return parts

    def _happened(self) -> _Happened:
        beside = len(self._grips), self._gaps.all, self._conditioner.tare
        outline = self._division.outline()
        last_start_t = self._division.start_t(outline[1][-1][0]) if outline[1] else 0.0
        return _Happened(outline, beside, last_start_t)

    def _newest(self) -> dict[str, Any]:
        """Return the fields of a view that every observation changes."""
        online = self._division.online
        starts = online.starts.tolist()
        return {
            "t": self._history.t_last,
            "samples": self._conditioner.samples,
            "repeats": self._conditioner.repeats,
            "observations": online.count,
            "posterior_starts": tuple(map(self._division.places.__getitem__, starts)),
            "posterior_probabilities": tuple(online.posterior.tolist()),
            "hypotheses": len(starts),
            "capped": online.capped,
            "hints": all_hints(self._coach.log, self._boundary_coach.log),
        }

    def _look(self, happened: _Happened, *, program: bool = True) -> PipelineView:
        """Return a new view. A program that is due stays as before until `make_due_program`.

        program: whether to make phases, and to postpone a program; neither is due at each update.
        """
        division = self._division
        count, made = division.online.count, self._looked.program
        self._looked = _Looked(count, count if program else made, happened)
        parts = self._settle()
        segments = division.settled.segments(parts)
        if program:
            self._due_parts, phases = parts, self._phases_with(parts)
        else:
            self._program_part = self._with_notes(self._view.apps, segments)
            phases = self._view.phases
        give_way()
        return PipelineView(
            **self._newest(),
            **self._program_part,
            changepoints=division.settled.changepoints(parts),
            segments=segments,
            gaps=self._gaps.all,
            wrench=wrench_report(
                self._opening,
                self._conditioner.layout.source_in_use,
                self._in_use,
                self._conditioner.tare,
                self._conditioner.tare_note,
            ),
            delay_s=self._conditioner.delay_s,
            length_unit=self._opening.length_unit,
            force_limit_n=self._opening.force_limit_n,
            robot=self._opening.robot,
            up=self._opening.up,
            phases=phases,
        )

    def _with_notes(self, apps: Sequence[App], segments: Sequence[Segment]) -> dict[str, Any]:
        """Return the fields of a view that belong to the program."""
        unapplied = self._heeded.unapplied(apps, self._view.phases, self._is_beyond)
        notes = (*self._notes(), *self._parts_in_no_app(segments, apps), *self._heeded.notes(unapplied))
        return {"apps": apps, "notes": notes, "unapplied": unapplied}

    def _phases_with(self, parts: list[SegmentEntry]) -> Sequence[Phase]:
        """Return the phases so far; parts: the segments that have not settled."""
        segments = [part.segment for part in parts]
        decided, rest = self._phases.update(segments, finished=self._finished)
        self._decided_phases.extend([self._heeded.named(phase) for phase in decided])
        return MessageSequence(self._decided_phases, [self._heeded.named(phase) for phase in rest])

    def _apps(self, unsettled: list[SegmentEntry]) -> Sequence[App]:
        first = self._program.first
        parts = [*self._division.settled.since(first), *unsettled]
        starts = [*(part.changepoint.probability for part in parts), 1.0]
        starts[0] = starts[0] if first else 1.0
        steps = [
            ProgramSegment(
                first + i,
                part.segment,
                part.segment.probability * min(starts[i], starts[i + 1]),
                is_set_apart=part.changepoint.corrected,
            )
            for i, part in enumerate(parts)
        ]
        if self._program.paths is not None:  # the last segment goes on, and so does its path
            growing = bool(steps) and not self._finished
            self._program.paths.settled_until = steps[-1].segment.t0 if growing else math.inf
        return self._program.apps(steps, len(self._division.settled), self._grips, self._gaps.all)

    def _is_beyond(self, t: float) -> bool:
        """Return whether the session has ended before a segment could start at a time [s]."""
        return self._finished and self.observation_at(t) >= self._division.online.count

    def _limited(self, app: App) -> App:
        limit_n = self._heeded.force_limit(app)
        return app if limit_n is None else with_force_limit(app, limit_n)

    def _shown(self) -> EditContext:
        """Return the changepoints, segments, apps and phases that an operator may correct."""
        parts = [*self._division.settled.since(0), *self._unsettled]
        return edit_context(
            parts,
            self._division.online.boundaries,
            self._view,
            self.kinds,
            t_first=self._history.t(0) if parts else 0.0,
            finished=self._finished,
            place_of=self._division.place_of,
            force_limit_n=self._opening.force_limit_n,
        )

    def _parts_in_no_app(self, segments: Sequence[Segment], apps: Sequence[App]) -> Iterator[str]:
        """Yield notes on what of a finished demonstration is in no app or group; apps: as inferred."""
        if self._finished and apps:
            excursions = self._conditioner.finger_excursions
            yield from notes_on_parts_in_no_app(
                segments,
                apps,
                self._history,
                unreproduced_finger_motion(*self._history.openings(), self._grips, excursions),
                has_forces=self._in_use.contact_models,
                up=self._program.up,
            )
            yield from ungrouped_notes(apps, self._view.phases)

    def _notes(self) -> tuple[str, ...]:
        """Return the notes on the wrench source in use, its limits, gaps, and corrections resolved again."""
        notes = [*self._standing_notes]
        if (doubt := self._conditioner.tare_doubt) and self._in_use.contact_models:
            notes.append(doubt)
        first = self._coach.log.first
        if (since := first.get("frozen_force")) is not None and self._in_use.contact_models:
            notes.append(frozen_note(since))
        if (since := first.get("too_fast")) is not None:
            notes.append(too_fast_note(since))
        if self._gaps.all:
            notes.append(self._gaps.note(self._began))
        if anew := self._heeded.anew:
            notes.append(
                "Resolved again at a restart, from a journal of an older version: "
                f"{counted(anew, 'correction')}. Check the results."
            )
        return tuple(notes)

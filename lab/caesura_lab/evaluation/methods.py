"""The interface of a method that can be judged, and its implementation by Caesura's presets.

A method has no access to the truth. Caesura gets the samples batch by batch, like a session, and its result
after each is stored, so that delays can be measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from caesura_lab.evaluation.baselines.bocpd_baseline import gaussian_log, student_speed
from caesura_lab.evaluation.baselines.simple_baselines import (
    Baseline,
    every_second,
    one_segment,
    thresholds,
    zero_velocity,
)
from caesura_lab.evaluation.scoring.metrics import TimedEstimate
from caesura_lab.evaluation.scoring.score import FoundSegment, FoundSegmentation
from caesura_protocol.messages import Segment
from caesura_protocol.package_version_and_extras import install_command
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import views
from caesura_service.segmentation.pipeline_interface import PipelineView


class Method(Protocol):
    """Method that segments a recording. It can be pickled; the same recording gives the same result."""

    @property
    def name(self) -> str:
        """Return the name in the tables."""

    def segment(self, recording: Recording) -> FoundSegmentation:
        """Segment a recording. Raises ValueError or ProtocolError if the method cannot be applied."""


@dataclass(frozen=True)
class PresetMethod:
    """A preset of Caesura, online."""

    preset: str = "default"

    @property
    def name(self) -> str:
        """The preset's name."""
        return self.preset

    def segment(self, recording: Recording) -> FoundSegmentation:
        """Push the recording through a session's pipeline."""
        latest = np.maximum.accumulate(recording.t)
        timed_estimates: list[TimedEstimate] = []
        view: PipelineView | None = None
        for view in views(recording, self.preset):
            estimate = _estimate_at(float(latest[max(view.samples, 1) - 1]), view)
            if not timed_estimates or timed_estimates[-1][1:] != estimate[1:]:
                timed_estimates.append(estimate)
        assert view is not None, "views yields at least what is known at the end"
        return FoundSegmentation(
            changepoints=tuple(changepoint.t for changepoint in view.changepoints),
            parts=tuple(map(_found_segment, view.segments)),
            timed_estimates=tuple(timed_estimates),
            intervals=_intervals(view),
            probabilities={changepoint.t: changepoint.probability for changepoint in view.changepoints},
            phases=tuple(phase.t0 for phase in view.phases[1:]),
        )


def _estimate_at(t: float, view: PipelineView) -> TimedEstimate:
    times = tuple(changepoint.t for changepoint in view.changepoints)
    return TimedEstimate(
        t, times, tuple(changepoint.certainty == "final" for changepoint in view.changepoints)
    )


def _intervals(view: PipelineView) -> dict[float, tuple[float, float]]:
    return {
        one.t: (one.t_low, one.t_high)
        for one in view.changepoints
        if one.t_low is not None and one.t_high is not None
    }


def _found_segment(segment: Segment) -> FoundSegment:
    force_n = float(np.linalg.norm(segment.force))
    screw = None if segment.screw is None else (segment.screw.axis, segment.screw.pitch_m)
    return FoundSegment(
        segment.t0, segment.tn, segment.kind, segment.load_kg, force_n, segment.probability, screw
    )


class MissingExtraError(RuntimeError):
    """A library that a baseline needs is not installed."""


def baselines() -> list[Method]:
    """Return all baselines. Raises MissingExtraError if their libraries are not installed."""
    try:
        from caesura_lab.evaluation.baselines import third_party_baselines  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{error.name} is not installed; {install_command('judge')}, or give --no-baselines"
        ) from error
    return [
        Baseline("thresholds", thresholds),
        Baseline("zero velocity", zero_velocity),
        Baseline("PELT linear", third_party_baselines.pelt),
        Baseline("Gaussian online", third_party_baselines.gaussian_online),
        Baseline("BOCPD log", gaussian_log),
        Baseline("BOCPD speed", student_speed),
        Baseline("kernel", third_party_baselines.kernel),
        Baseline("every second", every_second),
        Baseline("one segment", one_segment),
    ]

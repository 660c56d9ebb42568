"""The data of a report, as arrays and strings, without drawing.

Times are the recording's own [s]. An observation that starts a segment and the boundary that this makes may
differ by one sample (see `Preset.continuous`); drawings over time use the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_lab.ground_truth import Truth
from caesura_lab.recording_warnings import recording_warnings
from caesura_lab.report.filter_trace import FilterTrace, PosteriorSnapshot, trace_filter
from caesura_protocol.number_words import counted
from caesura_protocol.recording import Recording
from caesura_service.offline_segmentation import segment_recording
from caesura_service.segmentation.pipeline_interface import PipelineView

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

THRESHOLD = 0.2  # above which the thesis counts a changepoint (4.2)
DELAYS_S = (0.2, 0.6, 1.2)  # after which run-length probabilities are looked at; the last two as in Fig. 4.19
STEP_S = 0.1  # of the segmentation grid
ROUNDED = 1e-6  # of a cell: by so much a time may lie before it


@dataclass(frozen=True, eq=False)
class ReportSignals:
    """Signals on the segmentation grid. Base frame; n observations."""

    t: Array  # (n,) [s]
    position: Array  # (n, 3) [m] flange
    speed: Array  # (n,) [m/s]
    force: Array | None  # (n, 3) [N] on the robot, tared; None without a wrench
    stretches: tuple[slice, ...]  # of observations without a gap between them


@dataclass(frozen=True, eq=False)
class ChangepointProbabilities:
    """The probability of a changepoint at every time except the first, where a segment always starts."""

    t: Array  # (n - 1,) [s]
    online: Array  # (n - 1,) smoothed over the last seconds, as it stood when it left the filter's window
    offline: Array  # (n - 1,) given the whole recording


@dataclass(frozen=True, eq=False)
class RunLengthPosterior:
    """The filter's posterior of the current segment's start at every observation.

    Entries of a sparse matrix: at observation `now` the segment had started at `start`.
    """

    t: Array  # (n,) [s] of the observations
    start_t: Array  # (n,) [s] of the boundary that a start there makes
    now: Indices  # (k,)
    start: Indices  # (k,)
    probability: Array  # (k,)

    def start_probability_after(self, delay_s: float) -> Array:
        """(n,) P(the segment started here | data up to this and `delay_s` more); nan where there are none."""
        result = np.full(self.t.size, np.nan)
        steps = round(delay_s / STEP_S)
        result[: max(self.t.size - steps, 0)] = 0.0
        chosen = self.now - self.start == steps
        result[self.start[chosen]] = self.probability[chosen]
        return result

    def image(self, first: float, last: float, most: int = 1500) -> Array:
        """(m, m) start against time, evenly spaced between two times [s], m at most `most`.

        Each cell holds the largest probability that falls into it, 0 where there is none.
        """
        size = min(most, max(round((last - first) / STEP_S), 1))
        times = np.stack([self.start_t[self.start], self.t[self.now]])
        cells = np.floor(size * (times - first) / (last - first) + ROUNDED).astype(np.int64)
        inside = np.all((cells >= 0) & (cells < size), axis=0)
        image = np.zeros((size, size))
        np.maximum.at(image, tuple(cells[:, inside]), self.probability[inside])
        return image


@dataclass(frozen=True, eq=False)
class ReportData:
    """The data of one recording under one preset."""

    name: str
    preset: str
    signals: ReportSignals
    changes: ChangepointProbabilities
    run_lengths: RunLengthPosterior
    view: PipelineView
    truth: Truth | None
    notes: tuple[str, ...] = ()  # on the recording and its preset


def collect(recording: Recording, preset: str, truth: Truth | None = None) -> ReportData:
    """Segment a recording and collect the data of its report.

    Raises ProtocolError or ValueError for a preset, columns or values that cannot be segmented, and for a
    recording too short for a single observation.
    """
    view = segment_recording(recording, preset)
    if not view.segments:
        raise ValueError(
            f"no observation in {counted(view.samples, 'sample')}, expected at least 0.2 s of them"
        )
    trace = trace_filter(recording, preset)
    return ReportData(
        name=recording.name,
        preset=preset,
        signals=_signals(trace, has_force=view.wrench.source != "none"),
        changes=ChangepointProbabilities(trace.boundary_t[1:], trace.smoothed[1:], trace.offline[1:]),
        run_lengths=_run_lengths(trace),
        view=view,
        truth=truth,
        notes=recording_warnings(recording, preset),
    )


def _signals(trace: FilterTrace, *, has_force: bool) -> ReportSignals:
    seen = trace.observations
    cuts = [0, *(i for i, one in enumerate(seen) if one.after_gap and i), len(seen)]
    return ReportSignals(
        t=np.array([one.t for one in seen]),
        position=np.array([one.position_base for one in seen]),
        speed=np.array([one.speed for one in seen]),
        force=np.array([one.force_base for one in seen]) if has_force else None,
        stretches=tuple(slice(first, last) for first, last in pairwise(cuts)),
    )


def _run_lengths(trace: FilterTrace) -> RunLengthPosterior:
    snapshots: tuple[PosteriorSnapshot, ...] = trace.snapshots
    return RunLengthPosterior(
        t=np.array([one.t for one in trace.observations]),
        start_t=trace.boundary_t,
        now=np.repeat(np.arange(len(snapshots)), [one.starts.size for one in snapshots]),
        start=np.concatenate([one.starts for one in snapshots]),
        probability=np.concatenate([one.probabilities for one in snapshots]),
    )

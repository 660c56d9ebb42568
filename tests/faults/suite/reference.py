"""The undisturbed run beside the reference: without it, an error of the pipeline would make everything equal.

The reference shares no compiled code, no batches, no session and no history with the pipeline: the whole
recording is conditioned at once by `signals/numpy_operations.py`, and filtered with the NumPy filter of
 `changepoint/run_length_filter.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from caesura_protocol.recording import Recording
from caesura_service.changepoint.presets import preset_named
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.changepoint.segments import InferredSegment, stretches
from caesura_service.conditioned_recording import observed
from caesura_service.constants import GRID_HZ, TARED_BIAS_N
from caesura_service.offline_segmentation import opening_of
from caesura_service.segmentation.load_inertia import Acceleration
from caesura_service.segmentation.opening_layout import layout_of
from caesura_service.segmentation.pipeline_interface import PipelineView
from caesura_service.signals import Conditioner, Observation
from caesura_service.signals.backend import REFERENCE
from faults.suite.outcome import FULL, Row, Scale
from faults.suite.stations import demonstration, undisturbed

TOLERANCE = 1e-6  # of times [s], places [m], forces [N], probabilities


class ComparedSegment(NamedTuple):
    """A segment, as far as both say the same of it."""

    kind: str
    numbers: tuple[float, ...]  # t0, tn, probability, place at its start and end, force at its start and end


def by_reference(recording: Recording) -> list[ComparedSegment]:
    """The segments of a recording with a tared flange sensor, and without gaps."""
    layout, preset = layout_of(opening_of(recording)), preset_named("default")
    conditioner = Conditioner(layout, arithmetic=REFERENCE)
    observations = [
        *conditioner.push(recording.matrix()).observations,
        *conditioner.finish().observations,
    ]
    assert conditioner.tare is not None, "the recording begins without a tare"
    lattice = preset.lattice(
        contact=layout.source.contact_models,
        transport=layout.source.transport_models,
        orientation=layout.has_orientation,
        bias_n=TARED_BIAS_N,
    )
    online, acceleration = RunLengthFilter(lattice, preset.hazard, preset.filter), Acceleration()
    for observation in observations:
        accelerated = acceleration.next(observation.velocity_base, after_gap=observation.after_gap)
        seen = observed(observation, acceleration=accelerated)
        online.step(seen, boundary=observation.after_gap)
    places = _places(observations)
    return [_part_between(observations, places[one.start], places[one.end], one) for one in stretches(online)]


def _places(observations: Sequence[Observation]) -> list[float]:
    """[s] where a segment begins, by its first observation, and where the last one ends."""
    places = [observations[0].t]
    for before, own, after in zip(observations, observations[1:], [*observations[2:], None], strict=False):
        found = None if after is None else after.boundary_before
        middle = 0.5 * (before.t + own.t)
        places.append(middle if found is None else max(found, places[-1] + 1.0 / GRID_HZ))
    return [*places, observations[-1].t]


def _part_between(
    observations: Sequence[Observation], t0: float, tn: float, one: InferredSegment
) -> ComparedSegment:
    """A segment from t0 to tn [s], with what was observed next to these; of two as near, the earlier one.

    Where one observation is next to both, the segment has its own first and last one.
    """
    t = np.array([observation.t for observation in observations])
    begin, last = (int(np.argmin(np.abs(t - at + 1e-6))) for at in (t0, tn))
    if begin == last:
        begin, last = max(one.start - 1, 0), one.end - 1
    ends = observations[begin], observations[last]
    return part(
        one.verdict.kind.name,
        (t0, tn, one.verdict.probability),
        [end.position_base for end in ends],
        [end.force_base for end in ends],
    )


def by_pipeline(view: PipelineView) -> list[ComparedSegment]:
    """The segments of the undisturbed run, with which every disturbed one is compared."""
    return [
        part(
            one.kind,
            (one.t0, one.tn, one.probability),
            [np.array(one.position_start), np.array(one.position_end)],
            [np.array(one.force_start), np.array(one.force_end)],
        )
        for one in view.segments
    ]


def part(kind: str, numbers: tuple[float, ...], *vectors: list[np.ndarray]) -> ComparedSegment:
    flat = np.concatenate([vector for some in vectors for vector in some])
    return ComparedSegment(kind, (*numbers, *flat.tolist()))


def reference(directory: Path, scale: Scale = FULL) -> Row:
    """Every station's demonstration."""
    del directory
    different, farthest, segments, sent = [], 0.0, 0, 0
    for number in range(scale.stations):
        recording = demonstration(number, scale.seconds)
        is_ = by_pipeline(undisturbed(number, scale.seconds))
        should = by_reference(recording)
        segments, sent = segments + len(should), sent + len(recording.t)
        if [one.kind for one in is_] != [one.kind for one in should]:
            different.append(f"station {number}: kinds differ")
            continue
        apart = np.abs(np.array([one.numbers for one in is_]) - [one.numbers for one in should]).max()
        farthest = max(farthest, float(apart))
        if apart > TOLERANCE:
            different.append(f"station {number}: {apart:.1e} apart")
    note = f"{segments} segments, at most {farthest:.1e} apart" + "".join(f"; {one}" for one in different)
    equal = "no" if different else "yes"
    return Row(scale.stations, sent, 0, 0, equal, None, note, met=bool(segments and not different))

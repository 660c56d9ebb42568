"""Runs a recording through conditioning and filter, one observation at a time, and stores every state.

A session stores only what it needs to continue; a report shows the states over time. The steps are those of
the session's pipeline, in the same order on the same samples, so that both give the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import Recording
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.offline_posterior import segment_offline
from caesura_service.changepoint.presets import preset_named
from caesura_service.conditioned_recording import ConditionedRecording, condition
from caesura_service.signals import Observation

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# What is held against the online filter must be exact, which is quadratic. In a longer stretch, starts that
# explain less than a share of what is known are followed no further.
MOST_EXACT = 1200  # observations, two minutes
PRUNE_RATIO = 1e-12


@dataclass(frozen=True, eq=False)
class PosteriorSnapshot:
    """Posterior of the current segment's start after one observation."""

    starts: Indices  # (h,) observations
    probabilities: Array  # (h,)


@dataclass(frozen=True, eq=False)
class FilterTrace:
    """Observations and posteriors of a whole run of the filter.

    smoothed: (n,) probability that a segment starts at each observation, as the online filter had it last;
    offline: the same from the whole recording at once; boundary_t: (n,) [s] where such a start lies in time.
    """

    observations: tuple[Observation, ...]
    snapshots: tuple[PosteriorSnapshot, ...]
    smoothed: Array
    offline: Array
    boundary_t: Array


def trace_filter(recording: Recording, preset: str) -> FilterTrace:
    """Run the filter over a recording.

    Raises KeyError for an unknown preset, ValueError for no segmentation.
    """
    chosen, conditioned = preset_named(preset), condition(recording)
    observations, online = conditioned.observations, conditioned.make_filter(chosen)
    snapshots = tuple(_snapshots(online, conditioned))
    return FilterTrace(
        observations=observations,
        snapshots=snapshots,
        smoothed=online.smoothed,
        offline=_offline(online, conditioned),
        boundary_t=_boundary_times(observations, continuous=chosen.continuous),
    )


def _snapshots(online: ChangepointFilter, conditioned: ConditionedRecording) -> Iterator[PosteriorSnapshot]:
    for observation, seen in zip(conditioned.observations, conditioned.inputs, strict=True):
        online.step(seen, boundary=observation.after_gap)
        yield PosteriorSnapshot(online.starts.copy(), np.minimum(online.posterior, 1.0))


def _offline(online: ChangepointFilter, conditioned: ConditionedRecording) -> Array:
    """Return (n,) changepoint probability given the whole recording.

    It restarts at a gap, like the filter.
    """
    parts = [
        segment_offline(
            online.lattice,
            online.hazard,
            stretch,
            prune_ratio=0.0 if len(stretch) <= MOST_EXACT else PRUNE_RATIO,
        ).changepoint_probability
        for stretch in conditioned.stretches
    ]
    return np.concatenate(parts)


def _boundary_times(observations: tuple[Observation, ...], *, continuous: bool) -> Array:
    """Return the start time [s] of a segment at each observation.

    A continuous segment begins midway to the sample before, except after a gap.
    """
    joins = [continuous and i > 0 and not one.after_gap for i, one in enumerate(observations)]
    return np.array(
        [
            0.5 * (observations[i - join].t + one.t)
            for i, (one, join) in enumerate(zip(observations, joins, strict=True))
        ]
    )

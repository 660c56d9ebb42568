"""A recording taken through conditioning and filter one observation at a time, and all of it kept.

A session keeps what it needs to go on; a report shows what was known when. The steps are those of the
session's pipeline, in the same order on the same samples, so that both arrive at the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_clients.recording import Recording
from caesura_protocol.codec import pack_samples, unpack_samples
from caesura_service.changepoint.models import Observed
from caesura_service.changepoint.offline import segment_offline
from caesura_service.changepoint.online import OnlineFilter
from caesura_service.changepoint.presets import PRESETS, TARED_BIAS_N, UNTARED_BIAS_N, Preset
from caesura_service.recordings import BATCH_SAMPLES
from caesura_service.robot import load_panda
from caesura_service.session.pipeline import EMPTY_GRIPPER_M, METRES_PER_UNIT
from caesura_service.signals import WRENCH_SOURCES, Conditioner, Layout, Observation

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# What is held against the online filter must be exact, which is quadratic. In a longer stretch, starts that
# explain less than a share of what is known are followed no further.
MOST_EXACT = 1200  # observations, two minutes
PRUNE_RATIO = 1e-12


@dataclass(frozen=True, eq=False)
class Belief:
    """What one observation left: the posterior of the current segment's start."""

    starts: Indices  # (h,) observations
    probabilities: Array  # (h,)


@dataclass(frozen=True, eq=False)
class Replay:
    """Everything that was seen and believed on the way.

    smoothed: (n,) probability that a segment starts at each observation, as the online filter had it last;
    offline: the same from the whole recording at once; boundary_t: (n,) [s] where such a start lies in time.
    """

    observations: tuple[Observation, ...]
    beliefs: tuple[Belief, ...]
    smoothed: Array
    offline: Array
    boundary_t: Array


def replay(recording: Recording, preset: str) -> Replay:
    """Run a recording. Raises KeyError for an unknown preset, ValueError for what cannot be segmented."""
    chosen = PRESETS[preset]
    conditioner = Conditioner(_layout(recording))
    observations = tuple(_conditioned(recording, conditioner))
    online = _filter(recording, chosen, tared=conditioner.tare is not None)
    beliefs = tuple(_believed(online, observations))
    return Replay(
        observations=observations,
        beliefs=beliefs,
        smoothed=np.array([online.changepoint_probability(i) for i in range(online.count)]),
        offline=_offline(online, observations),
        boundary_t=_boundary_times(observations, continuous=chosen.continuous),
    )


def _layout(recording: Recording) -> Layout:
    robot = load_panda() if "q1" in recording.columns else None
    return Layout(
        columns=recording.columns,
        wrench_source=recording.wrench_source,
        force_frame=recording.force_frame,
        metres_per_unit=METRES_PER_UNIT[recording.length_unit],
        pose_of_joints=None if robot is None else robot.flange_poses,
        wrench_of_joint_torques=None if robot is None else robot.wrenches_of_joint_torques,
    )


def _conditioned(recording: Recording, conditioner: Conditioner) -> Iterator[Observation]:
    """The observations of a recording, after the rounding that samples undergo on the wire."""
    matrix = recording.matrix()
    for seq, first in enumerate(range(0, len(matrix), BATCH_SAMPLES)):
        rows = matrix[first : first + BATCH_SAMPLES]
        batch = pack_samples(rows, recording.columns, session="file", epoch=0, seq=seq)
        yield from conditioner.push(unpack_samples(batch)).observations
    yield from conditioner.finish().observations


def _filter(recording: Recording, preset: Preset, *, tared: bool) -> OnlineFilter:
    source = WRENCH_SOURCES[recording.wrench_source]
    return preset.online(
        contact=source.contact_models,
        transport=source.transport_models,
        bias_n=TARED_BIAS_N if tared else UNTARED_BIAS_N,
    )


def _believed(online: OnlineFilter, observations: tuple[Observation, ...]) -> Iterator[Belief]:
    for observation in observations:
        online.step(_observed(observation), boundary=observation.after_gap)
        yield Belief(online.starts.copy(), np.minimum(online.posterior, 1.0))


def _offline(online: OnlineFilter, observations: tuple[Observation, ...]) -> Array:
    """(n,) changepoint probability given the whole recording; a gap begins anew, as it does online."""
    seen = [_observed(one) for one in observations]
    cuts = [0, *(i for i, one in enumerate(observations) if one.after_gap and i), len(seen)]
    parts = [
        segment_offline(
            online.lattice,
            online.hazard,
            seen[first:last],
            prune_ratio=0.0 if last - first <= MOST_EXACT else PRUNE_RATIO,
        ).changepoint_probability
        for first, last in pairwise(cuts)
    ]
    return np.concatenate(parts)


def _boundary_times(observations: tuple[Observation, ...], *, continuous: bool) -> Array:
    """[s] A continuous segment begins at the last sample of the one before, unless samples are missing."""
    joins = [continuous and i > 0 and not one.after_gap for i, one in enumerate(observations)]
    return np.array([observations[i - join].t for i, join in enumerate(joins)])


def _observed(observation: Observation) -> Observed:
    holding = np.nan
    if observation.gripper_closed is not None:
        width = observation.gripper_width
        empty = width is not None and width <= EMPTY_GRIPPER_M
        holding = float(observation.gripper_closed and not empty)
    return Observed(observation.position_base, observation.force_base, holding)

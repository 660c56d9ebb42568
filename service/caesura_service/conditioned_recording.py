"""A recording conditioned to observations, and the filter that a session would run on it.

Evaluation and report use this module, so that they use the same observations as a session.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import Recording
from caesura_protocol.rotations import upright_rotation
from caesura_service.changepoint.channel_model import UNTURNED, ModelInput
from caesura_service.changepoint.filter_interface import ChangepointFilter
from caesura_service.changepoint.preset import Preset
from caesura_service.changepoint.turn_resistance import torsion_of
from caesura_service.offline_segmentation import opening_of, parts_of
from caesura_service.segmentation.load_inertia import RESTING, Acceleration
from caesura_service.segmentation.observation_store import force_scale, holding, upright_input
from caesura_service.segmentation.opening_layout import layout_of
from caesura_service.segmentation.segmenter import filter_of
from caesura_service.signals import Conditioner, ConditioningParameters, Observation, SampleLayout


@dataclass(frozen=True, eq=False)
class ConditionedRecording:
    """The observations of a recording, equal to those of a session.

    tared: whether there was a rest from which the bias of the force was estimated.
    """

    observations: tuple[Observation, ...]
    layout: SampleLayout
    tared: bool

    @cached_property
    def inputs(self) -> list[ModelInput]:
        """The input of the segment models at each observation."""
        upright, acceleration = upright_rotation(self.layout.up), Acceleration()
        return [
            observed(one, upright, acceleration.next(one.velocity_base, after_gap=one.after_gap))
            for one in self.observations
        ]

    @property
    def stretches(self) -> list[list[ModelInput]]:
        """The inputs, divided at gaps; the filter restarts after each."""
        gaps = (i for i, observation in enumerate(self.observations) if observation.after_gap and i)
        cuts = [0, *gaps, len(self.observations)]
        return [self.inputs[first:last] for first, last in pairwise(cuts)]

    def make_filter(self, preset: Preset, *, orientation: bool = True) -> ChangepointFilter:
        """Return a filter for the signals of this recording. orientation: use it if reported.

        Raises ValueError if the preset uses no signal of the recording.
        """
        return filter_of(
            preset,
            self.layout.source,
            tared=self.tared,
            orientation=orientation and self.layout.has_orientation,
            torque=self.layout.has_torque,
        )


def condition(recording: Recording, parameters: ConditioningParameters | None = None) -> ConditionedRecording:
    """Condition all samples at once; the result equals that of batches.

    Raises ValueError for columns or values that cannot be segmented.
    """
    conditioner = Conditioner(layout_of(opening_of(recording)), parameters)
    observations: list[Observation] = []
    for number, part in enumerate(parts_of(recording)):
        if number:
            conditioner.declare_gap()
        if len(part):
            observations += conditioner.push(part).observations
    observations += conditioner.finish().observations
    return ConditionedRecording(tuple(observations), conditioner.layout, conditioner.tare is not None)


def observed(
    observation: Observation,
    upright: NDArray[np.float64] | None = None,
    acceleration: NDArray[np.float64] = RESTING,
) -> ModelInput:
    """Return an observation as the input of the segment models; upright: as in `ObservationStore`.

    acceleration: (3,) [m/s²] of the flange in the base frame.

    It does not use the rows of a session, so that tests can compare both.
    """
    force = observation.force_base / force_scale(observation)
    rotation = UNTURNED if observation.rotation is None else observation.rotation
    torsion = torsion_of(observation.force_base, observation.torque_base)
    seen = ModelInput(observation.position_base, force, holding(observation), rotation, torsion)
    return upright_input(seen, acceleration, upright)

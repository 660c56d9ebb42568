"""The signals that the baselines use: the conditioned signals at 10 Hz that the segment models use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.recording import Recording
from caesura_service.conditioned_recording import condition

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """A recording on the segmentation grid.

    t: (n,) [s]; position_base: (n, 3) [m]; velocity_base: (n, 3) [m/s], central differences; speed: (n,)
    [m/s], of the filter at 100 Hz; force_base: (n, 3) [N], tared, zeros where the hand is in the wrench;
    holding: (n,) bool, the gripper is closed on something; force_shows_contact: whether the force does;
    tared: whether there was a rest to take the force's bias from.
    """

    t: Array
    position_base: Array
    velocity_base: Array
    speed: Array
    force_base: Array
    holding: NDArray[np.bool_]
    force_shows_contact: bool
    tared: bool


def grid_signals(recording: Recording) -> Signals:
    """Bring a recording to the segmentation grid. Raises ValueError for one shorter than two steps."""
    conditioned = condition(recording)
    observations = conditioned.observations
    if len(observations) < 2:
        raise ValueError(f"{recording.name}: {len(observations)} observations, expected at least 2")
    t = np.array([o.t for o in observations])
    position_base = np.array([o.position_base for o in observations])
    shows_contact = conditioned.layout.source.contact_models
    force_base = np.array([o.force_base for o in observations])
    return Signals(
        t=t,
        position_base=position_base,
        velocity_base=np.gradient(position_base, t, axis=0),
        speed=np.array([o.speed for o in observations]),
        force_base=force_base if shows_contact else np.zeros_like(force_base),
        holding=np.array([seen.holding == 1.0 for seen in conditioned.inputs]),
        force_shows_contact=shows_contact,
        tared=conditioned.tared,
    )

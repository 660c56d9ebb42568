"""Observations of which only the vertical force matters."""

from __future__ import annotations

import numpy as np

from caesura_service.signals import Observation


def observation(index: int, force: float) -> Observation:
    """One at 10 Hz, with a vertical force [N] and nothing else."""
    return Observation(
        index=index,
        t=0.1 * index,
        position_base=np.zeros(3),
        force_base=np.array([0.0, 0.0, force]),
        orientation=None,
        joints=None,
        gripper_width=None,
        gripper_closed=None,
        velocity_base=np.zeros(3),
        speed=0.0,
        after_gap=False,
    )

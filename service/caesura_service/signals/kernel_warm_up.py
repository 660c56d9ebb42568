"""Compiles the kernels of conditioning before the first session."""

from __future__ import annotations

import numpy as np

from caesura_service.signals.conditioning import Conditioner
from caesura_service.signals.sample_layout import SIGNALS, SampleLayout


def prepare() -> None:
    """Condition a small input, so that all needed kernels are compiled."""
    conditioner = Conditioner(SampleLayout(("t", *SIGNALS["pos"], *SIGNALS["quat"], "gripper"), "none"))
    samples = np.zeros((60, 9))
    samples[:, 0], samples[:, 7] = np.arange(60) / 100.0, 1.0
    for batch in np.split(samples, 3):
        conditioner.push(batch)
    conditioner.finish()

"""Warnings about a recording that segment table and report show: values that look wrong, a still gripper."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from caesura_protocol.recording import Recording
from caesura_service.changepoint.presets import PRESETS, Preset
from caesura_service.offline_segmentation import capabilities_of
from caesura_service.signals.gripper import GripperParameters


def recording_warnings(recording: Recording, preset: str) -> tuple[str, ...]:
    """What a reader must know of the recording beside its results, a sentence or two each."""
    return (
        *(f"Warning: {doubt}" for doubt in recording.doubts),
        *_of_models(recording, PRESETS.get(preset)),
    )


def _of_models(recording: Recording, preset: Preset | None) -> Iterator[str]:
    capabilities = capabilities_of(recording)
    if preset is None or not capabilities.contact_models:
        return
    weighs = any("holding" in kind.channels for kind in preset.kinds)
    gripper = recording.signals.get("gripper")
    if weighs and gripper is not None and np.ptp(gripper) <= GripperParameters.still_range_m:
        yield (
            "The gripper never moved: it is taken to hold nothing, and a load must weigh more to be shown. "
            "Leave out the column gripper where something was held from the start."
        )

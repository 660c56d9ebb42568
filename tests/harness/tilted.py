"""A recording as it would be on an arm that is mounted otherwise: gravity stays, the base frame turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from caesura_protocol.recording import Recording
from caesura_protocol.rotations import align_signs

Array = NDArray[np.float64]


def tilted(recording: Recording, turn: Array, up: Sequence[float] | None) -> Recording:
    """Turn what is stated in the base frame by (3, 3), without joints, and state a direction for up."""
    signals = {name: values for name, values in recording.signals.items() if name not in {"q", "tau"}}
    vectors = ("pos", "force", "torque") if recording.force_frame == "base" else ("pos",)
    signals |= {name: signals[name] @ turn.T for name in vectors if name in signals}
    if "quat" in signals:
        turned = (Rotation.from_matrix(turn) * Rotation.from_quat(signals["quat"])).as_quat()
        align_signs(turned)
        signals["quat"] = turned
    stated = None if up is None else (float(up[0]), float(up[1]), float(up[2]))
    return replace(recording, signals=signals, setting=recording.setting._replace(up=stated))


def about_z(angle: float) -> Array:
    """A rotation (3, 3) about z [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

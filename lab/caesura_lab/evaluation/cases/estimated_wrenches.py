"""A simulated flange sensor's wrench as an estimate from joint torques, with no hand on the robot.

The estimate lacks the friction of the joints, by Dahl's model ("A solid friction model", 1968). The state z
of a joint is within −1 to 1, a step dq changes it by (dq − |dq| z)/s, and its friction is z times a size. It
stays where the joint stops, and is unknown at the start. No parameter of `default` was chosen on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from caesura_protocol.recording import Recording
from caesura_service.robot import load_robot

Array = NDArray[np.float64]

PRESLIDING_RAD = 0.003
SMOOTH_S = 0.05  # of the joints, whose noise would else move the state

#: Standard deviation of a joint's friction [Nm], by the name of a condition.
FRICTIONS: Mapping[str, float] = {
    "estimate without friction": 0.0,
    "joint friction 0.25 Nm": 0.25,
    "joint friction 0.5 Nm": 0.5,
}


def as_estimate(recording: Recording, friction: str, rng: np.random.Generator) -> Recording:
    """Return the recording with the friction of one of `FRICTIONS` in its wrench, declared as an estimate.

    Its wrench is that of a flange sensor, and it has joints and a robot.
    """
    assert recording.setting.robot is not None, "the simulated teacher states its robot"
    robot = load_robot(recording.setting.robot)
    q = recording.signals["q"]
    sizes = FRICTIONS[friction] * np.abs(rng.normal(size=robot.joints))
    period_s = float(np.median(np.diff(recording.t)))
    states = _dahl_states(gaussian_filter1d(q, SMOOTH_S / period_s, axis=0), rng)
    error = robot.wrenches_of_joint_torques(q, sizes * states)
    signals = dict(recording.signals)
    signals |= {"force": signals["force"] + error[:, :3], "torque": signals["torque"] + error[:, 3:]}
    return replace(recording, signals=signals, wrench_source="joint_torque_estimate", hand_on_robot="no")


def _dahl_states(q: Array, rng: np.random.Generator) -> Array:
    """Return the state of each joint at every row of q (n, joints) [rad]."""
    steps = np.diff(q, axis=0, prepend=q[:1])
    states = np.empty_like(q)
    states[0] = rng.uniform(-1.0, 1.0, q.shape[1])
    for i, step in enumerate(steps[1:], start=1):
        before = states[i - 1]
        states[i] = np.clip(before + (step - np.abs(step) * before) / PRESLIDING_RAD, -1.0, 1.0)
    return states

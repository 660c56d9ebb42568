"""Layouts of every kind, and samples with all that goes wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals import SampleLayout
from service.signals.samples import FORCE, JOINTS, POSITION, QUATERNION, TAU, TORQUE

Array = NDArray[np.float64]


def pose_of_joints(q: Array) -> tuple[Array, Array]:
    angle = q[:, 0] / 2
    zero = np.zeros(len(q))
    return np.sin(q[:, :3]), np.stack([zero, zero, np.sin(angle), np.cos(angle)], axis=1)


def wrench_of_joint_torques(q: Array, tau: Array) -> Array:
    return tau[:, :6] * np.cos(q[:, :1])


LAYOUTS = {
    "pose, flange force, gripper": SampleLayout(
        ("t", *POSITION, *QUATERNION, *FORCE, "gripper"), wrench_source="flange_sensor", force_frame="flange"
    ),
    "pose, flange wrench, gripper": SampleLayout(
        ("t", *POSITION, *QUATERNION, *FORCE, *TORQUE, "gripper"),
        wrench_source="flange_sensor",
        force_frame="flange",
    ),
    "joints and torques": SampleLayout(
        ("t", *JOINTS, *TAU),
        wrench_source="joint_torque_estimate",
        pose_of_joints=pose_of_joints,
        wrench_of_joint_torques=wrench_of_joint_torques,
    ),
    "position, joints, force in base": SampleLayout(
        ("t", "gripper", *FORCE, *POSITION, *JOINTS), wrench_source="flange_sensor", metres_per_unit=0.001
    ),
}


def awkward_samples(layout: SampleLayout, seed: int, rate_hz: float, n: int) -> Array:
    """Jitter, repeats, held poses, gaps, a flag or an opening, a start at rest or in motion."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(-5, 5) + np.arange(n) / rate_hz
    if rng.random() < 0.7:
        t[1:] += rng.uniform(-0.6, 0.6, n - 1) / rate_hz
    t[rng.random(n) < 0.03] -= 2 / rate_hz
    for gap in rng.integers(1, n, size=rng.integers(0, 3)):
        t[gap:] += rng.uniform(0.1, 0.6)
    samples = {name: np.cumsum(rng.normal(0, 1e-3, n)) for name in layout.columns}
    samples |= {name: rng.normal(0, rng.choice([0.1, 2.0]), n) for name in (*FORCE, *TAU, *TORQUE)}
    turns = rng.normal(size=4) + np.cumsum(rng.normal(0, 0.02, (n, 4)), axis=0)
    turns *= rng.choice([-1, 1], (n, 1)) / np.linalg.norm(turns, axis=1)[:, None]
    samples |= dict(zip(QUATERNION, turns.T, strict=True))
    if rng.random() < 0.5:
        last_new = np.maximum.accumulate(np.where(rng.random(n) < 12.0 / rate_hz, np.arange(n), 0))
        samples |= {
            name: samples[name][last_new] for name in (*POSITION, *QUATERNION, *JOINTS) if name in samples
        }
    squeezed = np.repeat(rng.choice([0.0, 0.0, 1.0], 8), -(-n // 8))[:n]
    samples["gripper"] = squeezed if rng.random() < 0.5 else 0.08 - 0.05 * squeezed
    return np.column_stack([t, *(samples[name] for name in layout.columns[1:])])

"""What the baselines see: the same conditioned signals at 10 Hz that our own models see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from caesura_clients.recording import Recording
from caesura_service.robot import load_panda
from caesura_service.signals import WRENCH_SOURCES, Conditioner, Layout, Observation

Array = NDArray[np.float64]
METRES_PER_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001}
EMPTY_GRIPPER_M = 0.003  # fingers that settle closer than this hold nothing


@dataclass(frozen=True)
class Signals:
    """A recording on the segmentation grid.

    t: (n,) [s]; position_base: (n, 3) [m]; velocity_base: (n, 3) [m/s], central differences; speed: (n,)
    [m/s], of the filter at 100 Hz; force_base: (n, 3) [N], tared, zeros where the hand is in the wrench;
    holding: (n,) bool, the gripper is closed on something; force_tells: whether force tells contact; tared:
    whether there was a rest to take the force's bias from.
    """

    t: Array
    position_base: Array
    velocity_base: Array
    speed: Array
    force_base: Array
    holding: NDArray[np.bool_]
    force_tells: bool
    tared: bool


def condition(recording: Recording) -> Signals:
    """Bring a recording to the segmentation grid. Raises ValueError for one shorter than two steps."""
    conditioner = Conditioner(_layout(recording))
    observed = [*conditioner.push(recording.matrix()).observations, *conditioner.finish().observations]
    if len(observed) < 2:
        raise ValueError(f"{recording.name}: {len(observed)} observations, expected at least 2")
    t = np.array([o.t for o in observed])
    position_base = np.array([o.position_base for o in observed])
    tells = WRENCH_SOURCES[recording.wrench_source].contact_models
    force_base = np.array([o.force_base for o in observed])
    return Signals(
        t=t,
        position_base=position_base,
        velocity_base=np.gradient(position_base, t, axis=0),
        speed=np.array([o.speed for o in observed]),
        force_base=force_base if tells else np.zeros_like(force_base),
        holding=np.array([_holding(o) for o in observed]),
        force_tells=tells,
        tared=conditioner.tare is not None,
    )


def _layout(recording: Recording) -> Layout:
    robot = load_panda() if "q" in recording.signals else None
    return Layout(
        columns=recording.columns,
        wrench_source=recording.wrench_source,
        force_frame=recording.force_frame,
        metres_per_unit=METRES_PER_UNIT[recording.length_unit],
        pose_of_joints=None if robot is None else robot.flange_poses,
        wrench_of_joint_torques=None if robot is None else robot.wrenches_of_joint_torques,
    )


def _holding(observation: Observation) -> bool:
    width = observation.gripper_width
    return bool(observation.gripper_closed) and (width is None or width > EMPTY_GRIPPER_M)

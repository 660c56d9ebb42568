"""Checks that a recording's positions agree with the flange positions of its joints.

A controller may report the pose of a tool centre point, ROS a pose in another base frame. Either would shift
the targets of the program unnoticed. The joints reveal it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.plausibility import METRES
from caesura_protocol.recording import Recording
from caesura_protocol.rotations import matrices_of
from caesura_service.robot import load_robot

Array = NDArray[np.float64]

COMPARED = 200  # samples
APART_M = 0.03  # median, as `caesura check` has it; arms are calibrated to some millimetres
STEADY_M = 0.01  # by which an offset in the axes of the flange may vary
HALF_TURN = np.array([-1.0, -1.0, 1.0])  # about z: base_link of ROS against the base of UR's controller


def compared(recording: Recording) -> Array:
    """Return the numbers of the samples that are compared with the joints, spread over the recording."""
    return np.linspace(0, recording.t.size - 1, min(COMPARED, recording.t.size)).astype(int)


def contradiction_of_joints(recording: Recording, assumed_arm: str) -> str | None:
    """Return text on the contradiction between positions and joints, with the remedy; None without one.

    Also None without positions or joints, or where the arm has another number of joints. assumed_arm: the arm
    of the joints where the recording states none.
    """
    signals, stated = recording.signals, recording.setting.robot
    if not {"pos", "q"} <= set(signals):
        return None
    name = stated or assumed_arm
    arm = load_robot(name)
    if signals["q"].shape[1] != arm.joints:
        return None
    chosen = compared(recording)
    flange, orientation = arm.flange_poses(signals["q"][chosen])
    position = signals["pos"][chosen] * METRES[recording.length_unit]
    apart_m = float(np.median(np.linalg.norm(position - flange, axis=1)))
    if not apart_m > APART_M:
        return None
    found = f"the positions lie {1000 * apart_m:.0f} mm (median) from the flange of {name}"
    if stated is None:
        return (
            f"{found}, which is assumed, as the joints have it. State --robot for another arm; leave the "
            "joints out where it is none of `caesura robots`."
        )
    return f"{found} as the joints have it. {_reason(position, flange, orientation)}"


def _reason(position: Array, flange: Array, orientation: Array) -> str:
    """Return the reason why positions and joints differ, with the remedy.

    position, flange: (n, 3) [m]; orientation: (n, 4).
    """
    offset = np.einsum("nji,nj->ni", matrices_of(orientation), position - flange)
    usual = np.median(offset, axis=0)
    if np.linalg.norm(offset - usual, axis=1).max() < STEADY_M:
        x, y, z = (f"{round(1000 * value) + 0:d}" for value in usual.tolist())
        return (
            f"It is a point at ({x}, {y}, {z}) mm in the axes of the flange, such as a tool centre point. "
            "The targets of the program are read as those of the flange. Take the offset off, or leave the "
            "positions out: the joints give them."
        )
    if np.linalg.norm(position - HALF_TURN * flange, axis=1).max() < STEADY_M:
        return (
            "They fit once they are turned by 180° about z, as base_link of ROS is against the base of UR's "
            "controller. Turn positions, orientations and forces in that frame by 180° about z."
        )
    return (
        "Is it another arm, another base frame, or another unit of the joints? State what it is, "
        "or leave out the positions or the joints."
    )

"""Warnings about a recording for the segment table and the report: assumptions, and suspect values.

Quaternions alone do not show the order of their columns, because both orders have the same angles of
rotation; the joints of a known arm do. Forces alone do not show their sign, because a reversed press is a
pull; a load that pulls upwards while it is lifted does. `joint_agreement` compares positions with the joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from caesura_lab.joint_agreement import compared, contradiction_of_joints
from caesura_protocol.plausibility import METRES
from caesura_protocol.recording import ASSUMED_ORDER, Recording
from caesura_protocol.rotations import matrices_of
from caesura_protocol.sample_limits import TARE_S
from caesura_protocol.up_direction import UP
from caesura_service.changepoint.presets import PRESETS, Preset
from caesura_service.offline_segmentation import capabilities_of
from caesura_service.robot import load_robot
from caesura_service.signals.gripper_events import GripperParameters

Array = NDArray[np.float64]

AGREES_RAD, DIFFERS_RAD = 0.1, 0.3
READ_ORDER = "xyzw"
WRONG_ORDERS = {  # of columns that are read as x, y, z, w: what is said of them
    "wxyz": "w, x, y, z and not in x, y, z, w, in which they are read: reorder them, or state "
    "quaternion_order wxyz in the npz file.",
    # x, y, z, w of a file that states w, x, y, z, once reordered
    "yzwx": "x, y, z, w and not in w, x, y, z, which the file states: state quaternion_order xyzw.",
}
ASSUMED_ARM = "panda"  # of seven joints, as the service reads them
CELL_S = 0.1
RISING_M_PER_S = 0.01
LIFT_M = 0.03  # by which something held must be lifted in all
UP_UNSTATED = " State --up where the arm is tilted or hangs: the z axis of its base is taken as up."
UPWARD_N = 2.0  # the bias of a sensor wanders by as much within a recording


def recording_warnings(recording: Recording, preset: str) -> tuple[str, ...]:
    """Return the warnings and assumptions that a reader needs beside the results, a sentence or two each."""
    return (
        *(f"Warning: {one}" for one in (*recording.cautions, *recording.doubts)),
        *_of_assumptions(recording),
        *_of_models(recording, PRESETS.get(preset)),
    )


def _of_assumptions(recording: Recording) -> Iterator[str]:
    """Yield the reader's assumptions, and warnings where the joints contradict quaternions or positions."""
    yield from without_confirmed(recording).assumed
    order = order_of_quaternions(recording)
    if order in WRONG_ORDERS:
        yield f"Warning: the quaternions agree with the joints in the order {WRONG_ORDERS[order]}"
    if (contradiction := contradiction_of_joints(recording, ASSUMED_ARM)) is not None:
        yield f"Warning: {contradiction}"


def without_confirmed(recording: Recording) -> Recording:
    """Return the recording without the assumption on its quaternions if its joints show their order."""
    if ASSUMED_ORDER not in recording.assumed or order_of_quaternions(recording) is None:
        return recording
    return replace(recording, assumed=tuple(one for one in recording.assumed if one != ASSUMED_ORDER))


def order_of_quaternions(recording: Recording) -> str | None:
    """Return the order of columns that agrees with the joints: `xyzw`, or one of `WRONG_ORDERS`.

    `xyzw` must agree where `wxyz` does not, a wrong order where `xyzw` does not; the first such one counts.
    None without one, without quaternions or joints, and for an arm with another number of joints.
    """
    signals, name = recording.signals, recording.setting.robot or ASSUMED_ARM
    if not {"quat", "q"} <= set(signals):
        return None
    arm = load_robot(name)
    if signals["q"].shape[1] != arm.joints:
        return None
    chosen = compared(recording)
    expected = matrices_of(arm.flange_poses(signals["q"][chosen])[1])
    read = signals["quat"][chosen]
    errors = {
        order: _disagreements(expected, read[:, [order.index(axis) for axis in "xyzw"]])
        for order in (READ_ORDER, *WRONG_ORDERS)
    }
    for one, other in ((READ_ORDER, "wxyz"), *((wrong, READ_ORDER) for wrong in WRONG_ORDERS)):
        pairs = zip(errors[one], errors[other], strict=True)
        if any(fits < AGREES_RAD and differs > DIFFERS_RAD for fits, differs in pairs):
            return one
    return None


def _disagreements(expected: Array, quaternions: Array) -> tuple[float, float]:
    """Largest angles [rad] of rotations (n, 3, 3) to quaternions (n, 4): as they are, and without a tool."""
    tools = np.swapaxes(expected, 1, 2) @ matrices_of(quaternions)
    return _largest_angle(tools), _largest_angle(np.swapaxes(tools[:1], 1, 2) @ tools)


def _largest_angle(rotations: Array) -> float:
    cosines = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0)
    return float(np.arccos(np.clip(cosines, -1.0, 1.0)).max())


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
    upward = upward_force_of_load(recording)
    if upward > UPWARD_N:
        yield (
            f"Warning: while something held is lifted, the force points upwards by {upward:.1f} N, at most "
            f"{UPWARD_N:g} N are plausible: a load pulls down. The force is taken as that of the environment "
            "on the robot. Negate force and torque where they are the robot's on the environment."
            f"{'' if recording.up else UP_UNSTATED}"
        )


def upward_force_of_load(recording: Recording) -> float:
    """Return the median zeroed upward force [N], base frame, while the gripper lifts an object; else 0."""
    signals = recording.signals
    if not {"pos", "force", "gripper"} <= set(signals):
        return 0.0
    force = signals["force"]
    if recording.force_frame == "flange":
        if "quat" not in signals:
            return 0.0
        force = np.einsum("nij,nj->ni", matrices_of(signals["quat"]), force)
    t = recording.t
    cells = np.floor((t - t[0]) / CELL_S).astype(np.int64)
    starts = np.flatnonzero(np.diff(cells, prepend=-1))
    counts = np.diff(starts, append=t.size)
    up = np.array(recording.up or UP)
    height = np.add.reduceat(signals["pos"] @ up, starts) / counts * METRES[recording.length_unit]
    against_weight = force @ up
    zeroed = against_weight - against_weight[t <= t[0] + TARE_S].mean()
    upwards = np.add.reduceat(zeroed, starts) / counts
    held = _holds(signals["gripper"][starts, 0])
    rises = np.diff(height, prepend=height[0])
    lifted = held & (rises > RISING_M_PER_S * CELL_S) & (np.diff(cells[starts], prepend=0) == 1)
    return float(np.median(upwards[lifted])) if rises[lifted].sum() > LIFT_M else 0.0


def _holds(gripper: Array) -> NDArray[np.bool_]:
    """Return whether the fingers are between open and closed, or their flag is set."""
    if set(np.unique(gripper)) <= {0.0, 1.0}:
        return np.equal(gripper, 1.0)
    opened = float(gripper.max()) - GripperParameters.travel_m
    return np.logical_and(gripper > GripperParameters.empty_m, gripper < opened)

"""Checks whether an inferred movement is a turn in place.

The check changes no boundary. The filter's model of a turn has a centre that a surface holds, within 0.2 mm a
step. A hand that turns a vessel lets the centre sway by millimetres. A filter that allows for this finds
false turns in movements on real robots, and divides them (docs/judge_appendix.md). Given the ends of a
movement, the check decides whether its rotation explains its path. From one observation to the next

    z_i − z_{i−1} = E_i (z_{i−1} − c) + s_i,    E_i = R_i R_{i−1}⁻¹ − I

with the reported point z, the centre c and the sway s. The centre is the least-squares solution, with a
normal prior about the start. A movement is a turn in place where all of this holds:

- The tool turns faster than a rest may.
- The reported point is within a tool's length of the axis: its path is at most that length for each radian.
- The centre hardly moves: Σ|s|² is at most a share of Σ b²|φ|², the squared path of a point at a hand's
  breadth b from the axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.rotations import matrices_of
from caesura_service.changepoint.default_presets import TOOL_M
from caesura_service.constants import HANDS_BREADTH_M, REST_M_PER_S
from caesura_service.segmentation.screw_motion_fit import Course

Array = NDArray[np.float64]

AXES = 3
LEAST_POSES = 4  # poses, below which a centre explains any path
LEAST_RAD_PER_S = REST_M_PER_S / HANDS_BREADTH_M
SWAY_M = 0.002  # of a step, beside which the prior of the centre counts


def is_turn_in_place(course: Course, duration_s: float, share: float) -> bool:
    """Whether the rotation explains the path of a movement that lasts `duration_s` [s].

    share: of the squared path of a point at a hand's breadth, by which the centre may move.
    """
    steps = np.diff(course.positions, axis=0)
    angles = np.linalg.norm(np.diff(course.turned, axis=0), axis=1)
    angle, path = float(angles.sum()), float(np.linalg.norm(steps, axis=1).sum())
    if len(course.positions) < LEAST_POSES or angle < LEAST_RAD_PER_S * duration_s or path > TOOL_M * angle:
        return False
    sway = sway_of(course, steps)
    return float((sway**2).sum()) <= share * HANDS_BREADTH_M**2 * float((angles**2).sum())


def sway_of(course: Course, steps: Array) -> Array:
    """Steps (n, 3) [m] of the centre of a turn; steps: (n, 3) [m] of the reported point."""
    frames = matrices_of(course.orientations)
    turns = frames[1:] @ frames[:-1].transpose(0, 2, 1) - np.eye(AXES)
    left = steps - np.matvec(turns, course.positions[:-1] - course.positions[0])
    design = -turns.reshape(-1, AXES)
    gram = design.T @ design + (SWAY_M / TOOL_M) ** 2 * np.eye(AXES)
    sway: Array = left + turns @ np.linalg.solve(gram, design.T @ left.ravel())
    return sway

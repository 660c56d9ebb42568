"""The forces with which a stroke and its rests are pressed, in the axes of the tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Segment, Vector
from caesura_service.program.forces.held_forces import decimation, force_aslant
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.program.program_segment import (
    BASE_AXES,
    PUSHES_BACK_N,
    ROUNDED_S,
    MomentAt,
    ProgramSegment,
    length,
    medians,
    observed,
)

SAME_SIDE = 0.5  # cosine between two forces; friction tilts that of a stroke, and a bias a weak one
PRESS_OBSERVATIONS = 100  # of a press that are read
STROKE_REST_S = 0.5  # a rest at either end of a stroke that is shorter than this has no force of its own


def stroke_force(stroke: ProgramSegment, moment_at: MomentAt) -> Vector | None:
    """Return the median force (3,) [N] with which a stroke is pressed; None where nothing pushes back.

    Touching and letting go are left out, as in the force of a segment. The median is taken in the tool's
    axes, because a force turns with the tool along a surface.
    """
    turn, force = pressed_force(tool_forces([stroke], moment_at))
    return None if force is None else tuple((turn @ force).tolist())


def rest_force_n(rests: Sequence[ProgramSegment], moment_at: MomentAt) -> float | None:
    """Return the median force [N] with which rests are pressed; None unless they have a force of their own.

    It is one median over all rests, so it does not depend on how they are divided. If that force pushes back,
    the time before the touch is left out.
    """
    return force_of_rests(rests, tool_forces(rests, moment_at))


def has_own_force(rests: Sequence[ProgramSegment]) -> bool:
    """Return whether rests last for `STROKE_REST_S`: in a shorter time the force still rises."""
    return bool(rests) and rests[-1].segment.tn - rests[0].segment.t0 >= STROKE_REST_S - ROUNDED_S


def stroke_aslant(stroke: ProgramSegment, moment_at: MomentAt) -> Vector | None:
    """Return the force (3,) [N] that the robot would exert as one held in another direction than the stroke.

    Of several, as in the rests beside it, the one that differs most; None without one (`force_aslant`). As
    the force of the stroke, it is that at the orientation that the tool has halfway.
    """
    turn, force = pressed_force(tool_forces([stroke], moment_at))
    if force is None:
        return None
    parts = (stroke.rests_before, (stroke,), stroke.rests_after)
    others = (force_aslant(tool_forces(part, moment_at).force, force) for part in parts)
    found = [np.array(one) for one in others if one is not None]
    if not found:
        return None
    x, y, z = (turn @ max(found, key=lambda one: length(one + force))).tolist()
    return x, y, z


class ToolForces(NamedTuple):
    """The forces on the robot at k times, in the axes of the tool."""

    axes: NDArray[np.float64]  # (k, 3, 3) of the tool, in the base frame
    force: NDArray[np.float64]  # (k, 3) [N] in them
    n: NDArray[np.float64]  # (k,) [N] its length

    def and_then(self, following: ToolForces) -> ToolForces:
        """Return these forces, followed by those at later times."""
        return ToolForces(*map(np.concatenate, zip(self, following, strict=True)))


NO_FORCES = ToolForces(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty(0))


def tool_forces(steps: Sequence[ProgramSegment], moment_at: MomentAt) -> ToolForces:
    """Return the known forces of steps, less their bases."""
    seen = [(moment_at(t), step.base) for step in steps for t in _observation_times(step.segment)]
    known = [(moment.axes, moment.force, base) for moment, base in seen if moment.force is not None]
    if not known:
        return NO_FORCES
    axes, felt, bases = map(np.array, zip(*known, strict=True))
    forces = felt - bases
    in_tool = [force @ turn for turn, force in zip(axes, forces, strict=True)]
    return ToolForces(axes, np.array(in_tool), np.array([length(force) for force in forces.tolist()]))


def pushing_force(steps: Sequence[ProgramSegment], moment_at: MomentAt) -> NDArray[np.float64] | None:
    """Return the median force (3,) [N] in the tool's axes while something pushes back, or None."""
    return median_force(tool_forces(steps, moment_at))[1]


def pressed_force(felt: ToolForces) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return `median_force` of the forces that belong to the press, not to its touch or release."""
    return median_force(felt, max(pressed_from(felt.n), PUSHES_BACK_N) if felt.n.size else PUSHES_BACK_N)


def median_force(
    felt: ToolForces, least_n: float = PUSHES_BACK_N
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return the tool's axes (3, 3) halfway, and the median force (3,) [N] in them; None without a force.

    A force below `least_n` [N] is left out.
    """
    pressed = np.flatnonzero(felt.n >= least_n)
    if not pressed.size:
        return BASE_AXES, None
    return felt.axes[pressed[pressed.size // 2]], medians(felt.force[pressed])


def force_of_rests(rests: Sequence[ProgramSegment], felt: ToolForces) -> float | None:
    """Return `rest_force_n` of rests, computed from their forces `felt`."""
    if not has_own_force(rests):
        return None
    _, force = median_force(felt, 0.0)
    if force is not None and length(force) >= PUSHES_BACK_N:
        _, force = median_force(felt)
    return None if force is None else length(force)


def _observation_times(segment: Segment) -> list[float]:
    """Return the times [s] of a segment's observations, evenly decimated to at most `PRESS_OBSERVATIONS`."""
    times = observed(segment.t0, segment.tn)
    return times[:: decimation(len(times), PRESS_OBSERVATIONS)]


def same_side(here: NDArray[np.float64] | None, there: NDArray[np.float64] | None) -> bool:
    """Whether two forces in the tool's axes press to the same side; True where one of them is None."""
    return here is None or there is None or float(here @ there) >= SAME_SIDE * length(here) * length(there)

"""Gripper actions that close in stages, or change the grip on an object that stays held.

The opening alone does not distinguish an object from a commanded stop: fingers that stop short of closed have
grasped, and fingers that open have let go. The flange and the weight show three other cases:

1. Fingers that close again where they closed first have closed in stages: the last stage grasps.
2. A closing after which nothing has a weight until the next one, and something has one then, is a stage, too.
   A lift that was found as a contact has one: only a load pulls straight down.
3. Fingers that open no wider than where they grasped keep the object if its weight still hangs on the robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.programs.held_grasps import SAME_WIDTH_M
from caesura_protocol.programs.program_gripper import SURE_SDS
from caesura_protocol.rotations import angle_between
from caesura_service.constants import GRAVITY
from caesura_service.program.interpretation.carried_loads import HANGING_N, KEPT_SHARE, hangs
from caesura_service.program.interpretation.joined_strokes import LEAST_TURN_RAD, OUT_M
from caesura_service.program.program_segment import (
    Context,
    GripperAction,
    ProgramSegment,
    length,
    observed,
)


def with_regrips(steps: Sequence[ProgramSegment], context: Context) -> Sequence[GripperAction]:
    """Return the gripper actions of a context; a stage of a closing is a `close`, an easing is a `grasp`.

    An easing opens the fingers and lets nothing go. steps: all known segments around the actions.
    """
    read: list[GripperAction] = []
    grasped: GripperAction | None = None  # since which an object is held
    for number, grip in enumerate(context.grips):
        following = context.grips[number + 1 : number + 3]
        if grip.kind == "grasp" and grasped is None and _is_stage(grip, following, steps, context):
            grip = replace(grip, kind="close")
        elif grip.kind == "release" and grasped is not None:
            is_kept = _is_kept(grasped, grip, following[:1], steps, context)
            grip = replace(grip, kind="grasp") if is_kept else grip
        read.append(grip)
        grasped = (grasped or grip) if grip.kind == "grasp" else None
    return read


def _is_stage(
    grip: GripperAction,
    following: Sequence[GripperAction],
    steps: Sequence[ProgramSegment],
    context: Context,
) -> bool:
    """Return whether a closing holds nothing before the fingers close again.

    following: the next two actions, as far as they are known.
    """
    if not following or following[0].kind != "grasp":
        return False
    again_t, *later_t = [one.t for one in following]
    if _stands(grip.t, again_t, context):
        return True
    after = _weights(steps, again_t, later_t[0] if later_t else np.inf)
    lifts = any(
        step.touches and hangs(step.segment.force, context.up) for step in _between(steps, grip.t, again_t)
    )
    return not lifts and not any(_weights(steps, grip.t, again_t)) and any(after)


def _stands(t0: float, tn: float, context: Context) -> bool:
    """Return whether the flange stays where it is between two times [s]."""
    first, *others = [context.moment_at(t) for t in observed(t0, tn)]
    return all(
        math.dist(one.position, first.position) < OUT_M
        and (
            one.orientation is None
            or first.orientation is None
            or angle_between(one.orientation, first.orientation) < LEAST_TURN_RAD
        )
        for one in others
    )


def _weights(steps: Sequence[ProgramSegment], t0: float, tn: float) -> Iterator[float]:
    """Yield the weights [N] of the loads between two times [s], 0 for one that may be nothing."""
    for step in _between(steps, t0, tn):
        kg, sd_kg = step.segment.load_kg or 0.0, step.segment.load_sd_kg or 0.0
        yield GRAVITY * kg if kg > SURE_SDS * sd_kg else 0.0


def _is_kept(
    grasped: GripperAction,
    opened: GripperAction,
    following: Sequence[GripperAction],
    steps: Sequence[ProgramSegment],
    context: Context,
) -> bool:
    """Return whether fingers that open keep what they grasped: its weight hangs on the robot afterwards.

    following: the next action, if it is known.
    """
    if opened.width is None or grasped.width is None or opened.width > grasped.width + SAME_WIDTH_M:
        return False
    weight_n = max(_weights(steps, grasped.t, opened.t), default=0.0)
    if weight_n < HANGING_N:
        return False
    empty = [step.segment for step in _between(steps, -np.inf, grasped.t) if step.segment.contact == "free"]
    base = _force(empty[-1].t0, empty[-1].tn, context) if empty else np.zeros(3)
    for step in steps:
        t0, tn = max(step.segment.t0, opened.t), min([step.segment.tn, *(one.t for one in following)])
        x, y, z = (_force(t0, tn, context) - base).tolist()
        if hangs((x, y, z), context.up) and length((x, y, z)) > KEPT_SHARE * weight_n:
            return True
    return False


def _between(steps: Sequence[ProgramSegment], t0: float, tn: float) -> Iterator[ProgramSegment]:
    """Yield the steps whose middle lies between two times [s]."""
    for step in steps:
        if t0 < 0.5 * (step.segment.t0 + step.segment.tn) < tn:
            yield step


def _force(t0: float, tn: float, context: Context) -> NDArray[np.float64]:
    """Return the median force (3,) [N] between two times [s]; zeros where it is unknown."""
    forces = context.forces(observed(t0, tn) if tn > t0 else [])
    return context.median(forces) if len(forces) else np.zeros(3)

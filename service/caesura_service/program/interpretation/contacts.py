"""Determines which steps are in contact, and where the touched object pushes back.

- A contact changes the force. A step that does not change it is no contact, and continues the contact state
  before it. A step after a contact that keeps its force, without moving away, is still in contact. A sensor
  drifts by newtons within a recording, so a press is the difference from that drift.
- A held object keeps its weight: if the force changes and stays changed, the object touches something. So
  does a movement before a contact that is pushed back all the way.
- An object that hangs on the fingers as they open falls: its weight is gone, and nothing is touched.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.program.forces.sensor_bias import base_after
from caesura_service.program.interpretation.carried_loads import HANGING_N, KEPT_SHARE, hangs
from caesura_service.program.interpretation.joined_strokes import DECAY_REACH_M, OUT_M, OUT_SHARE
from caesura_service.program.program_segment import (
    ARRIVES_M,
    PUSHES_BACK_N,
    TOUCHED_S,
    UNLIKE_N,
    Context,
    ProgramSegment,
    carried_weight,
    direction,
    holds,
    length,
    observed,
)

LASTING = 5  # observations over which a force is averaged


def as_touching(before: ProgramSegment | None, step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a step in contact with the force before it as its base.

    A step that adds less than `PUSHES_BACK_N` is no contact, unless it rests after one. It continues the
    contact state before it. After a contact, and after an object has fallen, it is a carry if the fingers
    hold something, or else a movement in the air.
    """
    if before is None or not step.touches:
        return step
    fallen = _fallen_weight(before, step, context)
    step = replace(step, base=_without(fallen, base_after(before, context)))
    if before.segment.contact == "transport" and holds(step, context.grips):
        step = _pressed_beyond_load(step, context)
    if length(step.force) >= PUSHES_BACK_N or (before.touches and step.segment.motion == "steady"):
        return step
    if before.touches or fallen.any():
        return step.read_as("transport" if holds(step, context.grips) else "free")
    return step.read_as(before.segment.contact)


def _pressed_beyond_load(step: ProgramSegment, context: Context) -> ProgramSegment:
    """Return a contact with a load, with the force that was pressed beyond its base.

    The sensor measures the weight of the load as well. It cancels a part of the press, so the press proper is
    where the difference from the base is large, and not the force itself.
    """
    forces = _felt(step, context)
    if not len(forces):
        return step
    beyond = np.linalg.norm(forces - step.base, axis=1)
    held: tuple[float, ...] = tuple(context.median(forces[beyond >= pressed_from(beyond)]).tolist())
    return replace(step, segment=step.segment.model_copy(update={"force_held": held}))


def still_touching(
    contact: ProgramSegment, last: ProgramSegment, step: ProgramSegment, context: Context
) -> ProgramSegment:
    """Return a step after a contact as a contact, where its force lasts and the tool does not leave.

    A step in which the held load becomes heavier has lifted it off its support: it is unchanged. The force
    may turn: a step at the same place is in contact with a force of `UNLIKE_N` in any direction, which is not
    that of a load that is gone. Once the fingers have let go of a load in the contact, its base has
    none. last: the last step kept.
    """
    base = _without(_fallen_weight(last, step, context), base_after(last, context))
    if _has_let_go(contact, step, context):
        base = _without_load(base, context)
    normal, forces = direction(replace(contact, base=base).force), _felt(step, context)
    changed = _changed(forces, base, context)
    if holds(step, context.grips) and _is_lifted(step, changed, context):
        return step
    touching = _touching(normal, PUSHES_BACK_N, base, step, forces, context)
    if touching.touches or step.segment.contact != "free" or step.moved_m >= DECAY_REACH_M:
        return touching
    if length(_changed(forces, _without_load(base, context), context)) < UNLIKE_N:
        return touching
    return _touching(direction(changed), UNLIKE_N, base, step, forces, context)


def _has_let_go(contact: ProgramSegment, step: ProgramSegment, context: Context) -> bool:
    """Return whether the fingers let go in a contact, before a step in which they hold nothing."""
    began, ended = contact.segment.t0, step.segment.t0
    opened = any(grip.kind == "release" and began < grip.t <= ended for grip in context.grips)
    return opened and holds(step, context.grips) is False


def _without_load(base: Vector, context: Context) -> Vector:
    """Return a base [N] without the weight that hangs on it, as of a load that a hand has taken over."""
    up = np.array(context.up)
    return _without(float(np.array(base) @ up) * up, base) if hangs(base, context.up) else base


def set_down(
    last: ProgramSegment, step: ProgramSegment, ahead: ProgramSegment | None, context: Context
) -> ProgramSegment:
    """Return a carry, or a rest or a short movement before a contact, as a contact if its force changes and
    stays changed.

    A load keeps its weight, and in the air nothing resists a movement. So a change of `UNLIKE_N`, more than a
    bias can account for, is a touch. In a rest directly before a contact, `PUSHES_BACK_N` along its force is
    one, as in a rest after it. So it is in a movement below `DECAY_REACH_M`: a bias hardly changes there. A
    load that weighs more has been lifted off its support: no touch.
    """
    segment = step.segment
    waits = segment.kind == "steady" or (segment.kind == "motion" and may_press_in(step))
    arrives = waits and ahead is not None and ahead.touches
    if last.segment.contact != segment.contact or not (segment.contact == "transport" or arrives):
        return step
    base = base_after(last, context)
    forces = _felt(step, context)
    changed = _changed(forces, base, context)
    if _is_lifted(step, changed, context):
        return step
    touching = _touching(direction(changed), UNLIKE_N, base, step, forces, context)
    stays = segment.motion == "steady" or step.moved_m < DECAY_REACH_M
    if touching.touches or not stays or ahead is None or not ahead.touches:
        return touching
    normal = direction(replace(ahead, base=base).force)
    return _touching(normal, PUSHES_BACK_N, base, step, forces, context)


def _fallen_weight(last: ProgramSegment, step: ProgramSegment, context: Context) -> NDArray[np.float64]:
    """Return the weight (3,) [N] of what falls out of the fingers from a carry to a step; 0 if nothing does.

    An object that is set down has lost most of its weight to its support before the fingers open.
    """
    weight = carried_weight(last.segment, context)
    opened = [grip.t for grip in context.grips if last.segment.t0 < grip.t < step.segment.tn]
    if length(weight) < HANGING_N or not opened or holds(step, context.grips) is not False:
        return np.zeros(3)
    hung = context.forces([opened[0] - TOUCHED_S]) - _without(weight, base_after(last, context))
    falls = len(hung) and float(hung[0] @ weight) > KEPT_SHARE * float(weight @ weight)
    return weight if falls else np.zeros(3)


def _without(weight: NDArray[np.float64], base: Vector) -> Vector:
    """Return a force [N] without a weight (3,) [N]."""
    x, y, z = (np.asarray(base) - weight).tolist()
    return x, y, z


def _changed(forces: NDArray[np.float64], base: Vector, context: Context) -> NDArray[np.float64]:
    """Return the difference (3,) [N] of the median of forces (n, 3) from a base; 0 if none is known."""
    return context.median(forces) - base if len(forces) else np.zeros(3)


def _is_lifted(step: ProgramSegment, changed: NDArray[np.float64], context: Context) -> bool:
    """Return whether a change (3,) [N] of a step's force shows that it carries a heavier load than before."""
    x, y, z = changed.tolist()
    return step.segment.contact == "transport" and hangs((x, y, z), context.up)


def _felt(step: ProgramSegment, context: Context) -> NDArray[np.float64]:
    """Return the known forces (n, 3) [N] at the observations of a step."""
    return context.forces(observed(step.segment.t0, step.segment.tn))


def may_press_in(step: ProgramSegment) -> bool:
    """Whether a movement is shorter than `ARRIVES_M`, so that it may press something in.

    Its contact state then depends on the force before it.
    """
    return step.moved_m < ARRIVES_M


def _touching(
    normal: NDArray[np.float64],
    least_n: float,
    base: Vector,
    step: ProgramSegment,
    forces: NDArray[np.float64],
    context: Context,
) -> ProgramSegment:
    """Return a step as a contact if its force along a normal stays above a base, and the tool stays.

    least_n: how far it stays above the base [N].
    """
    leaves = float(step.moved @ normal) > max(OUT_M, OUT_SHARE * step.moved_m)
    if leaves or not len(forces) or _least_lasting((forces - base) @ normal) < least_n:
        return step
    held: tuple[float, ...] = tuple(context.median(forces).tolist())
    return replace(step.read_as("contact", force_held=held), base=base)


def _least_lasting(pushes: NDArray[np.float64]) -> float:
    """Return the least mean [N] over `LASTING` observations; one alone has the full sensor noise."""
    count = min(LASTING, len(pushes))
    sums = np.sum([pushes[k : len(pushes) - count + 1 + k] for k in range(count)], axis=0)
    return float(sums.min()) / count

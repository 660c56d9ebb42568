"""Loads that go over to a support where no gripper is known: what is set down is not pressed.

With a gripper, the fingers that let go show a set-down. Without one, only the force shows it: the weight of
the carry goes, and does not come back. Until it has gone, a part of it rests on the support. Only a force
beyond the whole weight is a press.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby, takewhile

import numpy as np
from numpy.typing import NDArray

from caesura_service.constants import GRAVITY
from caesura_service.program.forces.pressed_force import pressed_from
from caesura_service.program.interpretation.carried_loads import (
    HANGING_N,
    KEPT_SHARE,
    as_carry_of,
    is_weighed_well,
)
from caesura_service.program.program_segment import (
    PUSHES_BACK_N,
    TOUCHED_S,
    Context,
    ProgramSegment,
    average,
    holds,
    observed,
    parts_at,
)

Array = NDArray[np.float64]


def with_supported_loads(kept: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; of a contact in which a load goes over to a support, only what presses it is one.

    Before that, and where nothing presses it, the contact is a carry that ends on the support.
    """
    read: list[ProgramSegment] = []
    place = 0
    for touches, run in groupby(kept, key=lambda step: step.touches):
        steps, before = list(run), kept[:place]
        place += len(steps)
        after = kept[place] if place < len(kept) else None
        weight = _gone_weight(before, steps, after, context) if touches else np.zeros(3)
        read += [part for step in steps for part in _parts(step, weight, context)] if weight.any() else steps
    return read


def _gone_weight(
    before: Sequence[ProgramSegment],
    contact: Sequence[ProgramSegment],
    after: ProgramSegment | None,
    context: Context,
) -> Array:
    """Return the weight (3,) [N] of the carry before a contact if a support bears it at the end; else 0.

    0 too where the fingers are known, or where an operator has set a kind. before, after: the steps beside
    the contact.
    """
    known = any(holds(step, context.grips) is not None or step.segment.corrected for step in contact)
    carry = list(takewhile(lambda step: step.segment.contact == "transport", reversed(before)))
    weighed = [step for step in carry if is_weighed_well(step)]  # a shorter one may be a pull
    goes_on = after is not None and after.segment.contact == "transport"
    if known or goes_on or not weighed:
        return np.zeros(3)
    weight: Array = -GRAVITY * average(weighed, "load_kg") * np.array(context.up)
    weight_n = float(np.linalg.norm(weight))
    is_borne = any(n >= KEPT_SHARE * weight_n for n in _borne_last(contact[-1], after, context))
    return weight if weight_n >= HANGING_N and is_borne else np.zeros(3)


def _borne_last(contact: ProgramSegment, after: ProgramSegment | None, context: Context) -> Iterator[float]:
    """Yield what a support bears [N] at the end of a contact, and as a rest after it begins."""
    ends = [observed(contact.segment.t0, contact.segment.tn)[-1]]
    if after is not None and after.segment.motion == "steady":
        ends.append(observed(after.segment.t0, after.segment.tn)[0])
    yield from ((context.forces(ends) - contact.base) @ np.array(context.up)).tolist()


def _parts(step: ProgramSegment, weight: Array, context: Context) -> Iterator[ProgramSegment]:
    """Yield the parts of a contact before a press of what is set down, and the press; weight: (3,) [N]."""
    times, changed = observed(step.segment.t0, step.segment.tn), _beside_base(step, context)
    up = np.array(context.up)
    supported = np.clip(changed @ up, 0.0, np.linalg.norm(weight))
    beyond = np.linalg.norm(changed - supported[:, None] * up, axis=1)
    held = np.minimum(beyond[1:], beyond[:-1]) >= PUSHES_BACK_N  # an impact is over before the second
    if len(changed) < len(times) or not held.any():
        yield _set_down(step, supported, weight, context)
        return
    first = int(np.argmax(held))
    if first:
        before, step = parts_at(step, [times[first] - TOUCHED_S], context.moment_at)
        yield _set_down(before, supported[:first], weight, context)
    x, y, z = (np.array(step.base) - weight).tolist()
    pressed = beyond[first:] >= pressed_from(beyond[first:])
    force = context.median(changed[first:][pressed]) + step.base
    segment = step.segment.model_copy(update={"force_held": tuple(force.tolist())})
    yield replace(step, segment=segment, base=(x, y, z))


def _set_down(step: ProgramSegment, supported: Array, weight: Array, context: Context) -> ProgramSegment:
    """Return a contact as a carry that ends on the support; as free if most of the load is gone before.

    supported: (n,) [N] what the support bears; weight: (3,) [N].
    """
    if len(supported) and supported[0] >= KEPT_SHARE * np.linalg.norm(weight):
        return step.read_as("free")
    x, y, z = weight.tolist()
    return as_carry_of((x, y, z), step, context)


def _beside_base(step: ProgramSegment, context: Context) -> Array:
    """Return the known forces (n, 3) [N] of a step, less its base."""
    return context.forces(observed(step.segment.t0, step.segment.tn)) - step.base

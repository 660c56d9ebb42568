"""Estimates the bias of the force sensor during a contact, from the force in the air before and after.

Until the tool has left the contact, the bias is the force before it. It changes with time and with the
position, because a tool's weight is never compensated exactly. So it is linear in both, fitted by ridge
regression to the last two seconds before a contact and the first two after it. The mass of the tool, whose
inertia the sensor measures, is fitted with it. Observations that already push back before the contact, or
before the next one, are left out, and those that still push back after the contact before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.messages import Segment, Vector
from caesura_service.constants import TARED_BIAS_N
from caesura_service.program.program_segment import (
    ENDS,
    OBSERVED_S,
    PUSHES_BACK_N,
    Context,
    Moment,
    MomentAt,
    ProgramSegment,
    carried_weight,
    length,
    observed,
)

BASE_S = 1.0  # before a contact, over which the force is what the sensor makes up
MOST_WANDER_N = 3.0 * TARED_BIAS_N  # of what a sensor makes up, from before a contact to after it
AROUND_S = 2.0  # before and after a contact
TOUCHING_S, LETTING_GO_S = 0.1, 0.3  # of that, what may lie in the contact: a boundary is only so exact
AT_TOUCH_M, AT_TOUCH_S = 0.003, 0.3  # so near to the end of a way, and so late, something may be touched
WANDER_M, WANDER_S = 0.15, 10.0  # over which it wanders by about `WANDER_N`
WANDER_N, OFFSET_N = 1.0, 3.0  # standard deviations of its wander, and of its size beside the force before
SPRUNG_SHARE = 0.2  # of the change of a spring's force on a way
TOOL_KG = 1.0  # standard deviation of the mass below the sensor that is not compensated
READ_VARIANCE = 0.25  # [N²] of a reading: its noise in motion lasts over several readings

Array = NDArray[np.float64]


def with_bases(kept: Sequence[ProgramSegment], context: Context) -> list[ProgramSegment]:
    """Return the steps; the bias of contacts is fitted to the force on both sides of them.

    If the fingers move, or a spring acts, the force after a contact has another cause. It is not known either
    before the tool has left. The bias is then that at the end of the way to the contact, fitted to its force
    alone. If the change exceeds a sensor's bias, the base stays the force before the contact.
    """
    based: list[ProgramSegment] = []
    for touches, run in groupby(kept, key=lambda step: step.touches):
        steps, place = list(run), len(based)
        based += steps
        if not touches or place == 0:
            continue
        before, after = kept[place - 1].segment, kept[len(based)].segment if len(based) < len(kept) else None
        bias = _bias(before, after, steps[0].base, context)
        for k, step in enumerate(steps, start=place):
            based[k] = replace(step, base=bias(0.5 * (step.segment.t0 + step.segment.tn)))
    return based


def _bias(
    before: Segment, after: Segment | None, base: Vector, context: Context
) -> Callable[[float], Vector]:
    """Return a function of the time [s] for the bias [N] in a contact between two segments; after: if any."""
    if _sprung(before, context):
        return lambda t: base
    if after is None or before.contact != after.contact or context.fingers_move(before.tn, after.t0):
        last = observed(before.t0, before.tn)[-1]
        touched = bias_between(before, None, base, base, context.moment_at)(last)
        return lambda t: touched
    left = _force_at_start(after, context)
    if math.dist(left, base) >= MOST_WANDER_N or _sprung(after, context):
        return lambda t: base
    return bias_between(before, after, base, left, context.moment_at)


def base_after(before: ProgramSegment, context: Context) -> Vector:
    """Return the force [N] before the contact that a step belongs to, or that follows the step.

    That of a way against a spring is the one nearest to the carried weight: its median or one of its ends.
    """
    if before.touches:
        return before.base
    forces = [np.array(_force_at_end(before.segment, context)), *_sprung(before.segment, context)]
    weight = carried_weight(before.segment, context)
    x, y, z = min(forces, key=lambda force: length(force - weight)).tolist()
    return x, y, z


def _sprung(way: Segment, context: Context) -> tuple[Array, ...]:
    """Return the forces [N] at both ends of a way on which the force rises or fades, as a spring's does.

    Empty for another way. A sensor makes up less than `MOST_WANDER_N`. At a touch the force changes at one
    end only. A spring's force in the middle is apart from that at both ends by `SPRUNG_SHARE` of the change.
    """
    times = observed(way.t0, way.tn)
    low, high = (len(times) - ENDS) // 2, len(times) - ENDS
    read = [context.forces(times[at : at + ENDS]) for at in (0, low, high)] if len(times) >= 2 * ENDS else []
    if not read or min(map(len, read)) < ENDS:
        return ()
    first, middle, last = map(context.median, read)
    changed = length(last - first)
    apart = min(length(middle - first), length(middle - last))
    return (first, last) if changed >= MOST_WANDER_N and apart >= SPRUNG_SHARE * changed else ()


def bias_between(
    before: Segment, after: Segment | None, base: Vector, left: Vector, moment_at: MomentAt
) -> Callable[[float], Vector]:
    """Return a function of the time [s] for the bias [N] between two segments in the air.

    after: None if only the one before is known; base, left: the force [N] before the contact, and after it.
    """
    origin = moment_at(observed(before.t0, before.tn)[-1])
    approach = observed(max(before.t0, before.tn - AROUND_S), before.tn - TOUCHING_S)
    times = [
        t
        for t in _in_air(approach, base, moment_at)
        if t < before.tn - AT_TOUCH_S or math.dist(moment_at(t).position, origin.position) >= AT_TOUCH_M
    ]
    if after is not None:
        leaving = observed(after.t0 + LETTING_GO_S, min(after.t0 + AROUND_S, after.tn))
        times += [t for t in _in_air(leaving, left, moment_at) if after.t0 < t < after.tn]
    known = [
        (_row(t, moment, before.tn, origin), moment.force, acceleration(t, moment_at))
        for t, moment in zip(times, map(moment_at, times), strict=True)
        if moment.force is not None
    ]
    if not known:
        return lambda t: base
    rows, forces = np.array([row for row, _, _ in known]), np.array([force for _, force, _ in known])
    slopes = _fitted(rows, forces - base, np.array([shaken for _, _, shaken in known]))

    def at(t: float) -> Vector:
        x, y, z = (np.asarray(base) + _row(t, moment_at(t), before.tn, origin) @ slopes).tolist()
        return x, y, z

    return at


def _fitted(rows: Array, forces: Array, accelerations: Array) -> Array:
    """Return the slopes (5, 3) [N] of the bias, fitted to forces (n, 3) [N] by ridge regression.

    rows: (n, 5) regressors; accelerations: (n, 3) [m/s²]. The slopes are linear in the tool's mass, so it is
    fitted to what they leave of the forces.
    """
    precision = rows.T @ rows + READ_VARIANCE * np.diag([OFFSET_N**-2.0, *[WANDER_N**-2.0] * 4])
    gain = np.linalg.solve(precision, rows.T)
    left_n, left_m_per_s2 = (values - rows @ (gain @ values) for values in (forces, accelerations))
    weight = np.vdot(accelerations, left_m_per_s2) + READ_VARIANCE / TOOL_KG**2
    mass_kg = -np.vdot(accelerations, left_n) / weight
    slopes: Array = gain @ (forces + mass_kg * accelerations)
    return slopes


def acceleration(t: float, moment_at: MomentAt) -> Array:
    """Return the acceleration (3,) [m/s²] at an observation, from the positions beside it."""
    before, here, after = (np.array(moment_at(t + OBSERVED_S * k).position) for k in (-1, 0, 1))
    change: Array = (after - here) - (here - before)
    return change / OBSERVED_S**2


def _in_air(times: Sequence[float], base: Vector, moment_at: MomentAt) -> Sequence[float]:
    """Return those times [s] from the first to the last one without a push; all if every one is pushed."""
    free = [k for k, t in enumerate(times) if not _pushes(moment_at(t).force, base)]
    return times[free[0] : free[-1] + 1] if free else times


def _pushes(force: Vector | None, base: Vector) -> bool:
    return force is not None and math.dist(force, base) >= PUSHES_BACK_N


def _row(t: float, moment: Moment, since: float, origin: Moment) -> Sequence[float]:
    """Return the regressors (5,) of the bias: 1, the displacement from an origin, and the time since
    `since`.
    """
    way = (np.subtract(moment.position, origin.position) / WANDER_M).tolist()
    return [1.0, *way, (t - since) / WANDER_S]


def _force_at_end(segment: Segment, context: Context) -> Vector:
    """Return the median force (3,) [N] of a segment's last second; 0 where no force is known.

    The very end may lie in the contact and is then left out.
    """
    return _free_force(observed(segment.t0, segment.tn)[::-1], context)


def _force_at_start(segment: Segment, context: Context) -> Vector:
    """Return the median force (3,) [N] of a segment's first second; 0 where no force is known."""
    return _free_force(observed(segment.t0, segment.tn), context)


def _free_force(times: Sequence[float], context: Context) -> Vector:
    """Return the median force (3,) [N] over `BASE_S`; 0 where no force is known.

    The first of the times may lie in a contact: the second begins after it.
    """
    count = round(BASE_S / OBSERVED_S)
    forces = context.forces(times[: 2 * count])
    if not len(forces):
        return 0.0, 0.0, 0.0
    apart = np.linalg.norm(forces - context.median(forces), axis=1) >= PUSHES_BACK_N
    begun = 0 if apart.all() else int(np.argmin(apart))
    x, y, z = context.median(forces[begun : begun + count]).tolist()
    return x, y, z

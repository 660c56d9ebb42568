"""Dips of the speed within a movement: corners, and dips that annotators of real recordings mark as optional.

The annotators' rule (docs/annotation.md): a corner is a turn of more than 45° through a dip below 0.6 of the
lesser peak beside it. A turn is read twice. Where the readings contradict each other, or lie within 5° of the
limit, the corner is optional. So is every other dip that is visible.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from caesura_lab.teacher.motion_profiles import Array

CORNER_DEG, CORNER_DIP, CORNER_LOOK_S = 45.0, 0.6, 0.25
UNCERTAIN_DEG = 5.0  # this close to the limit an annotator leaves a turn open
VISIBLE_DIP = 0.9  # of the lesser peak; nine of ten optional dips of the open annotations are deeper
SMALL_M_PER_S, SMALL_M = 0.025, 0.010  # of corrections: slower or shorter than any other movement
SLOW_M_PER_S = 0.040  # a movement whose smoothed speed stays below is slow
SLOW_PEAK_M_PER_S = 0.008  # least lesser peak beside a dip of a slow movement
SLOW_LOOK_S = 0.6  # over which the turn of a slow movement is read


class Dip(NamedTuple):
    """The lowest speed between two peaks: at a tick; a `corner` or a `dip`; counted, or optional."""

    tick: int
    kind: Literal["corner", "dip"]
    optional: bool


def ideal_dips(velocity: Array, dt: float) -> list[Dip]:
    """Dips of a movement of ideal people; velocity (n, 3) [m/s], smoothed, one a tick of dt [s]."""
    look, dips = round(CORNER_LOOK_S / dt), []
    for tick in clear_minima(np.linalg.norm(velocity, axis=1), CORNER_DIP, SMALL_M_PER_S):
        corner = turn_deg(velocity, tick, look) > CORNER_DEG
        dips.append(Dip(tick, "corner" if corner else "dip", not corner))
    return dips


def guided_dips(velocity: Array, dt: float) -> list[Dip]:
    """Dips of a movement that may be slow; a corner has 10 mm of way on either side."""
    speed = np.linalg.norm(velocity, axis=1)
    slow = bool(speed.max() < SLOW_M_PER_S)
    least = SLOW_PEAK_M_PER_S if slow else SMALL_M_PER_S
    look = round((SLOW_LOOK_S if slow else CORNER_LOOK_S) / dt)
    minima = clear_minima(speed, CORNER_DIP, least)
    befores, afters = [0, *minima[:-1]], [*minima[1:], len(speed)]
    arounds = zip(befores, minima, afters, strict=True) if minima else ()
    turns = [_readings(velocity, speed, around, look) for around in arounds]
    turned = [
        tick for tick, turn in zip(minima, turns, strict=True) if max(turn) > CORNER_DEG - UNCERTAIN_DEG
    ]
    edges = [0, *turned, len(speed)]
    legs = [np.linalg.norm(np.sum(velocity[a:b], axis=0) * dt) for a, b in pairwise(edges)]
    long = {tick for tick, beside in zip(turned, pairwise(legs), strict=True) if min(beside) >= SMALL_M}
    dips = []
    for tick, turn in zip(minima, turns, strict=True):
        sure = tick in long and min(turn) > CORNER_DEG + UNCERTAIN_DEG
        dips.append(Dip(tick, "corner" if tick in turned else "dip", not sure))
    near = round(CORNER_LOOK_S / dt)
    visible = clear_minima(speed, VISIBLE_DIP, least)
    dips += [Dip(tick, "dip", True) for tick in visible if all(abs(tick - other) > near for other in minima)]
    return sorted(dips)


def _readings(velocity: Array, speed: Array, around: tuple[int, int, int], look: int) -> tuple[float, float]:
    """The turn [°] at a dip, between the peaks beside it and over `look` ticks on both sides.

    around: the dip before, this one, the dip after.
    """
    first, tick, last = around
    before = first + int(np.argmax(speed[first:tick])) if tick > first else tick
    after = tick + int(np.argmax(speed[tick:last]))
    return angle_deg(velocity[before], velocity[after]), turn_deg(velocity, tick, look)


def clear_minima(speed: Array, share: float, least: float) -> list[int]:
    """Ticks of the lowest speed between two peaks, below a share of the lesser one, which exceeds `least`."""
    minima = []
    peak, low = 0.0, 0
    for tick, value in enumerate(speed):
        if value < speed[low]:
            low = tick
        elif speed[low] < share * min(peak, value) and min(peak, value) > least:
            minima.append(low)
            peak, low = float(value), tick
        if value > peak:
            peak, low = float(value), tick
    return minima


def turn_deg(velocity: Array, tick: int, look: int) -> float:
    """The angle [°] between the ways of `look` ticks before and after one."""
    return angle_deg(
        velocity[max(0, tick - look) : tick].sum(axis=0), velocity[tick : tick + look].sum(axis=0)
    )


def angle_deg(one: Array, other: Array) -> float:
    """[°]; 0 where one of them has no length."""
    size = np.linalg.norm(one) * np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(one @ other / size, -1.0, 1.0)))) if size > 0.0 else 0.0

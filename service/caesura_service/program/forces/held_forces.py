"""Finds what else was pressed in a press: a weaker or stronger force, or one in another direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import overload

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_protocol.messages import Vector
from caesura_protocol.programs.checks.fidelity import UNEVEN_SHARE
from caesura_service.program.program_segment import PUSHES_BACK_N, UNLIKE_N, MomentAt, length

HELD_OBSERVATIONS = 10  # in a row, one second, from which on a weaker force was held on purpose
ASIDE_OBSERVATIONS = 5  # likewise of one in another direction, half a second: a touch has that of its press
VARIED_OBSERVATIONS = 20  # two seconds in all, from which on a weaker force is no touch or release
SLACK_OBSERVATIONS = 3  # the shortest segment, for which a press slackens or is over
MOST_OBSERVATIONS = 1200  # of a press whose forces are compared: two minutes, or evenly spread
LEAN_COSINE = math.cos(math.radians(30.0))  # between two forces, up to which they press in two directions

Array = NDArray[np.float64]


def decimation(observations: int, most: int = MOST_OBSERVATIONS) -> int:
    """Return the step with which at most `most` of some observations are read; at least 1."""
    return max(-(-observations // most), 1)


@overload
def other_force_n(newton: float) -> float: ...
@overload
def other_force_n(newton: Array) -> Array: ...
def other_force_n(newton: float | Array) -> float | Array:
    """Return by how much [N] another force differs from one of `newton` [N] in the same press.

    A sensor makes up less than `PUSHES_BACK_N` meanwhile, and a robot keeps a force within `UNEVEN_SHARE`.
    """
    return np.maximum(PUSHES_BACK_N, UNEVEN_SHARE * newton)


def forces_felt(base: Vector, times: Sequence[float], moment_at: MomentAt) -> Array:
    """Return the known forces (n, 3) [N] of a contact at times [s], `MOST_OBSERVATIONS` of them at most.

    base: the force [N] before the contact. times: of observations, none in a gap: there the nearest one would
    count again and again.
    """
    forces = (moment_at(t).force for t in times[:: decimation(len(times))])
    return np.array([one for one in forces if one is not None]).reshape(-1, 3) - base


def weaker_force(
    felt: Array, force: Vector, observations: int, least_apart_n: float = UNLIKE_N
) -> float | None:
    """Return the size [N] of a force that was pressed with, where it is another one than `force`.

    It is the least that was held: `HELD_OBSERVATIONS` in a row, without the largest and the least,
    differ by less than a touch. Of a force that varied it is the median of those below `force`, if they last
    longer than a touch and a release. None without either. felt: (n, 3) [N]; observations: how many the
    press has, of which n are felt; least_apart_n: by which another force is weaker.
    """
    newtons = np.linalg.norm(felt, axis=1)
    if newtons.size < HELD_OBSERVATIONS:
        return None
    windows = np.sort(sliding_window_view(newtons, HELD_OBSERVATIONS), axis=1)
    steady = (windows[:, -2] - windows[:, 1] <= PUSHES_BACK_N) & (windows[:, 1] >= PUSHES_BACK_N)
    least, most_n = windows[steady, HELD_OBSERVATIONS // 2].min(initial=np.inf), length(force) - least_apart_n
    if least <= most_n:
        return float(least)
    weak = newtons[(newtons >= PUSHES_BACK_N) & (newtons <= most_n)]
    lasting = weak.size * observations >= VARIED_OBSERVATIONS * newtons.size
    return float(np.median(weak)) if lasting else None


def slackened_force(felt: Array, force: Vector) -> float | None:
    """Return the median size [N] to which a press slackened and rose again; None where it did not.

    It was another, weaker force for `SLACK_OBSERVATIONS` in all, before and after which `force` was
    held for two in a row. So it is no touch and no release, and an impact before it counts for nothing.
    felt: (n, 3) [N].
    """
    newtons, newton = np.linalg.norm(felt, axis=1), length(force)
    weak = newtons <= newton - other_force_n(newton)
    strong = np.flatnonzero(~weak[1:] & ~weak[:-1])
    if not len(strong):
        return None
    inside = slice(int(strong[0]), int(strong[-1]))
    slack = newtons[inside][weak[inside]]
    return float(np.median(slack)) if len(slack) >= SLACK_OBSERVATIONS else None


def last_pressed(felt: Array, force: Vector, rest_n: float) -> int | None:
    """Return the index of the last observation with a force; None if it is pressed, or let go, to the end.

    After it, nothing is pressed for `SLACK_OBSERVATIONS` or longer: a force of `rest_n` [N] at most, as
    of an object that rests on what it was pressed on. felt: (n, 3) [N].
    """
    newtons, newton = np.linalg.norm(felt, axis=1), length(force)
    pressed = np.flatnonzero(newtons > newton - other_force_n(newton))
    after = newtons[pressed[-1] + 1 :] if len(pressed) else newtons[:0]
    rests = len(after) >= SLACK_OBSERVATIONS and float(np.median(after)) <= rest_n
    return int(pressed[-1]) if rests else None


def stronger_force(felt: Array, newton: float) -> float | None:
    """Return the size [N] of the largest force that was held for 0.2 s, if it is another one than `newton`.

    Two observations in a row have it. An impact, as at a touch, is over before the second. felt: (n, 3) [N].
    """
    newtons = np.linalg.norm(felt, axis=1)
    return _other(np.minimum(newtons[1:], newtons[:-1]), newton)


def impact(felt: Array, newton: float) -> float | None:
    """Return the size [N] of the largest force, where it is another one than the largest that was held.

    newton: the largest force [N] of the app; felt: (n, 3) [N].
    """
    newtons = np.linalg.norm(felt, axis=1)
    return _other(newtons, max(newton, stronger_force(felt, newton) or 0.0))


def _other(newtons: Array, newton: float) -> float | None:
    """Return the largest of sizes (n,) [N], where it is another one than `newton` [N]."""
    most = float(newtons.max(initial=0.0))
    return most if most >= newton + UNLIKE_N else None


def force_aslant(felt: Array, force: Vector | Array) -> Vector | None:
    """Return the force [N] that the robot would exert as one held in another direction than `force`.

    Of several the one that differs most; None without one. It is held if `ASIDE_OBSERVATIONS` in a row,
    without the furthest one, differ by less than a touch. felt: (n, 3) [N].
    """
    if len(felt) < ASIDE_OBSERVATIONS:
        return None
    windows = sliding_window_view(felt, ASIDE_OBSERVATIONS, axis=0)  # (k, 3, observations)
    levels = np.median(windows, axis=2)
    off = np.sort(np.linalg.norm(windows - levels[:, :, None], axis=1), axis=1)
    sizes, apart = np.linalg.norm(levels, axis=1), np.linalg.norm(levels - force, axis=1)
    leans = levels @ force <= LEAN_COSINE * sizes * length(force)
    held = (off[:, -2] <= PUSHES_BACK_N) & (sizes >= PUSHES_BACK_N) & (apart >= UNLIKE_N) & leans
    return _opposite(levels[np.argmax(np.where(held, apart, 0.0))]) if held.any() else None


def force_aside(felt: Array, force: Vector) -> Vector | None:
    """Return the force [N] that the robot would exert as one that was pushed aside, such as to and fro.

    It differs from `force` by another force across it, for `HELD_OBSERVATIONS` in all. It is their
    median on the side of most of them. None without one. felt: (n, 3) [N] of a press without a way: a way
    has friction.
    """
    along = np.divide(force, length(force))
    aside = felt - (felt @ along)[:, None] * along
    apart = np.linalg.norm(aside, axis=1) >= UNLIKE_N
    if np.count_nonzero(apart) < HELD_OBSERVATIONS:
        return None
    furthest = aside[np.argmax(np.linalg.norm(aside, axis=1))]
    sides = apart & (aside @ furthest > 0.0), apart & (aside @ furthest < 0.0)
    return _opposite(np.median(felt[max(sides, key=np.count_nonzero)], axis=0))


def _opposite(force: Array) -> Vector:
    x, y, z = (-force).tolist()
    return x, y, z

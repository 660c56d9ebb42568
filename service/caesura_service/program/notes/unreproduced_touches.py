"""Forces in the air that are no contact: too weak or short for one, too short for the drift of a sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App
from caesura_protocol.number_words import fixed, interval
from caesura_service.constants import TARED_BIAS_N
from caesura_service.program.forces.sensor_bias import acceleration
from caesura_service.program.notes.largest_parts import largest_parts
from caesura_service.program.program_segment import (
    OBSERVED_S,
    ROUNDED_S,
    UNLIKE_N,
    MomentAt,
    length,
    observed,
)

LASTS = 5  # observations in a row, half a second, from which on a weak force is named
HITS = 3  # likewise one of `UNLIKE_N`: no tool of 2 kg is accelerated so long without moving by 0.7 m/s
SHORT_HITS = 2  # observations of a shorter one: a single one may be an outlier
TOOL_KG = 2.0  # whose inertia a shorter one exceeds
AROUND_S = 5.0  # before and after a force, in which a sensor drifts by less than `TARED_BIAS_N`
BLOCK = 10  # observations for which one reading is that of the air
BESIDE_S = 0.3  # beside an app in contact, in which its force still fades
THINNED = 5  # observations of which one stands for the air around a force
NAMED = 5  # the strongest ones in a note
AXES = 3
Array = NDArray[np.float64]
Block = Sequence[float]  # times [s]


class _Touch(NamedTuple):
    """A force that differs from the readings around it."""

    t0: float  # [s]
    tn: float  # [s]
    newton: float

    def text(self) -> str:
        """Return the force and its time as text."""
        return f"{fixed(self.newton, 1)} N at {interval(self.t0, self.tn, 1)} s"


def unreproduced_touches_note(
    apps: Iterable[App],
    moment_at: MomentAt,
    began: float,
    ended: float,
    giving_way: Callable[[Sequence[Block]], Iterable[Block]] = iter,
) -> str | None:
    """Return a note on the forces in the air that are in no app; None without one.

    began, ended: the first and the last observation of the demonstration [s]; giving_way: iterates over
    parts of the work, and lets others work between them.
    """
    blocks = [block for t0, tn in _in_the_air(apps, began, ended) for block in _blocks(t0, tn)]
    readings = [_readings(block, moment_at) for block in giving_way(blocks)]
    times = np.concatenate([t for t, _ in readings] or [np.zeros(0)])
    forces = np.concatenate([force for _, force in readings] or [np.zeros((0, AXES))])
    air = [_air(block, times, forces) for block in giving_way(blocks)]
    found = list(_touches(times, forces - np.concatenate(air or [forces]), moment_at))
    if not found:
        return None
    said = "; ".join(largest_parts(found, lambda one: one.newton, _Touch.text, NAMED, "weaker ones"))
    return f"Forces without a contact, in no app: {said}. To have the robot press there, press harder."


def _in_the_air(apps: Iterable[App], began: float, ended: float) -> Iterator[tuple[float, float]]:
    """Yield the times [s] between which no app touches, carries, or moves the fingers."""
    t = began
    for app in apps:
        facts = APP_KINDS[app.kind]
        if facts.in_contact or facts.carries or is_resisted(app):
            yield t, app.t0 - BESIDE_S
            t = max(t, app.tn + BESIDE_S)
    yield t, ended


def _blocks(t0: float, tn: float) -> Iterator[Block]:
    """Yield the observations between two times [s], in blocks of at most `BLOCK`."""
    times = observed(t0, tn) if tn - t0 > OBSERVED_S else []
    for low in range(0, len(times), BLOCK):
        yield times[low : low + BLOCK]


def _readings(block: Block, moment_at: MomentAt) -> tuple[Array, Array]:
    """Return the times (n,) [s] and forces (n, 3) [N] of those observations of a block with a force."""
    known = [(t, force) for t in block if (force := moment_at(t).force) is not None]
    return np.array([t for t, _ in known]), np.array([force for _, force in known]).reshape(-1, AXES)


def _air(block: Block, times: Array, forces: Array) -> Array:
    """Return the force (n, 3) [N] of the air in a block: the mean of the readings near the most central one.

    That one has the least sum of distances to the others around the block. So the result does not depend on
    the base frame. times, forces: all readings in the air.
    """
    inside = np.searchsorted(times, (block[0] - ROUNDED_S, block[-1] + ROUNDED_S))
    low, high = np.searchsorted(times, (block[0] - AROUND_S, block[-1] + AROUND_S))
    around = forces[low:high:THINNED]
    if not len(around):
        return around
    distances = np.linalg.norm(around[:, None] - around, axis=2)
    near = distances[distances.sum(axis=1).argmin()] < 0.5 * TARED_BIAS_N
    return np.tile(around[near].mean(axis=0), (int(inside[1] - inside[0]), 1))


def _touches(times: Array, apart: Array, moment_at: MomentAt) -> Iterator[_Touch]:
    """Yield the forces that differ by `TARED_BIAS_N` from the air; apart: (n, 3) [N] the differences.

    They last for `LASTS` observations, or for `HITS` with more than a drift, as what is hit in passing, or
    for `SHORT_HITS` if no inertia explains them. A force may turn, as that on a crank does. So its size is
    the mean of the sizes.
    """
    newtons = np.linalg.norm(apart, axis=1)
    far = newtons >= TARED_BIAS_N
    breaks = (np.diff(far.astype(np.int8)) != 0) | (np.diff(times) > 1.5 * OBSERVED_S)
    edges = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(times)]
    for low, high in pairwise(edges):
        if not far[low:high].any():
            continue
        if high - low >= LASTS or _is_hit(times[low:high], newtons[low:high], moment_at):
            yield _Touch(float(times[low]), float(times[high - 1]), float(newtons[low:high].mean()))


def _is_hit(times: Array, newtons: Array, moment_at: MomentAt) -> bool:
    """Return whether something was hit by forces of sizes (n,) [N] at times [s].

    A short hit has the impulse of `UNLIKE_N` in `SHORT_HITS` observations, beyond the inertia of a tool.
    """
    hard = np.count_nonzero(newtons >= UNLIKE_N)
    if hard >= HITS:
        return True
    if not hard or len(times) < SHORT_HITS or newtons.sum() < SHORT_HITS * UNLIKE_N:
        return False
    inertia_n = [TOOL_KG * length(acceleration(t, moment_at)) for t in times.tolist()]
    return bool(np.maximum(newtons - inertia_n, 0.0).sum() >= SHORT_HITS * UNLIKE_N)

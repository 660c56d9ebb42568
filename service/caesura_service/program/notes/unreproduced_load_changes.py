"""Loads that changed while they were held still, and are carried as one.

The load of a carry is an average. A change that is smaller than the drift of a sensor along a way is seen
only where the flange rests: there the bias stays, so the noise of the recording decides what is a change.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from caesura_protocol.app_contacts import is_resisted
from caesura_protocol.app_kinds import APP_KINDS
from caesura_protocol.messages import App, Vector
from caesura_protocol.number_words import fixed
from caesura_protocol.rotations import angle_between
from caesura_protocol.up_direction import UP
from caesura_service.constants import GRAVITY, HANDS_BREADTH_M, REST_M_PER_S
from caesura_service.program.forces.sensor_bias import WANDER_N, WANDER_S
from caesura_service.program.interpretation.carried_loads import CHANGED_SDS
from caesura_service.program.notes.largest_parts import largest_parts
from caesura_service.program.program_segment import OBSERVED_S, Moment, MomentAt, observed

SIDE, CHANGING = 5, 2  # observations on either side of a change, and in the change at most
DEPENDENT = 4.0  # observations of which one is independent of the others: forces stay alike for 0.2 s
AT_ENDS_S = 0.5  # from an end of a carry, where a support bears a part of the load
NAMED = 5  # the largest ones in a note

Array = NDArray[np.float64]


class _Change(NamedTuple):
    """A load before and after a change."""

    t: float  # [s]
    before_kg: float
    after_kg: float

    @property
    def size_kg(self) -> float:
        return abs(self.after_kg - self.before_kg)

    def text(self) -> str:
        """Return the change and its time as text."""
        return f"by {fixed(self.after_kg - self.before_kg, 2)} kg at {fixed(self.t, 1)} s"


def unreproduced_load_changes_note(apps: Iterable[App], moment_at: MomentAt, up: Vector = UP) -> str | None:
    """Return a note on the changes of loads that are carried as one; None without one.

    up: away from gravity, base frame.
    """
    found = list(_changes(apps, moment_at, up))
    if not found:
        return None
    said = "; ".join(largest_parts(found, lambda one: one.size_kg, _Change.text, NAMED, "lesser changes"))
    return f"Loads that changed while they were held, and are carried as their average: {said}."


def _changes(apps: Iterable[App], moment_at: MomentAt, up: Vector) -> Iterator[_Change]:
    runs = [(load, list(run)) for load, run in groupby(apps, key=_load_of)]
    for place, ((carries, _), steps) in enumerate(runs):
        if not carries:
            continue
        ends = [not 0 <= near < len(runs) or not runs[near][0][0] for near in (place - 1, place + 1)]
        t0, tn = steps[0].t0 + AT_ENDS_S * ends[0], steps[-1].tn - AT_ENDS_S * ends[1]
        times = observed(t0, tn) if tn > t0 else []
        moments = [moment_at(t) for t in times]
        for low, high in _rests(moments):
            forces = [one.force for one in moments[low:high] if one.force is not None]
            if len(forces) == high - low:
                yield from _changes_in(times[low:high], -(np.array(forces) @ up) / GRAVITY)


def _load_of(app: App) -> tuple[bool, float | None]:
    """Return whether an app carries a load that was weighed, and that load [kg]."""
    carries = APP_KINDS[app.kind].carries and app.load_kg is not None and not is_resisted(app)
    return carries, app.load_kg if carries else None


def _rests(moments: Sequence[Moment]) -> Iterator[tuple[int, int]]:
    """Yield the first and the end of each range of moments in which the flange neither moves nor turns."""
    still = [_rest(one, two) for one, two in pairwise(moments)]
    first = 0
    for rests, run in groupby(still):
        end = first + len(list(run))
        if rests:
            yield first, end + 1
        first = end


def _rest(one: Moment, two: Moment) -> bool:
    most_m = REST_M_PER_S * OBSERVED_S
    turned = 0.0
    if one.orientation is not None and two.orientation is not None:
        turned = angle_between(one.orientation, two.orientation)
    return math.dist(one.position, two.position) <= most_m and turned * HANDS_BREADTH_M <= most_m


def _changes_in(times: Sequence[float], weights: Array) -> Iterator[_Change]:
    """Yield the largest change of weights (n,) [kg] in one rest, if noise and drift do not explain it."""
    count = 2 * SIDE + CHANGING
    if len(weights) < count:
        return
    windows = sliding_window_view(weights, count)
    before, after = windows[:, :SIDE], windows[:, -SIDE:]
    apart = np.abs(after.mean(axis=1) - before.mean(axis=1))
    apart[apart <= _least_changes_kg(before, after)] = 0.0
    low = int(np.argmax(apart))
    if apart[low]:
        middle = low + count // 2
        yield _Change(times[middle], float(np.median(weights[:middle])), float(np.median(weights[middle:])))


def _least_changes_kg(before: Array, after: Array) -> Array:
    """Return from which difference of means (k,) [kg] on a load has changed.

    It is `CHANGED_SDS` times the standard deviation of noise and drift. before, after:
    weights (k, SIDE) [kg].
    """
    variance = (before.var(axis=1, ddof=1) + after.var(axis=1, ddof=1)) * DEPENDENT / SIDE
    drift_kg = WANDER_N * (SIDE + CHANGING) * OBSERVED_S / WANDER_S / GRAVITY
    least: Array = CHANGED_SDS * np.sqrt(variance + drift_kg**2)
    return least

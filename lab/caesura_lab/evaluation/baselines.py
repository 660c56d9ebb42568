"""Methods of other authors, on the same signals.

Every parameter is the literature's or follows from a principle that stands beside it; none is fitted to our
scenarios or recordings. Methods that only find boundaries get the same labels afterwards: the rule of the
thresholds, applied to the mean speed and force of a segment, so that a class accuracy can be compared too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.observations import Signals, grid_signals
from caesura_lab.evaluation.score import FoundSegment, FoundSegmentation
from caesura_protocol.recording import Recording

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# The annotators' rule: motion starts and stops between 5 and 10 mm/s, and a rest lasts at least 0.3 s.
MOVING_M_PER_S, RESTING_M_PER_S = 0.010, 0.005
LEAST_S = 0.3
# A tared sensor's bias wanders by about 1.5 N: twice that is a contact, once that is none.
CONTACT_N, FREE_N = 3.0, 1.5


@dataclass(frozen=True)
class Baseline:
    """A method that looks at conditioned signals and says where segments begin.

    starts: signals → indices of the observations (k,) that begin a segment, the first (0) left out.
    """

    name: str
    starts: Callable[[Signals], NDArray[np.intp]]

    def segment(self, recording: Recording) -> FoundSegmentation:
        """Divide a recording, and label what comes out. Raises ValueError for one that is too short."""
        signals = grid_signals(recording)
        starts = self._within(signals)
        times = boundaries_s(signals, starts)
        return FoundSegmentation(tuple(times.tolist()), labelled(signals, starts, times))

    def _within(self, signals: Signals) -> NDArray[np.intp]:
        starts = np.unique(self.starts(signals))
        return starts[(starts > 0) & (starts < signals.t.size)]


def boundaries_s(signals: Signals, starts: NDArray[np.intp]) -> Array:
    """Return the times [s] between the last observation of each segment and the first of the next, (k,)."""
    times: Array = (signals.t[starts - 1] + signals.t[starts]) / 2.0
    return times


def labelled(signals: Signals, starts: NDArray[np.intp], times: Array) -> tuple[FoundSegment, ...]:
    """Segments with the class that their mean speed and force give. starts, times: (k,)."""
    bounds = [0, *starts.tolist(), signals.t.size]
    edges = [float(signals.t[0]), *times.tolist(), float(signals.t[-1])]
    kinds = [_kind(signals, a, b) for a, b in pairwise(bounds)]
    return tuple(FoundSegment(a, b, kind) for a, b, kind in zip(edges, edges[1:], kinds, strict=False))


def _kind(signals: Signals, first: int, last: int) -> str:
    moves = bool(signals.speed[first:last].mean() > MOVING_M_PER_S)
    force = float(np.linalg.norm(signals.force_base[first:last], axis=1).mean())
    if signals.holding[first:last].mean() > 0.5 and (moves or force <= CONTACT_N):
        return "transport" if moves else "hold"
    if force > CONTACT_N:
        return "sliding" if moves else "contact"
    return "motion" if moves else "steady"


def one_segment(signals: Signals) -> NDArray[np.intp]:
    """One segment."""
    return np.array([], dtype=np.intp)


def thresholds(signals: Signals) -> NDArray[np.intp]:
    """Speed and force above or below a threshold, with hysteresis; states that last no 0.3 s are none."""
    moving = switched(signals.speed, MOVING_M_PER_S, RESTING_M_PER_S)
    pressed = switched(np.linalg.norm(signals.force_base, axis=1), CONTACT_N, FREE_N)
    # What is carried presses on the sensor by its weight: while it moves in the gripper, that is no contact.
    state = 2 * (pressed & ~(signals.holding & moving)) + moving
    return _changes(_lasting(state, signals.t))


def zero_velocity(signals: Signals) -> NDArray[np.intp]:
    """Return the rows (k,) where an axis stops, starts or turns round; crossings within 0.3 s are one.

    Fod, Matarić & Jenkins 2002, section 3.2 (a zero is a velocity within a dead band; crossings of several
    axes within 300 ms are one), with hysteresis between the annotators' speeds as the dead band.
    """
    direction = np.column_stack([_direction(axis) for axis in signals.velocity_base.T])
    crossings = 1 + np.flatnonzero((np.diff(direction, axis=0) != 0).any(axis=1))
    groups = np.split(crossings, 1 + np.flatnonzero(np.diff(signals.t[crossings]) > LEAST_S))
    return np.array([round(float(np.mean(group))) for group in groups if group.size], dtype=np.intp)


def switched(values: Array, on: float, off: float) -> Mask:
    """Schmitt trigger: true from above `on` until below `off`. values: (n,)."""
    clear = np.where(values > on, 1, np.where(values < off, -1, 0))
    since = np.maximum.accumulate(np.where(clear != 0, np.arange(values.size), 0))
    result: Mask = clear[since] > 0
    return result


def _direction(velocity: Array) -> NDArray[np.intp]:
    """-1, 0 or 1: where an axis goes, (n,)."""
    forth, back = (switched(sign * velocity, MOVING_M_PER_S, RESTING_M_PER_S) for sign in (1.0, -1.0))
    return forth.astype(np.intp) - back.astype(np.intp)


def _lasting(state: NDArray[np.intp], t: Array) -> NDArray[np.intp]:
    """States that last no 0.3 s are taken for the one before, the first for the one after. state: (n,)."""
    kept, step = state.copy(), float(np.median(np.diff(t)))
    bounds = [0, *_changes(state).tolist(), state.size]
    for first, last in pairwise(bounds):
        if (last - first) * step < LEAST_S - step / 2:
            kept[first:last] = kept[first - 1] if first else state[min(last, state.size - 1)]
    return kept


def _changes(state: NDArray[np.intp]) -> NDArray[np.intp]:
    return 1 + np.flatnonzero(np.diff(state))

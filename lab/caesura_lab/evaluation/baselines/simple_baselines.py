"""Methods of other authors, on the same signals.

Every parameter is from the literature or follows from a stated principle; none is fitted to scenarios or
recordings of this project. For methods that only find boundaries the classes are assigned afterwards, by the
thresholds on the mean speed and force of a segment, so that class accuracies can be compared too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_lab.evaluation.baselines.conditioned_signals import Signals, grid_signals
from caesura_lab.evaluation.scoring.score import FoundSegment, FoundSegmentation
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
    """A method that finds the starts of segments in conditioned signals.

    starts: signals → indices of the observations (k,) that begin a segment, the first (0) left out.
    """

    name: str
    starts: Callable[[Signals], NDArray[np.intp]]

    def segment(self, recording: Recording) -> FoundSegmentation:
        """Segment a recording, and classify the segments. Raises ValueError for one that is too short."""
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
    """Return segments with the class of their mean speed and force. starts, times: (k,)."""
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
    """Return no starts: the whole recording is one segment."""
    return np.array([], dtype=np.intp)


def every_second(signals: Signals) -> NDArray[np.intp]:
    """Return a start every second, whatever happens: the score that chance has."""
    step = max(round(1.0 / float(np.median(np.diff(signals.t)))), 1)
    return np.arange(step, signals.t.size, step, dtype=np.intp)


def thresholds(signals: Signals) -> NDArray[np.intp]:
    """Return starts by thresholds on speed and force, with hysteresis; states below 0.3 s are dropped."""
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
    """Return -1, 0 or 1: the direction of motion of an axis, (n,)."""
    forth, back = (switched(sign * velocity, MOVING_M_PER_S, RESTING_M_PER_S) for sign in (1.0, -1.0))
    return forth.astype(np.intp) - back.astype(np.intp)


def _lasting(state: NDArray[np.intp], t: Array) -> NDArray[np.intp]:
    """Return states (n,) with those below 0.3 s replaced by the one before, the first by the one after."""
    kept, step = state.copy(), float(np.median(np.diff(t)))
    bounds = [0, *_changes(state).tolist(), state.size]
    for first, last in pairwise(bounds):
        if (last - first) * step < LEAST_S - step / 2:
            kept[first:last] = kept[first - 1] if first else state[min(last, state.size - 1)]
    return kept


def _changes(state: NDArray[np.intp]) -> NDArray[np.intp]:
    return 1 + np.flatnonzero(np.diff(state))

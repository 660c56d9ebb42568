"""Gripper events from the opening between the fingers, or from a closed flag.

Rules
1. Fingers are still while their opening stays within `still_range_m` over `still_window_s`; otherwise they
   move. Only rest decides a posture: open, grasped (they stopped short of closed), closed (on nothing).
2. Every movement from one rest to the next is at most one event, looked up in `EVENTS`. A grasp or a close
   happens when the fingers have settled, a release or an open when they begin to move; all are reported
   once they have settled, with the width at which they did. Fingers at v m/s are seen to stop up to
   still_range_m / v early and to begin as much late.
3. The opening alone does not distinguish an object from a commanded stop: fingers that close part of the way
   have grasped. Nor does it show what they hold at the start: posture is then open, or closed if nothing
   fits.
4. A column that is 0 has not said yet whether it is a flag (open) or an opening (closed). The first other
   value decides: 1 is a flag, which has no width; metres never reach 1.
5. Fingers that leave a rest and come back to it have no event. If they have moved by `excursion_m`, on two
   rows in a row, the state keeps the excursion.
6. Movement slower than still_range_m / still_window_s (10 mm/s by default; a Panda's fingers travel 80 mm in
   0.56 s) is not seen as movement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.backend import REFERENCE, Backend

Array = NDArray[np.float64]
EventKind = Literal["grasp", "release", "close", "open"]
Posture = Literal["open", "grasped", "closed"]
Signal = Literal["undecided", "opening", "flag"]

EXCURSIONS = 100  # that are kept of a session

#: (posture before, posture after) → event and whether it happens as the fingers begin or have settled.
EVENTS: Mapping[tuple[Posture, Posture], tuple[EventKind, Literal["begun", "settled"]]] = {
    ("open", "grasped"): ("grasp", "settled"),
    ("open", "closed"): ("close", "settled"),
    ("open", "open"): ("open", "begun"),
    ("grasped", "grasped"): ("grasp", "settled"),
    ("grasped", "closed"): ("close", "settled"),
    ("grasped", "open"): ("release", "begun"),
    ("closed", "open"): ("open", "begun"),
    ("closed", "grasped"): ("grasp", "settled"),
    ("closed", "closed"): ("close", "settled"),
}


@dataclass(frozen=True)
class GripperParameters:
    """Thresholds of the gripper's state machine."""

    still_window_s: float = 0.2
    still_range_m: float = 0.002  # wider than the noise of the opening, narrower than a step of a movement
    travel_m: float = 0.003  # a rest this much off the last one is another rest
    empty_m: float = 0.003  # fingers that settle at most this wide hold nothing
    excursion_m: float = 0.005  # what is held gives way by less
    opening_max_m: float = 0.08  # Panda; stands for "open" where there is only a flag

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise ValueError(f"gripper parameter {name} is {value}, expected a number above 0")
        if not self.travel_m > self.still_range_m:
            limit = f"above still_range_m = {self.still_range_m}"
            raise ValueError(f"gripper parameter travel_m is {self.travel_m}, expected a length {limit}")


@dataclass(frozen=True)
class GripperEvent:
    """An action of the fingers at t [s]; width: where they came to rest [m], None from a flag."""

    t: float
    kind: EventKind
    width: float | None


class FingerExcursion(NamedTuple):
    """Fingers that leave a rest and come back to it, between two times [s]; openings [m], nan from a flag."""

    began: float
    ended: float
    was: float
    furthest: float


class GripperRows(NamedTuple):
    """The gripper's events, and its state on each grid row; nan where that is unknown."""

    events: tuple[GripperEvent, ...]
    grips: Array  # (n, 2) width [m]; 1 closed or grasped, 0 open


class GripperState(NamedTuple):
    """The last rest of the fingers, and the rows that the next decision needs."""

    signal: Signal = "undecided"
    tail: Array = np.empty(0)  # (m,) [m], shorter than the window
    still: bool = False
    posture: Posture | None = None
    level: float = 0.0  # [m] opening at the last rest
    begun: float | None = None  # [s] the last time at which the fingers were seen still
    latest: float = 0.0  # [m] opening on the last row
    last_row: int = 0  # its grid index
    away: float = 0.0  # [m] how far the fingers have moved from that rest since, up or down
    excursions: tuple[FingerExcursion, ...] = ()  # the first EXCURSIONS


@dataclass(frozen=True)
class GripperTracker:
    """Detects openings and closings of a gripper in grid rows; its parameters are immutable.

    `advance` maps a state and rows to the next state and events. The time of a grid row is
    anchor + row / grid_hz [s].
    """

    grid_hz: float
    parameters: GripperParameters = GripperParameters()
    arithmetic: Backend = REFERENCE

    @cached_property
    def window(self) -> int:
        """The number of rows over which fingers are judged still."""
        return max(2, round(self.parameters.still_window_s * self.grid_hz))

    def advance(
        self, state: GripperState, anchor: float, first: int, rows: Array
    ) -> tuple[GripperState, GripperRows]:
        """Process the grid rows first, first + 1, … (n, c), the gripper in the last column."""
        if state.signal != "undecided":
            return self._follow(state, anchor, first, rows)
        n = _leading_zeros(rows[:, -1])
        state, early = self._follow(state, anchor, first, rows[:n])
        if n == len(rows):
            return state, early
        state = self._decided(state, is_flag=bool(rows[n, -1] == 1.0))
        state, late = self._follow(state, anchor, first + n, rows[n:])
        return state, GripperRows(early.events + late.events, np.concatenate([early.grips, late.grips]))

    def restarted(self, state: GripperState) -> GripperState:
        """Return the state after a gap: the fingers may still hold an object, but no rest was observed."""
        begun = state.last_row if state.still else state.begun
        return state._replace(tail=np.empty(0), still=False, begun=begun)

    def finish(self, state: GripperState, anchor: float) -> tuple[GripperEvent, ...]:
        """Report an opening that began but never came to rest; its width is the last one seen."""
        opened = state.latest > state.level + self.parameters.travel_m
        if state.still or state.posture is None or not opened:
            return ()
        return self._event(state, "open", anchor, state.last_row, state.latest)

    def _decided(self, state: GripperState, *, is_flag: bool) -> GripperState:
        """Return the state once the type of signal is known: earlier zeros were widths [m], or an open
        flag.
        """
        if not is_flag:
            return state._replace(signal="opening")
        opened = self.parameters.opening_max_m
        posture: Posture | None = None if state.posture is None else "open"
        tail = np.full_like(state.tail, opened)
        return state._replace(signal="flag", tail=tail, posture=posture, level=opened, latest=opened)

    def _follow(
        self, state: GripperState, anchor: float, first: int, rows: Array
    ) -> tuple[GripperState, GripperRows]:
        """Run the state machine from change to change between still and moving."""
        n, before = len(rows), len(state.tail)
        recent, grips = np.empty(before + n), np.empty((n, 2))
        if n == 0:
            return state, GripperRows((), grips)
        opened = self.parameters.opening_max_m if state.signal == "flag" else 0.0
        how = opened, state.signal == "opening", self._closed_below(state)
        spread = self.arithmetic.openings(rows, state.tail, *how, recent, grips)
        events: tuple[GripperEvent, ...] = ()
        if not (state.still and spread <= self.parameters.still_range_m):  # as it is most of the time
            start = max(before - 1, 0)  # in recent, of what moves
            for i, stills in self._changes(state.still, recent, n):
                end = before + i + 1
                if stills:
                    level = float(np.median(recent[end - self.window : end]))
                    state, event = self._settled(_moved(state, recent[start:end]), anchor, first + i, level)
                    events += event
                else:
                    state, start = state._replace(still=False, begun=first + i - 1), max(end - 2, 0)
                below = self._closed_below(state)
                grips[i:, 1] = math.nan if math.isnan(below) else recent[before + i :] <= below
            state = state if state.still else _moved(state, recent[start:])
        tail = recent[max(0, len(recent) - (self.window - 1)) :].copy()
        state = state._replace(tail=tail, latest=float(recent[-1]), last_row=first + n - 1)
        return state, GripperRows(events, grips)

    def _changes(self, still: bool, recent: Array, n: int) -> list[tuple[int, bool]]:
        """Return (index, whether the fingers come to rest) for each change between rest and motion in n rows.

        They are still where the window that ends at a row is full and narrow.
        """
        verdicts = np.zeros(len(recent), dtype=np.bool_)
        starts = np.arange(len(recent) - self.window + 1)
        windows = recent[starts[:, None] + np.arange(self.window)]
        spread = windows.max(axis=1) - windows.min(axis=1)
        verdicts[self.window - 1 :] = spread <= self.parameters.still_range_m
        verdicts = np.concatenate([[still], verdicts[len(recent) - n :]])
        changed = np.flatnonzero(verdicts[1:] != verdicts[:-1]).tolist()
        return [(i, bool(verdicts[i + 1])) for i in changed]

    def _closed_below(self, state: GripperState) -> float:
        """Return the opening [m] up to which fingers count as closed, with or without an object.

        Nan if unknown.
        """
        if state.posture is None or state.signal == "undecided":
            return math.nan
        return -math.inf if state.posture == "open" else state.level + self.parameters.travel_m

    def _settled(
        self, state: GripperState, anchor: float, row: int, level: float
    ) -> tuple[GripperState, tuple[GripperEvent, ...]]:
        """Return state and events of fingers that come to rest: the first still window ends at this row."""
        rest = state._replace(still=True, begun=None, away=0.0)
        if state.posture is not None and abs(level - state.level) < self.parameters.travel_m:
            return self._with_excursion(state, rest, anchor, row - self.window + 1), ()
        posture = self._posture(state, level)
        events: tuple[GripperEvent, ...] = ()
        if state.posture is not None:
            events = self._event(state, posture, anchor, row - self.window + 1, level)
        return rest._replace(posture=posture, level=level), events

    def _with_excursion(
        self, state: GripperState, rest: GripperState, anchor: float, settled: int
    ) -> GripperState:
        """Return the state of a rest that is the one before, with the excursion from it."""
        if abs(state.away) < self.parameters.excursion_m or state.begun is None:
            return rest
        began, ended = (anchor + row / self.grid_hz for row in (state.begun, settled))
        was = math.nan if state.signal == "flag" else state.level
        found = FingerExcursion(began, ended, was, was + state.away)
        return rest._replace(excursions=(*state.excursions, found)[:EXCURSIONS])

    def _posture(self, state: GripperState, level: float) -> Posture:
        if state.signal == "flag":
            return "open" if level > self.parameters.opening_max_m / 2 else "grasped"
        if level <= self.parameters.empty_m:
            return "closed"
        return "open" if state.posture is None or level > state.level else "grasped"

    def _event(
        self, state: GripperState, posture: Posture, anchor: float, settled: int, level: float
    ) -> tuple[GripperEvent, ...]:
        if state.posture is None:
            return ()
        kind, moment = EVENTS[state.posture, posture]
        row = settled if moment == "settled" or state.begun is None else state.begun
        width = None if state.signal == "flag" else level
        return (GripperEvent(anchor + row / self.grid_hz, kind, width),)


def _moved(state: GripperState, openings: Array) -> GripperState:
    """Return the state of moving fingers, with how far two openings (n,) [m] in a row are off the rest."""
    off = openings - state.level
    up = float(np.minimum(off[1:], off[:-1]).max(initial=state.away))
    down = float(np.maximum(off[1:], off[:-1]).min(initial=state.away))
    return state._replace(away=max(up, down, key=abs))


def _leading_zeros(values: Array) -> int:
    return next((i for i, value in enumerate(values.tolist()) if value), len(values))

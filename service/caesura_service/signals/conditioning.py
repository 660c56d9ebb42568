"""Conditioning: raw samples in, observations on the segmentation grid out, while they arrive.

Theory of operation. Samples become rows of a fixed grid (`grid`), rows become flange positions and forces in
the base frame (`flange`), these are filtered (`filtering`), tared (`tare`) and every tenth is handed on.
Each stage maps a frozen state and its input to the next state and its output; the conditioner keeps one
state and replaces it when a push has succeeded, so a push that raises has changed nothing.

What comes out does not depend on how the samples were cut into pushes, bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals.filtering import SavitzkyGolay
from caesura_service.signals.flange import columns_of, flange_rows
from caesura_service.signals.grid import Block, GridState, Resampler
from caesura_service.signals.gripper import GripperEvent, GripperParameters, GripperState, GripperTracker
from caesura_service.signals.layout import Layout
from caesura_service.signals.observation import Observation, observation_of, tared
from caesura_service.signals.tare import RestCriterion, Tare, TareState, Taring
from caesura_service.signals.wrench import WrenchSource

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ConditioningParameters:
    """How samples become observations. Raises ValueError for values that make no filter or no grid."""

    grid_hz: float = 100.0
    savgol_window: int = 11  # grid rows, odd
    savgol_order: int = 2
    segmentation_hz: float = 10.0  # divides grid_hz
    gap_limit_s: float = 0.25  # a longer hole between samples is a gap, a shorter one is interpolated
    tare_window_s: float = 0.4  # from the first sample on
    tare_scatter_limit_n: float = 0.5  # standard deviation on the worst axis
    gripper: GripperParameters = field(default_factory=GripperParameters)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "gripper" and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} is {value}, expected a finite number above 0")
        if not (self.grid_hz / self.segmentation_hz).is_integer():
            expected = f"a divisor of grid_hz = {self.grid_hz:g}"
            raise ValueError(f"segmentation_hz is {self.segmentation_hz:g}, expected {expected}")
        shortest = self.filter.delay_s + 1.0 / self.grid_hz
        if not self.tare_window_s > shortest:
            raise ValueError(f"tare_window_s is {self.tare_window_s:g}, expected more than {shortest:g} s")

    @property
    def filter(self) -> SavitzkyGolay:
        """The filter on the grid."""
        return SavitzkyGolay(self.savgol_window, self.savgol_order, self.grid_hz)

    @property
    def decimation(self) -> int:
        """Grid rows per observation."""
        return round(self.grid_hz / self.segmentation_hz)

    def taring(self, source: WrenchSource) -> Taring:
        """The tare at the start."""
        criterion = RestCriterion(source.tare_speed_m_per_s, self.tare_scatter_limit_n)
        return Taring(round(self.tare_window_s * self.grid_hz), criterion)


@dataclass(frozen=True, eq=False)
class Conditioned:
    """What became clear with one push."""

    observations: tuple[Observation, ...] = ()
    gaps: tuple[tuple[float, float], ...] = ()  # [s] last sample before, first sample after
    gripper_events: tuple[GripperEvent, ...] = ()
    samples: int = 0  # in this push
    repeats: int = 0  # of them dropped because their time did not advance


@dataclass(frozen=True, eq=False)
class _State:
    """Everything that the next push needs."""

    grid: GridState | None = None
    broken: bool = False  # samples were lost for good before the next one
    tail: Array | None = None  # (m, c) flange rows that the filter still needs
    gripper: GripperState = field(default_factory=GripperState)
    tare: TareState = field(default_factory=TareState)
    waiting: tuple[Observation, ...] = ()  # for the tare
    after_gap: bool = False
    finished: bool = False
    samples: int = 0
    repeats: int = 0
    observations: int = 0


class Conditioner:
    """The conditioning of one session. Copies share nothing that changes."""

    def __init__(self, layout: Layout, parameters: ConditioningParameters | None = None) -> None:
        self.layout = layout
        self.parameters = parameters or ConditioningParameters()
        self._columns = columns_of(layout)
        self._filter = self.parameters.filter
        self._taring = self.parameters.taring(layout.source)
        self._resampler = Resampler(
            self.parameters.grid_hz,
            self.parameters.gap_limit_s,
            held=int(layout.has("gripper")),
            quaternion=layout.slices.get("quat"),
            every=self.parameters.decimation,
            phase=self._filter.half + 1,  # an observation is complete half a filter window after its row
        )
        self._gripper = GripperTracker(self.parameters.grid_hz, self.parameters.gripper)
        self._state = self._initial()

    @property
    def delay_s(self) -> float:
        """How long after its time an observation can be known [s]: half a grid cell and half a filter window.

        The tare holds the first ones back until its window is complete, where there is a wrench.
        """
        return 0.5 / self.parameters.grid_hz + self._filter.delay_s

    @property
    def tare(self) -> tuple[float, float, float] | None:
        """Bias that is taken off the force [N], base frame; None where or while nothing is."""
        return None if self._state.tare.tare is None else self._state.tare.tare.bias

    @property
    def tare_note(self) -> str:
        """What became of the tare, for whoever reads the results."""
        tare = self._state.tare.tare
        return "Not tared yet: the tare window is not complete." if tare is None else tare.note

    @property
    def samples(self) -> int:
        """Samples pushed so far."""
        return self._state.samples

    @property
    def repeats(self) -> int:
        """Samples dropped so far because their time did not advance."""
        return self._state.repeats

    @property
    def observations(self) -> int:
        """Observations handed out so far."""
        return self._state.observations - len(self._state.waiting)

    def push(self, samples: Array) -> Conditioned:
        """Take the next samples, (n, columns) as the layout names them, time first.

        Raises ValueError for samples that cannot be right and RuntimeError after `finish`; either way nothing
        has changed.
        """
        if self._state.finished:
            raise RuntimeError("push after finish: this conditioner's demonstration is over")
        samples = self.layout.take(samples)
        state = self._state
        grid, resampled = self._resampler.advance(state.grid, samples, broken=state.broken)
        state = replace(
            state,
            grid=grid,
            broken=state.broken and not resampled.blocks,
            samples=state.samples + len(samples),
            repeats=state.repeats + resampled.repeats,
        )
        events: tuple[GripperEvent, ...] = ()
        for block in resampled.blocks:
            state, happened = self._take(state, block)
            events += happened
        self._state, ready = _released(state)
        return Conditioned(ready, resampled.gaps, events, len(samples), resampled.repeats)

    def declare_gap(self) -> None:
        """Say that samples between the last push and the next are lost, however short the time between.

        The gap is reported with the sample that ends it.
        """
        self._state = replace(self._state, broken=self._state.grid is not None)

    def finish(self) -> Conditioned:
        """End the demonstration: hand out what waited. Calling it again changes nothing."""
        state = self._state
        if state.finished or state.grid is None:
            self._state = replace(state, finished=True)
            return Conditioned()
        grid, rest = self._resampler.flush(state.grid)
        state, events = self._take(replace(state, grid=grid), rest)
        events += self._gripper.finish(state.gripper, grid.anchor)
        tare = self._taring.interrupted(state.tare, "the demonstration ended within the tare window")
        self._state, ready = _released(replace(state, tare=tare, finished=True))
        return Conditioned(ready, gripper_events=events)

    def reset(self) -> None:
        """Forget every sample: the same pushes give the same results again."""
        self._state = self._initial()

    def _initial(self) -> _State:
        if self.layout.wrench_source == "none":
            return _State(tare=TareState(Tare(None, "Not tared: there is no wrench.")))
        return _State()

    def _take(self, state: _State, block: Block) -> tuple[_State, tuple[GripperEvent, ...]]:
        """Take the grid rows of one stretch."""
        if block.restarts:
            state = self._restarted(state)
        if len(block.rows) == 0:
            return state, ()
        assert state.grid is not None, "rows come from a grid"
        anchor = state.grid.anchor
        parts = flange_rows(self.layout, block.rows, self._columns.orientation_before(state.tail))
        gripper, grips, events = self._grip(state.gripper, anchor, block)
        rows = np.concatenate([*parts, grips], axis=1)
        recent = rows if state.tail is None else np.concatenate([state.tail, rows])
        first = block.first + len(rows) - len(recent)
        state = replace(state, gripper=gripper, tail=self._filter.tail(recent))
        return self._observe(state, anchor, first, recent), events

    def _restarted(self, state: _State) -> _State:
        tare = self._taring.interrupted(state.tare, "samples are missing within the tare window")
        gripper = self._gripper.restarted(state.gripper)
        return replace(state, tail=None, after_gap=True, tare=tare, gripper=gripper)

    def _grip(
        self, state: GripperState, anchor: float, block: Block
    ) -> tuple[GripperState, Array, tuple[GripperEvent, ...]]:
        """Follow the gripper: its columns of the flange rows (n, 2), and its events."""
        if not self.layout.has("gripper"):
            return state, np.full((len(block.rows), 2), np.nan), ()
        state, rows = self._gripper.advance(state, anchor, block.first, block.rows[:, -1])
        return state, np.column_stack([rows.width, rows.closed]), rows.events

    def _observe(self, state: _State, anchor: float, first: int, recent: Array) -> _State:
        """Filter the rows first, first + 1, …, tare them, and make every tenth an observation."""
        moving, half = self._columns.moving, self._filter.half
        smooth = self._filter.smooth(recent[:, :moving])
        velocity = self._filter.slope(recent[:, self._columns.position])
        speed = np.sqrt(velocity[:, 0] ** 2 + velocity[:, 1] ** 2 + velocity[:, 2] ** 2)
        filtered = np.concatenate([smooth, recent[half : half + len(smooth), moving:]], axis=1)
        tare = self._taring.advance(state.tare, first + half, smooth[:, self._columns.force], speed)
        state = replace(state, tare=tare)
        for i in range(-(first + half) % self.parameters.decimation, len(smooth), self.parameters.decimation):
            t = self._resampler.time_of(anchor, first + half + i)
            state = self._with_observation(state, filtered[i], t, float(speed[i]))
        return state

    def _with_observation(self, state: _State, row: Array, t: float, speed: float) -> _State:
        index, after_gap = state.observations, state.after_gap
        new = observation_of(self._columns, row, index=index, t=t, speed=speed, after_gap=after_gap)
        return replace(state, waiting=(*state.waiting, new), after_gap=False, observations=index + 1)


def _released(state: _State) -> tuple[_State, tuple[Observation, ...]]:
    """Hand out the waiting observations once the tare is known."""
    tare = state.tare.tare
    if tare is None or not state.waiting:
        return state, ()
    return replace(state, waiting=()), tuple(tared(observation, tare) for observation in state.waiting)

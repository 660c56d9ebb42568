"""Conditioning: converts raw samples to observations on the segmentation grid while they arrive.

Theory of operation. Samples become rows of a fixed grid (`grid_resampler`), rows become flange positions and
forces in the base frame (`flange_pose_and_force`), these are filtered (`savitzky_golay`), tared (`tare`) and
every tenth becomes an observation. Each stage maps a frozen state and its input to the next state and its
output; the conditioner keeps the states and replaces them when a push has succeeded, so a push that raises
has changed nothing. Most pushes complete no observation: only the grid processes their samples.

The observations do not depend, to the last bit, on the division of the samples into pushes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_service.constants import GRID_HZ, HANDS_BREADTH_M, UP
from caesura_service.signals.backend import Backend, best
from caesura_service.signals.boundary_time import RecentRows
from caesura_service.signals.flange_pose_and_force import columns_of, flange_rows
from caesura_service.signals.grid_resampler import MAX_WAITING_SAMPLES, NOTHING, Block, GridState, Resampler
from caesura_service.signals.gripper_events import (
    FingerExcursion,
    GripperEvent,
    GripperParameters,
    GripperState,
    GripperTracker,
)
from caesura_service.signals.observation import (
    FilteredRow,
    Observation,
    Turned,
    observation_of,
    tared_row,
    turned_to,
)
from caesura_service.signals.sample_layout import SampleLayout
from caesura_service.signals.savitzky_golay import SavitzkyGolay
from caesura_service.signals.tare import UNTARED_BIAS_N, RestCriterion, Tare, TareEstimator, TareState
from caesura_service.signals.tared_torque import in_flange
from caesura_service.signals.wrench_capabilities import WrenchCapabilities
from caesura_service.signals.wrench_estimate_bias import TRACKED_BIAS_N, BiasState, BiasTracker

Array = NDArray[np.float64]

MOST_TOGETHER = MAX_WAITING_SAMPLES // 2  # samples: with as many that wait, no cell has too many

_TARED, _UNTARED = BiasTracker(TRACKED_BIAS_N), BiasTracker(UNTARED_BIAS_N)


@dataclass(frozen=True)
class ConditioningParameters:
    """The parameters of conditioning.

    Raises ValueError for values from which no filter or grid can be made.
    """

    grid_hz: float = float(GRID_HZ)
    savgol_window: int = 11  # grid rows, odd
    savgol_order: int = 2
    segmentation_hz: float = 10.0  # divides grid_hz
    gap_limit_s: float = 0.25  # a longer hole between samples is a gap, a shorter one is interpolated
    hold_limit_s: float = 0.125  # a pose held for longer is a rest; 9 readings a second are interpolated
    tare_window_s: float = 0.4  # from the first sample on
    tare_scatter_limit_n: float = 0.5  # standard deviation in the direction in which it is greatest
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

    def taring(self, source: WrenchCapabilities, up: tuple[float, float, float] = UP) -> TareEstimator:
        """The tare at the start; up: away from gravity, of length 1, base frame."""
        criterion = RestCriterion(source.tare_speed_m_per_s, self.tare_scatter_limit_n)
        return TareEstimator(round(self.tare_window_s * self.grid_hz), criterion, up)


class ConditioningOutput(NamedTuple):
    """The results that one push completes."""

    observations: tuple[Observation, ...] = ()
    gaps: tuple[tuple[float, float], ...] = ()  # [s] last sample before, first sample after
    gripper_events: tuple[GripperEvent, ...] = ()
    samples: int = 0  # in this push
    repeats: int = 0  # of them dropped because their time did not advance

    @property
    def is_quiet(self) -> bool:
        """Whether the push completed nothing and dropped no sample."""
        return not (self.observations or self.gaps or self.gripper_events or self.repeats)


class _State(NamedTuple):
    """The state that is carried from one grid row to the next."""

    tail: Array | None = None  # (m, c) flange rows that the filter still needs
    gripper: GripperState = GripperState()
    tare: TareState = TareState()
    waiting: tuple[FilteredRow, ...] = ()  # for the tare
    after_gap: bool = False
    rows: int = 0  # of the segmentation grid
    bias: BiasState | None = None
    turned: Turned = Turned()  # by the last observation
    recent: RecentRows = RecentRows()  # of the last observations


class Conditioner:
    """The conditioning of one session. Copies share no mutable state."""

    _grid: GridState | None
    _state: _State
    _broken: bool  # samples were lost for good before the next one
    _finished: bool
    _samples: int
    _repeats: int

    def __init__(
        self,
        layout: SampleLayout,
        parameters: ConditioningParameters | None = None,
        arithmetic: Backend | None = None,
    ) -> None:
        self.layout = layout
        self._arithmetic = arithmetic or best()
        self.parameters = parameters or ConditioningParameters()
        self._columns = columns_of(layout)
        self._filter, self._every = self.parameters.filter, self.parameters.decimation
        self._taring = self.parameters.taring(layout.source, layout.up)
        self._has_wrench = layout.source_in_use != "none"
        self._tracks_bias = layout.source.bias != "tare"
        self._resampler = Resampler(
            self.parameters.grid_hz,
            self.parameters.gap_limit_s,
            held=int(layout.has("gripper")),
            quaternion=layout.slices.get("quat"),
            pose=layout.pose_width,
            beside=layout.joints_beside_pose,
            hold_limit_s=self.parameters.hold_limit_s,
            every=self._every,
            phase=self._filter.half + 1,  # an observation is complete half a filter window after its row
            arithmetic=self._arithmetic,
        )
        turn = self._columns.orientation
        self._pose = np.r_[self._columns.position, turn] if turn else np.r_[self._columns.position]
        self._gripper = GripperTracker(self.parameters.grid_hz, self.parameters.gripper, self._arithmetic)
        self.reset()

    @property
    def delay_s(self) -> float:
        """The delay [s] of an observation after its time: half a grid cell and half a filter window.

        With a wrench the first observations are also delayed until the tare's window is complete.
        """
        return 0.5 / self.parameters.grid_hz + self._filter.delay_s

    @property
    def tare(self) -> tuple[float, float, float] | None:
        """The bias that is subtracted from the force [N], base frame; None without or before a tare."""
        return None if self._state.tare.tare is None else self._state.tare.tare.bias

    @property
    def tare_note(self) -> str:
        """Return a note on the tare, for readers of the results."""
        tare = self._state.tare.tare
        return "Not tared yet: the tare window is not complete." if tare is None else tare.note

    @property
    def tare_doubt(self) -> str:
        """The reason why the tare may have been a contact; "" without such a reason, or before the tare."""
        tare = self._state.tare.tare
        return "" if tare is None else tare.doubt

    @property
    def finger_excursions(self) -> tuple[FingerExcursion, ...]:
        """Fingers that left a rest and came back to it, so far, in time order."""
        return self._state.gripper.excursions

    @property
    def samples(self) -> int:
        """Samples pushed so far."""
        return self._samples

    @property
    def repeats(self) -> int:
        """Samples dropped so far because their time did not advance."""
        return self._repeats

    @property
    def t_last(self) -> float:
        """Time of the last sample [s]; −inf before the first."""
        return -math.inf if self._grid is None else self._grid.latest

    @property
    def due_s(self) -> float:
        """Time [s] from which the first sample completes an observation.

        Pushes of earlier samples, MOST_TOGETHER at most, may be joined with the next push, with the same
        results. −inf if they must be pushed separately. Any thread may read it.
        """
        grid = self._grid
        if grid is None or self._broken or self._finished or grid.known > MOST_TOGETHER:
            return -math.inf
        return grid.due

    @property
    def observations(self) -> int:
        """The number of observations returned so far."""
        return self._state.rows - len(self._state.waiting)

    def push(self, samples: Array) -> ConditioningOutput:
        """Process the next samples, (n, columns) in the order of the layout, time first.

        Raises ValueError for impossible samples and RuntimeError after `finish`; in both cases nothing has
        changed.
        """
        if self._finished:
            raise RuntimeError("push after finish: this conditioner's demonstration is over")
        samples = self.layout.copy_columns(samples, self._arithmetic)
        grid, resampled = self._resampler.advance(self._grid, samples, broken=self._broken)
        if resampled is NOTHING:
            self._grid = grid
            self._samples += len(samples)
            return ConditioningOutput(samples=len(samples))
        state = self._state
        events: tuple[GripperEvent, ...] = ()
        for block in resampled.blocks:
            assert grid is not None, "rows come from a grid"
            state, happened = self._take(state, grid.anchor, block)
            events += happened
        state, ready = self._released(state, grid)
        self._grid, self._state = grid, state
        self._broken = self._broken and not resampled.blocks
        self._samples += len(samples)
        self._repeats += resampled.repeats
        return ConditioningOutput(ready, resampled.gaps, events, len(samples), resampled.repeats)

    def declare_gap(self) -> None:
        """Declare that samples between the last push and the next are lost, even if the time between is
        short.

        The gap is reported with the sample that ends it.
        """
        self._broken = self._grid is not None

    def finish(self) -> ConditioningOutput:
        """End the demonstration: return the remaining observations. Calling it again changes nothing."""
        if self._finished or self._grid is None:
            self._finished = True
            return ConditioningOutput()
        grid, rest = self._resampler.flush(self._grid)
        state, events = self._take(self._state, grid.anchor, rest)
        events += self._gripper.finish(state.gripper, grid.anchor)
        tare = self._taring.interrupted(state.tare, "the demonstration ended within the tare window")
        self._state, ready = self._released(state._replace(tare=tare), grid)
        self._grid, self._finished = grid, True
        return ConditioningOutput(ready, gripper_events=events)

    def reset(self) -> None:
        """Discard the state: the same pushes then give the same results again."""
        bare = Tare(None, "Not tared: there is no wrench.")
        tare = TareState() if self._has_wrench else TareState(bare)
        self._grid, self._state = None, _State(tare=tare)
        self._broken = self._finished = False
        self._samples = self._repeats = 0

    def _take(self, state: _State, anchor: float, block: Block) -> tuple[_State, tuple[GripperEvent, ...]]:
        """Process the grid rows of one stretch without a gap."""
        if block.restarts:
            state = self._restarted(state)
        if len(block.rows) == 0:
            return state, ()
        recent = flange_rows(self.layout, self._columns, block.rows, state.tail, self._arithmetic)
        first = block.first + len(block.rows) - len(recent)  # grid index of the first of these
        gripper = state.gripper
        events: tuple[GripperEvent, ...] = ()
        if "gripper" in self.layout.slices:
            gripper, (events, grips) = self._gripper.advance(gripper, anchor, block.first, block.rows)
            recent[block.first - first :, self._columns.width :] = grips
        tare = state.tare if state.tare.tare is not None else self._tare(state.tare, first, recent)
        filtered = self._filtered(state, anchor, first, recent)
        waiting = (*state.waiting, *filtered)
        after_gap, rows = state.after_gap and not filtered, state.rows + len(filtered)
        tail = self._filter.tail(recent)
        taken = state._replace(
            tail=tail, gripper=gripper, tare=tare, waiting=waiting, after_gap=after_gap, rows=rows
        )
        return taken, events

    def _restarted(self, state: _State) -> _State:
        tare = self._taring.interrupted(state.tare, "samples are missing within the tare window")
        gripper = self._gripper.restarted(state.gripper)
        return state._replace(tail=None, after_gap=True, tare=tare, gripper=gripper)

    def _tare(self, state: TareState, first: int, recent: Array) -> TareState:
        """Pass the rows first, first + 1, … to the tare, as far as it uses them."""
        half, columns = self._filter.half, self._columns
        centres = range(half, min(len(recent) - half, self._taring.last_row + 1 - first))
        fits = [self._fit(recent, i) for i in centres]
        forces = np.array([row[columns.force] for row, _, _ in fits]).reshape(-1, 3)
        speeds = np.array([speed for _, _, speed in fits])
        torques = None
        if columns.torque is not None:
            torques = np.array([in_flange(row, columns) for row, _, _ in fits]).reshape(-1, 3)
        return self._taring.advance(state, first + half, forces, speeds, torques)

    def _fit(self, rows: Array, centre: int) -> tuple[Array, Array, float]:
        """Return the filtered flange row in the middle of a window, its slope [1/s], and the flange's speed
        [m/s].
        """
        both = np.empty((2, rows.shape[1]))
        speed = self._arithmetic.fit_polynomials(rows, centre, self._filter.taps, self._columns.moving, both)
        return both[0], both[1], speed

    def _filtered(self, state: _State, anchor: float, first: int, recent: Array) -> list[FilteredRow]:
        """Return those of the rows first, first + 1, … that are on the segmentation grid, filtered."""
        half, every = self._filter.half, self._every
        filtered: list[FilteredRow] = []
        for i in range(half + -(first + half) % every, len(recent) - half, every):
            row, slope, speed = self._fit(recent, i)
            turn = self._columns.orientation
            filtered.append(
                FilteredRow(
                    number=state.rows + len(filtered),
                    t=self._resampler.time_of(anchor, first + i),
                    row=row,
                    velocity=slope[self._columns.position],
                    speed=speed,
                    speeds=self._speeds(recent, max(i + 1 - every, half), i),
                    after_gap=state.after_gap and not filtered,
                    measured_n=self._measured(recent[i]),
                    turning=None if turn is None else slope[turn],
                    between=recent[i + 1 - every : i, self._pose] if i >= every else None,
                )
            )
        return filtered

    def _measured(self, row: Array) -> float | None:
        """Return the size of a flange row's force [N]; None without a wrench."""
        return math.hypot(*row[self._columns.force].tolist()) if self._has_wrench else None

    def _speeds(self, rows: Array, first: int, last: int) -> Array:
        """Speeds (n,) [m/s] at rows first to last, see `numpy_operations.speeds_of`."""
        speeds = np.empty(last + 1 - first)
        lever = HANDS_BREADTH_M if self._columns.orientation is not None else 0.0
        self._arithmetic.speeds_of(rows, first, self._filter.taps[1], lever, speeds)
        return speeds

    def _released(self, state: _State, grid: GridState | None) -> tuple[_State, tuple[Observation, ...]]:
        """Return the waiting rows as observations once the tare is known."""
        tares, tare = state.tare, state.tare.tare
        if tare is None or grid is None or not state.waiting:
            return state, ()
        turned, bias, recent, observations = state.turned, state.bias, state.recent, []
        for filtered in state.waiting:
            force, after_s = filtered.row[self._columns.force], filtered.t - grid.anchor
            tares = tares.checked(filtered.measured_n, force, filtered.speed, after_s)
            tare = tares.tare or tare
            row = tared_row(filtered.row, self._columns, tare, self._arithmetic)
            if self._columns.orientation is not None:
                turned = turned_to(turned, row[self._columns.orientation])
            force, scale = row[self._columns.force], None
            if self._tracks_bias:
                tracker = _TARED if tare.bias is not None else _UNTARED
                position = row[self._columns.position]
                bias = tracker.advance(bias or tracker.initial_state(position), force, position)
                mean, scale = tracker.estimate(bias)
                force = force - mean
                force.setflags(write=False)
            recent = recent.with_row(filtered, force)
            boundary = recent.boundary(
                self._every,
                self.parameters.grid_hz,
                self._arithmetic,
                contact=self.layout.source.contact_models,
            )
            observations.append(
                observation_of(filtered, row, self._columns, tare, turned, force, scale, boundary)
            )
        state = state._replace(waiting=(), tare=tares, turned=turned, bias=bias, recent=recent)
        return state, tuple(observations)

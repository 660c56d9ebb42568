"""The signals that the page draws of a recording: speed, position and force on one grid of time.

They do not depend on the service's conditioning or its models: an annotation is blind to them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from caesura_protocol.plausibility import METRES
from caesura_protocol.recording import Recording

PLOT_HZ = 100.0  # of the grid, at most
MAX_ROWS = 20_000
SMOOTHING_S = 0.02  # standard deviation of the speed's Gaussian window
HELD_S = 0.06  # a pose repeated for less than this was held between two readings

Array = NDArray[np.float64]


class PlottedSignals(NamedTuple):
    """Signals on a grid.

    t: (n,) [s]; speed: (n,) [mm/s] or [rad/s]; position: (n, k) [mm] or [rad] about its mean;
    force: (n, 3) [N], or None where the recording has none; unit: of the position.
    """

    t: Array
    speed: Array
    position: Array
    force: Array | None
    unit: str

    @property
    def coarse(self) -> str | None:
        """A note on the time between two points if a recording is too long for PLOT_HZ; else None."""
        if self.t.size < MAX_ROWS:
            return None
        span = float(self.t[-1] - self.t[0])
        return (
            f"a point is drawn every {span / (MAX_ROWS - 1):.2g} s, because the recording lasts "
            f"{span:.0f} s; parts of at most {MAX_ROWS / PLOT_HZ:.0f} s have one every {1 / PLOT_HZ:g} s"
        )

    def as_payload(self, start_s: float = 0.0) -> dict[str, Any]:
        """Return the signals for the browser: lists, one per line; times relative to start_s [s]."""
        return {
            "t": np.round(self.t - start_s, 4).tolist(),
            "speed": np.round(self.speed, 3).tolist(),
            "position": np.round(self.position.T, 3).tolist(),
            "force": None if self.force is None else np.round(self.force.T, 3).tolist(),
            "unit": self.unit,
        }


def plotted_signals(recording: Recording) -> PlottedSignals:
    """Resample a recording for the page.

    Poses that the robot repeats between two readings are dropped first: the speed between them would be zero.
    """
    order = np.unique(recording.t, return_index=True)[1]
    t = recording.t[order]
    grid = _grid(t)
    position, unit = _position(recording, order)
    kept = _readings(t, position)
    on_grid = _interpolate(grid, t[kept], position[kept])
    force = recording.signals.get("force")
    return PlottedSignals(
        grid,
        _speed(grid, on_grid),
        on_grid - on_grid.mean(axis=0),
        None if force is None else _cell_means(grid, t, force[order]),
        unit,
    )


def _grid(t: Array) -> Array:
    """Return the times of the grid: as fine as the samples, PLOT_HZ and MAX_ROWS at most."""
    span = float(t[-1] - t[0])
    steps = min(t.size - 1, max(int(span * PLOT_HZ), 1), MAX_ROWS - 1)
    return np.linspace(float(t[0]), float(t[-1]), steps + 1)


def _position(recording: Recording, order: NDArray[np.intp]) -> tuple[Array, str]:
    """Return the flange's position [mm], or the joints [rad] without one."""
    if "pos" in recording.signals:
        return 1e3 * METRES[recording.length_unit] * recording.signals["pos"][order], "mm"
    return recording.signals["q"][order], "rad"


def _readings(t: Array, position: Array) -> NDArray[np.intp]:
    """Return the samples that are readings: the first of a run of equal poses, and the last of a long one."""
    changed = np.flatnonzero(np.r_[True, (np.diff(position, axis=0) != 0.0).any(axis=1)])
    last = np.r_[changed[1:], t.size] - 1
    long = t[last] - t[changed] >= HELD_S
    return np.unique(np.r_[changed, last[long], t.size - 1])


def _interpolate(grid: Array, t: Array, values: Array) -> Array:
    return np.stack([np.interp(grid, t, column) for column in values.T], axis=1)


def _cell_means(grid: Array, t: Array, values: Array) -> Array:
    """Return the mean of the samples in each cell of the grid, interpolated where a cell has none."""
    step = grid[1] - grid[0] if grid.size > 1 else 1.0
    cell = np.clip(np.rint((t - grid[0]) / step).astype(np.intp), 0, grid.size - 1)
    count = np.bincount(cell, minlength=grid.size)
    full = count > 0
    sums = (np.bincount(cell, weights=column, minlength=grid.size) for column in values.T)
    means = np.stack([total[full] / count[full] for total in sums], axis=1)
    return _interpolate(grid, grid[full], means)


def _speed(grid: Array, position: Array) -> Array:
    """Return the norm of the smoothed velocity, per second."""
    if grid.size < 2:
        return np.zeros(grid.size)
    step = float(grid[1] - grid[0])
    velocity = np.gradient(position, step, axis=0)
    half = int(np.ceil(3 * max(SMOOTHING_S, step) / step))
    window = np.exp(-0.5 * (np.arange(-half, half + 1) * step / max(SMOOTHING_S, step)) ** 2)
    weight = np.convolve(np.ones(grid.size), window, "full")[half : half + grid.size]
    smooth = [np.convolve(column, window, "full")[half : half + grid.size] / weight for column in velocity.T]
    speed: Array = np.sqrt(np.square(smooth).sum(axis=0))
    return speed

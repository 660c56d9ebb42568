"""The arithmetic of conditioning, in NumPy: the reference of `kernels`, and their replacement without numba.

Each function writes into its last argument. Results for a row do not depend on the other rows of a call.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from caesura_service.signals import rotation
from caesura_service.signals.cell_average import cell_means, held_values
from caesura_service.signals.rotation import length, lengths, normalised, rotated

Array = NDArray[np.float64]
Places = NDArray[np.int64]

# Columns of a flange row: position, force, and a quaternion where there is one.
FORCE, TURN = 3, 6
# Where a column of a flange row comes from, if not from a column of the grid row.
FILLED, LEFT_OPEN = -1, -2
ALIKE_M_PER_S = 1e-9  # speeds that are closer differ by rounding alone


def copy_columns(samples: Array, plan: Array, quaternion: int, tolerance: float, taken: Array) -> bool:
    """Copy and scale columns of samples (n, columns) into (n, taken); return whether all values are valid.

    plan: (3, columns) the limit of a column's absolute value, its target column, -1 for none, and its scale.
    Nan is invalid in every column.
    quaternion: the first target column of a quaternion, -1 without one; its length must be 1 ± tolerance.
    """
    limits, places, scales = plan
    if np.count_nonzero(np.abs(samples) <= limits) < samples.size:
        return False
    used = places >= 0
    taken[:, places[used].astype(np.intp)] = samples[:, used] * scales[used]
    if quaternion < 0:
        return True
    off = np.abs(lengths(taken[:, quaternion : quaternion + 4]) - 1.0)
    return bool(np.count_nonzero(off <= tolerance) == off.size)


def is_steady(samples: Array, latest: float, gap_limit_s: float) -> bool:
    """Return whether the times increase strictly, and end at most gap_limit_s after `latest` [s]."""
    times = samples[:, 0]
    if not times.size or not (times[0] > latest and times[-1] - latest <= gap_limit_s):
        return False
    return not np.count_nonzero(times[1:] <= times[:-1])


def make_sign_continuous(samples: Array, at: int) -> None:
    """Negate quaternions, in the columns from `at` on, so that successive ones have dot products >= 0."""
    rotation.make_sign_continuous(samples[:, at : at + 4])


def interpolate_holds(samples: Array, pose: int, beside: int, posed: float, hold_limit_s: float) -> float:
    """Interpolate poses of samples (m, 1 + c) that repeat the one before, between those that are new.

    pose: number of columns after the time that are the pose; beside: number of columns after these that are
    interpolated with it if they repeat as well; posed: time [s] of the last sample known to have a new pose;
    earlier samples are unchanged. A pose that is held for longer than hold_limit_s [s] is unchanged too.
    Returns the time of the last sample with a new pose.
    """
    times, poses, along = samples[:, 0], samples[:, 1 : 1 + pose], samples[:, 1 + pose : 1 + pose + beside]
    first = int(times.searchsorted(posed))
    changed = np.flatnonzero((poses[first + 1 :] != poses[first:-1]).any(axis=1)) + first + 1
    for last, new in pairwise([first, *changed.tolist()]):
        if times[new] - posed <= hold_limit_s:
            repeats = bool((along[last + 1 : new] == along[last]).all())
            _bridge(times, samples[:, 1 : 1 + pose + beside * repeats], last, new)
        posed = float(times[new])
    return posed


def _bridge(times: Array, values: Array, last: int, new: int) -> None:
    """Interpolate the values (m, c) between two samples linearly."""
    held = slice(last + 1, new)
    share = (times[held] - times[last]) / (times[new] - times[last])
    values[held] += share[:, None] * (values[new] - values[last])


def resample(samples: Array, anchor: float, grid_hz: float, first: int, held: int, rows: Array) -> None:
    """Compute the grid rows first, first + 1, … of samples (m, 1 + c), which span their cells.

    held: number of the last columns that are held. rows: (n + 1, c); the content of the last one is
    undefined.
    """
    numbers = np.arange(first, first + len(rows), dtype=np.float64)
    rows[:-1] = cell_means(anchor + (numbers - 0.5) / grid_hz, samples)
    if held:
        rows[:-1, -held:] = held_values(anchor + numbers[:-1] / grid_hz, samples)[:, -held:]


def flange_rows(
    rows: Array, before: Array, sources: Places, oriented: bool, turned: bool, flange: Array
) -> None:
    """Compute flange rows (m + n, columns): earlier ones (m, columns), followed by those of grid rows (n, c).

    sources: (columns,) the source column of the grid row; FILLED: the value is already there; LEFT_OPEN: nan.
    oriented: whether there are quaternions, which are scaled to unit length and made sign-continuous. turned:
    whether forces are rotated by them.
    """
    flange[: len(before)] = before
    fresh = flange[len(before) :]
    fresh[:, sources >= 0] = rows[:, sources[sources >= 0]]
    fresh[:, sources == LEFT_OPEN] = np.nan
    turn = slice(TURN, TURN + 4)
    if oriented:
        fresh[:, turn] = normalised(fresh[:, turn])
        make_sign_continuous(flange[max(0, len(before) - 1) :], TURN)
    if turned:
        fresh[:, FORCE : FORCE + 3] = rotated(fresh[:, turn], fresh[:, FORCE : FORCE + 3])


def openings(
    rows: Array,
    before: Array,
    opened: float,
    measured: bool,
    closed_below: float,
    recent: Array,
    grips: Array,
) -> float:
    """Compute openings (m + n,) [m]: earlier ones (m,), followed by those of grid rows (n, c), from their
    last column.

    opened: the opening that a flag of 0 stands for, 0 without a flag. grips: (n, 2) width, nan unless
    measured, and whether it is at most closed_below, nan if that is nan. Returns the range of all these
    openings [m].
    """
    values = rows[:, -1]
    recent[: len(before)] = before
    now = recent[len(before) :]
    now[:] = opened * (1.0 - values) if opened else values
    grips[:, 0] = now if measured else np.nan
    grips[:, 1] = np.nan if np.isnan(closed_below) else now <= closed_below
    return float(recent.max() - recent.min())


def fit_polynomials(rows: Array, centre: int, taps: Array, moving: int, both: Array) -> float:
    """Compute value and slope, (2, columns), of the polynomials through rows (n, columns) at their centre.

    taps: (2, window) weights of the rows. Columns from `moving` on are copied from the centre row. Returns
    the flange's speed [m/s].
    """
    first, window = centre - taps.shape[1] // 2, taps.shape[1]
    both[0], both[1] = rows[centre], 0.0
    both[:, :moving] = np.add.reduce(taps[:, :, None] * rows[first : first + window, :moving], axis=1)
    return length(both[1, :FORCE])


def speeds_of(rows: Array, first: int, slopes: Array, lever: float, speeds: Array) -> None:
    """Compute speeds (n,) [m/s] at rows first, first + 1, …: the flange's, or that of a lever by its rotation
    if greater.

    slopes: (window,) weights of the rows in the slope of a polynomial. lever: length [m]; 0 without a
    quaternion. A unit quaternion changes by half the rotation.
    """
    window = len(slopes)
    for k in range(len(speeds)):
        start = first + k - window // 2
        slope = np.add.reduce(slopes[:, None] * rows[start : start + window], axis=0)
        speeds[k] = length(slope[:FORCE])
        if lever:
            speeds[k] = max(speeds[k], 2.0 * lever * length(slope[TURN : TURN + 4]))


def boundary_row(speeds: Array, first: int, last: int, creep: float, rest: float) -> int:
    """Return the row, of rows first to last of speeds (n,) [m/s], at which a boundary lies.

    It is the row nearest to where the speed rises above `rest` for the last time, or falls to it for the
    first. Without either it is the slowest row of a movement, or the fastest of a rest, the first of equal
    ones. In a rest that is never faster than `creep` it is the middle one. creep, rest: [m/s].
    """
    seen = speeds[first : last + 1]
    moving = seen >= rest
    if moving[0] == moving[-1]:
        extreme = float(seen.min() if moving[0] else seen.max())
        at = int(np.argmax(np.abs(seen - extreme) <= ALIKE_M_PER_S))
        return first + at if moving[0] or extreme >= creep else (first + last) // 2
    passes = np.flatnonzero(moving[:-1] != moving[1:])
    at = int(passes[-1] if moving[-1] else passes[0])
    return first + at + int(abs(seen[at + 1] - rest) < abs(seen[at] - rest))


def subtract_bias_and_normalise(x: float, y: float, z: float, oriented: bool, row: Array) -> None:
    """Subtract a bias from the force of a flange row (columns,), and scale its quaternion to unit length."""
    row[FORCE : FORCE + 3] -= (x, y, z)
    if oriented:
        row[TURN : TURN + 4] /= length(row[TURN : TURN + 4])

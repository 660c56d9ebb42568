"""The operations of `numpy_operations`, compiled: samples to grid rows, to flange rows, and their filter."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.numba_support.decorators import compiled
from caesura_service.signals.numpy_operations import ALIKE_M_PER_S, FORCE, LEFT_OPEN, TURN


@compiled
def copy_columns(samples, plan, quaternion, tolerance, taken):
    """Compute as `numpy_operations.copy_columns`."""
    beyond = False
    for c in range(samples.shape[1]):
        limit, place, scale = plan[0, c], int(plan[1, c]), plan[2, c]
        for i in range(samples.shape[0]):
            beyond |= not abs(samples[i, c]) <= limit
            if place >= 0:
                taken[i, place] = samples[i, c] * scale
    if quaternion >= 0:
        for i in range(samples.shape[0]):
            beyond |= not abs(norm(taken[i, quaternion:]) - 1.0) <= tolerance
    return not beyond


@compiled
def is_steady(samples, latest, gap_limit_s):
    """Compute as `numpy_operations.is_steady`."""
    n = samples.shape[0]
    if n == 0 or not (samples[0, 0] > latest and samples[n - 1, 0] - latest <= gap_limit_s):
        return False
    ascending = True
    for i in range(1, n):
        ascending &= samples[i - 1, 0] < samples[i, 0]
    return ascending


@compiled
def make_sign_continuous(samples, at):
    """Compute as `numpy_operations.make_sign_continuous`."""
    for i in range(1, samples.shape[0]):
        follow_sign(samples[i - 1, at:], samples[i, at:])


@compiled
def norm(quaternion):
    """Return the length of a quaternion."""
    return math.sqrt(quaternion[0] ** 2 + quaternion[1] ** 2 + quaternion[2] ** 2 + quaternion[3] ** 2)


@compiled
def follow_sign(before, quaternion):
    """Negate a quaternion if its dot product with the one before it is negative."""
    along = 0.0
    for c in range(4):
        along += before[c] * quaternion[c]
    if along < 0.0:
        for c in range(4):
            quaternion[c] = -quaternion[c]


@compiled
def interpolate_holds(samples, pose, beside, posed, hold_limit_s):
    """Compute as `numpy_operations.interpolate_holds`."""
    last = first_from(samples, 0, posed)
    for i in range(last + 1, samples.shape[0]):
        if not differs(samples[i], samples[i - 1], 1, 1 + pose):
            continue
        if i > last + 1 and samples[i, 0] - posed <= hold_limit_s:
            repeats = True
            for k in range(last + 1, i):
                repeats &= not differs(samples[k], samples[last], 1 + pose, 1 + pose + beside)
            bridge(samples, last, i, pose + beside if repeats else pose)
        last, posed = i, samples[i, 0]
    return posed


@compiled
def differs(sample, other, start, stop):
    """Return whether two samples differ in some of the columns from `start` to `stop`."""
    unlike = False
    for c in range(start, stop):
        unlike |= sample[c] != other[c]
    return unlike


@compiled
def bridge(samples, last, new, width):
    """Interpolate the first `width` values linearly between two samples."""
    for i in range(last + 1, new):
        share = (samples[i, 0] - samples[last, 0]) / (samples[new, 0] - samples[last, 0])
        for c in range(1, 1 + width):
            samples[i, c] += share * (samples[new, c] - samples[last, c])


@compiled
def resample(samples, anchor, grid_hz, first, held, rows):
    """`numpy_operations.resample`. A row is first the interpolant at its cell's left edge, then the mean."""
    count = rows.shape[0] - 1
    after = 0
    for k in range(count + 1):
        edge = anchor + (first + k - 0.5) / grid_hz
        after = first_from(samples, after, edge)
        interpolate(samples, max(after - 1, 0), edge, rows[k])
    after = last = 0
    for k in range(count):
        left, right = anchor + (first + k - 0.5) / grid_hz, anchor + (first + k + 0.5) / grid_hz
        start = first_from(samples, after, left)
        after = first_from(samples, start, right)
        average(samples, start, after, left, right, rows[k], rows[k + 1])
        while last + 1 < samples.shape[0] and samples[last + 1, 0] <= anchor + (first + k) / grid_hz:
            last += 1
        for c in range(rows.shape[1] - held, rows.shape[1]):
            rows[k, c] = samples[last, 1 + c]


@compiled
def first_from(samples, i, t):
    """Return the index of the first sample at t [s] or later, searched from i."""
    while i < samples.shape[0] and samples[i, 0] < t:
        i += 1
    return i


@compiled
def interpolate(samples, i, t, row):
    """Interpolate linearly between samples i and i + 1."""
    part = (t - samples[i, 0]) / (samples[i + 1, 0] - samples[i, 0])
    for c in range(row.size):
        row[c] = samples[i, 1 + c] + (samples[i + 1, 1 + c] - samples[i, 1 + c]) * part


@compiled
def average(samples, start, stop, left, right, row, following):
    """Replace `row`, the values at the left edge, by the mean up to the right edge (trapezium rule).

    start, stop: the samples between the edges; following: the values at the right edge.
    """
    if start == stop:
        for c in range(row.size):
            row[c] = 0.5 * (row[c] + following[c])
        return
    step = samples[start, 0] - left
    for c in range(row.size):
        row[c] = (row[c] + samples[start, 1 + c]) * step
    for i in range(start + 1, stop):
        step = samples[i, 0] - samples[i - 1, 0]
        for c in range(row.size):
            row[c] += (samples[i - 1, 1 + c] + samples[i, 1 + c]) * step
    step, both = right - samples[stop - 1, 0], 2.0 * (right - left)
    for c in range(row.size):
        row[c] = (row[c] + (samples[stop - 1, 1 + c] + following[c]) * step) / both


@compiled
def flange_rows(rows, before, sources, oriented, turned, flange):
    """Compute as `numpy_operations.flange_rows`."""
    known = before.shape[0]
    for i in range(known):
        for c in range(flange.shape[1]):
            flange[i, c] = before[i, c]
    for i in range(known, flange.shape[0]):
        row = flange[i]
        for c in range(row.size):
            if sources[c] >= 0:
                row[c] = rows[i - known, sources[c]]
            elif sources[c] == LEFT_OPEN:
                row[c] = math.nan
        if oriented:
            normalise(row)
            if i > 0:
                follow_sign(flange[i - 1, TURN:], row[TURN:])
        if turned:
            rotate(row)


@compiled
def normalise(row):
    """Scale a flange row's quaternion to unit length."""
    length = norm(row[TURN:])
    for c in range(TURN, TURN + 4):
        row[c] /= length


@compiled
def rotate(row):
    """Rotate a flange row's force by its quaternion: v + 2w (u × v) + 2u × (u × v)."""
    x, y, z, w = row[TURN], row[TURN + 1], row[TURN + 2], row[TURN + 3]
    u, v, s = row[FORCE], row[FORCE + 1], row[FORCE + 2]
    a, b, c = 2.0 * (y * s - z * v), 2.0 * (z * u - x * s), 2.0 * (x * v - y * u)
    row[FORCE] = u + w * a + (y * c - z * b)
    row[FORCE + 1] = v + w * b + (z * a - x * c)
    row[FORCE + 2] = s + w * c + (x * b - y * a)


@compiled
def openings(rows, before, opened, measured, closed_below, recent, grips):
    """Compute as `numpy_operations.openings`."""
    known, column = before.size, rows.shape[1] - 1
    least, most = math.inf, -math.inf
    for i in range(known):
        recent[i] = before[i]
        least, most = min(least, before[i]), max(most, before[i])
    for i in range(rows.shape[0]):
        value = rows[i, column]
        now = opened * (1.0 - value) if opened else value
        recent[known + i] = now
        least, most = min(least, now), max(most, now)
        grips[i, 0] = now if measured else math.nan
        grips[i, 1] = 1.0 if now <= closed_below else 0.0
        if math.isnan(closed_below):
            grips[i, 1] = math.nan
    return most - least


@compiled
def fit_polynomials(rows, centre, taps, moving, both):
    """Compute as `numpy_operations.fit_polynomials`."""
    window = taps.shape[1]
    first = centre - window // 2
    value, slope = both[0], both[1]
    for c in range(value.size):
        value[c] = rows[centre, c] if c >= moving else 0.0
        slope[c] = 0.0
    for k in range(window):
        for c in range(moving):
            value[c] += taps[0, k] * rows[first + k, c]
            slope[c] += taps[1, k] * rows[first + k, c]
    return math.sqrt(slope[0] ** 2 + slope[1] ** 2 + slope[2] ** 2)


@compiled
def speeds_of(rows, first, slopes, lever, speeds):
    """Compute as `numpy_operations.speeds_of`."""
    window = slopes.size
    for k in range(speeds.size):
        start = first + k - window // 2
        moved2 = turned2 = 0.0
        for c in range(FORCE):
            moved2 += slope_at(rows, start, c, slopes) ** 2
        if lever:
            for c in range(TURN, TURN + 4):
                turned2 += slope_at(rows, start, c, slopes) ** 2
        speeds[k] = max(math.sqrt(moved2), 2.0 * lever * math.sqrt(turned2))


@compiled
def slope_at(rows, start, c, slopes):
    """Return the slope of a column at the middle of a window that begins at `start`."""
    slope = 0.0
    for k in range(slopes.size):
        slope += slopes[k] * rows[start + k, c]
    return slope


@compiled
def boundary_row(speeds, first, last, creep, rest):
    """Compute as `numpy_operations.boundary_row`."""
    starts, ends = speeds[first] >= rest, speeds[last] >= rest
    at = first
    if starts == ends:
        extreme = speeds[first]
        for k in range(first, last + 1):
            extreme = min(extreme, speeds[k]) if starts else max(extreme, speeds[k])
        for k in range(first, last + 1):
            if abs(speeds[k] - extreme) <= ALIKE_M_PER_S:
                at = k
                break
        return at if starts or extreme >= creep else (first + last) // 2
    for k in range(first, last):
        if (speeds[k] >= rest) != (speeds[k + 1] >= rest):
            at = k
            if starts:
                break
    nearer = abs(speeds[at + 1] - rest) < abs(speeds[at] - rest)
    return at + 1 if nearer else at


@compiled
def subtract_bias_and_normalise(x, y, z, oriented, row):
    """Compute as `numpy_operations.subtract_bias_and_normalise`."""
    row[FORCE] -= x
    row[FORCE + 1] -= y
    row[FORCE + 2] -= z
    if oriented:
        normalise(row)

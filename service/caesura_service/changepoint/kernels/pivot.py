"""`TurnInPlace`: a linear regression on the centre of a turn, in running sums."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import logarithms
from caesura_service.changepoint.kernels.layout import AXES
from caesura_service.changepoint.kernels.residuals import BY_LENGTH, fill_length, whole
from caesura_service.numba_support.decorators import compiled

START, GRAM, CROSS, SQUARES, LOG_SCALES, NEAR = 0, 3, 9, 12, 13, 14  # fields
LEFT, DETERMINANT = 0, 1  # rows of the work
SMALL_ANGLE_RAD = 1e-6


@compiled
def pivot(here, c):
    """`TurnInPlace`. Fields: start 3, ΣEᵀE 6, ΣEᵀy 3, Σ|y|², Σ log w, Σ log weight."""
    model, state = model_at(here), state_at(here)
    channel, living, past = model.channels[c], state.counters[0].living, state.past
    sums, last = state.sums[channel.field : channel.field + 15], past.shape[0] - 1
    x, y, z = past[last - 1, 0], past[last - 1, 1], past[last - 1, 2]
    sums[START, living - 1], sums[START + 1, living - 1], sums[START + 2, living - 1] = x, y, z
    add_step(sums, past, channel, whole(living))
    fill_length(here, c)
    regress(here, channel, sums, state.channel[c])


@compiled
def add_step(sums, past, channel, lanes):
    """One more observation to the sums."""
    last = past.shape[0] - 1
    x, y, z = past[last - 1, 0], past[last - 1, 1], past[last - 1, 2]
    u = past[last, 3] - past[last - 1, 3]
    v = past[last, 4] - past[last - 1, 4]
    w = past[last, 5] - past[last - 1, 5]
    angle2 = u * u + v * v + w * w
    angle = math.sqrt(angle2)
    small = angle < SMALL_ANGLE_RAD
    first = 1.0 if small else math.sin(angle) / angle
    second = 0.5 if small else (1.0 - math.cos(angle)) / angle2
    # E = first [φ]× + second [φ]×²; with |Eᵀ a| the same as |E a|, EᵀE = (first² + second² φ²) (φ² I − φφᵀ).
    size = first * first + second * second * angle2
    scale2 = channel.floor2 + channel.scale2 * angle2
    e = rotation_less_identity(u, v, w, first, second)
    move_x, move_y, move_z = past[last, 0] - x, past[last, 1] - y, past[last, 2] - z
    step2 = move_x**2 + move_y**2 + move_z**2
    near = -0.5 * (step2 / (channel.floor2 + channel.reach2 * angle2)) ** 2
    for i in range(lanes):
        sums[NEAR, i] += near
        sums[GRAM, i] += size * (angle2 - u * u) / scale2
        sums[GRAM + 1, i] -= size * u * v / scale2
        sums[GRAM + 2, i] -= size * u * w / scale2
        sums[GRAM + 3, i] += size * (angle2 - v * v) / scale2
        sums[GRAM + 4, i] -= size * v * w / scale2
        sums[GRAM + 5, i] += size * (angle2 - w * w) / scale2
        # The centre is counted from each start.
        from_x, from_y, from_z = x - sums[START, i], y - sums[START + 1, i], z - sums[START + 2, i]
        y_x = move_x - (e[0] * from_x + e[1] * from_y + e[2] * from_z)
        y_y = move_y - (e[3] * from_x + e[4] * from_y + e[5] * from_z)
        y_z = move_z - (e[6] * from_x + e[7] * from_y + e[8] * from_z)
        sums[CROSS, i] += (e[0] * y_x + e[3] * y_y + e[6] * y_z) / scale2
        sums[CROSS + 1, i] += (e[1] * y_x + e[4] * y_y + e[7] * y_z) / scale2
        sums[CROSS + 2, i] += (e[2] * y_x + e[5] * y_y + e[8] * y_z) / scale2
        sums[SQUARES, i] += (y_x * y_x + y_y * y_y + y_z * y_z) / scale2
        sums[LOG_SCALES, i] += 0.5 * math.log(scale2)


@compiled
def rotation_less_identity(u, v, w, first, second):
    """(9,) E row by row: first [φ]× + second [φ]×² of φ = (u, v, w)."""
    angle2 = u * u + v * v + w * w
    return (
        second * (u * u - angle2),
        second * u * v - first * w,
        second * u * w + first * v,
        second * u * v + first * w,
        second * (v * v - angle2),
        second * v * w - first * u,
        second * u * w - first * v,
        second * v * w + first * u,
        second * (w * w - angle2),
    )


@compiled
def regress(here, channel, sums, evidence):
    """`TurnInPlace.log_evidence`; `fill_length` has put what depends on length alone into the work."""
    state = state_at(here)
    work, lanes, weight = state.work, whole(state.counters[0].living), 1.0 / channel.reach2
    solve(sums, work[LEFT], work[DETERMINANT], weight, channel.nu0, lanes)
    logarithms(work[LEFT], lanes)
    logarithms(work[DETERMINANT], lanes)
    half0, half, constant = 0.5 * channel.nu0, 0.5 * channel.pooled, 0.5 * AXES * math.log(weight)
    by_length = work[BY_LENGTH]
    for i in range(lanes):
        density = by_length[i] - (half0 + half * state.ages[i]) * work[LEFT, i]
        evidence[i] = (
            density - 0.5 * work[DETERMINANT, i] + constant - AXES * sums[LOG_SCALES, i] + sums[NEAR, i]
        )


@compiled
def solve(sums, left, determinant, weight, nu0, lanes):
    """ν₀ + the squares that no centre explains, and the determinant of the centre's precision."""
    for i in range(lanes):
        a, b, c = sums[GRAM, i], sums[GRAM + 1, i], sums[GRAM + 2, i]
        d, e, f = sums[GRAM + 3, i], sums[GRAM + 4, i], sums[GRAM + 5, i]
        u, v, w = sums[CROSS, i], sums[CROSS + 1, i], sums[CROSS + 2, i]
        a, d, f = a + weight, d + weight, f + weight
        over_x, over_y, over_z = d * f - e * e, c * e - b * f, b * e - c * d
        det = a * over_x + b * over_y + c * over_z
        explained = u * u * over_x + v * v * (a * f - c * c) + w * w * (a * d - b * b)
        explained += 2.0 * (u * v * over_y + u * w * over_z + v * w * (b * c - a * e))
        left[i] = nu0 + max(sums[SQUARES, i] - explained / det, 0.0)
        determinant[i] = det

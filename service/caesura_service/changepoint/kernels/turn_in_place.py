"""`TurnInPlace`: a linear regression on the centre of a turn, by the triangle of a QR decomposition."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import logarithms
from caesura_service.changepoint.kernels.layout import AXES
from caesura_service.changepoint.kernels.residual_evidence import BY_LENGTH, fill_length, lanes_of
from caesura_service.numba_support.decorators import compiled

START, TRIANGLE, LEFT, LOG_SCALES, NEAR = 0, 3, 12, 13, 14  # fields
DIAGONAL = (TRIANGLE, TRIANGLE + 4, TRIANGLE + 7)
SQUARES, DETERMINANT, ROW = 0, 1, 5  # rows of the work; of an equation there are 3 coefficients and y
SMALL_ANGLE_RAD = 1e-6


@compiled
def turn_in_place(ctx, c):
    """`TurnInPlace`. Fields: start 3, triangle row by row 4 + 3 + 2, squares left, Σ log w, Σ log weight."""
    model, state = model_at(ctx), state_at(ctx)
    channel, living, past = model.channels[c], state.counters[0].living, state.past
    sums, last = state.sums[channel.field : channel.field + 15], past.shape[0] - 1
    begin(sums, living - 1, past[last - 1], channel)
    add_step(sums, state.work, past, channel, lanes_of(living))
    fill_length(ctx, c, 0)
    regress(ctx, channel, sums, state.channel[c])


@compiled
def begin(sums, newborn, place, channel):
    """Initialise a segment that begins at a place with the triangle of the prior."""
    sums[:, newborn] = 0.0
    for a in range(AXES):
        sums[START + a, newborn] = place[a]
    for field in DIAGONAL:
        sums[field, newborn] = 1.0 / math.sqrt(channel.reach2)


@compiled
def add_step(sums, work, past, channel, lanes):
    """Add the three equations of one more observation to each triangle."""
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
    scale2 = channel.floor2 + channel.scale2 * angle2
    scale = math.sqrt(scale2)
    e = rotation_less_identity(u, v, w, first, second)
    move = (past[last, 0] - x, past[last, 1] - y, past[last, 2] - z)
    step2 = move[0] ** 2 + move[1] ** 2 + move[2] ** 2
    near = -0.5 * (step2 / (channel.floor2 + channel.reach2 * angle2)) ** 2
    for i in range(lanes):
        sums[NEAR, i] += near
        sums[LOG_SCALES, i] += 0.5 * math.log(scale2)
    for a in range(AXES):
        e_x, e_y, e_z = e[AXES * a], e[AXES * a + 1], e[AXES * a + 2]
        for i in range(lanes):
            # The centre is counted from each start.
            from_x, from_y, from_z = x - sums[START, i], y - sums[START + 1, i], z - sums[START + 2, i]
            work[ROW, i], work[ROW + 1, i], work[ROW + 2, i] = e_x / scale, e_y / scale, e_z / scale
            work[ROW + 3, i] = (move[a] - (e_x * from_x + e_y * from_y + e_z * from_z)) / scale
        for k in range(AXES):
            rotate(sums, work, k, lanes)
        for i in range(lanes):
            sums[LEFT, i] += work[ROW + 3, i] ** 2


@compiled
def rotate(sums, work, k, lanes):
    """Apply a Givens rotation of an equation with row k of each triangle, so that coefficient k becomes 0."""
    at = DIAGONAL[k]
    for i in range(lanes):
        diagonal, coefficient = sums[at, i], work[ROW + k, i]
        length = math.sqrt(diagonal * diagonal + coefficient * coefficient)
        cosine, sine = diagonal / length, coefficient / length
        sums[at, i] = length
        for j in range(1, AXES + 1 - k):
            above, ctx = sums[at + j, i], work[ROW + k + j, i]
            sums[at + j, i] = cosine * above + sine * ctx
            work[ROW + k + j, i] = cosine * ctx - sine * above


@compiled
def rotation_less_identity(u, v, w, first, second):
    """Return (9,) E row by row: first [φ]× + second [φ]×² of φ = (u, v, w)."""
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
def regress(ctx, channel, sums, evidence):
    """Compute `TurnInPlace.log_evidence`; `fill_length` has stored the terms that depend on length alone."""
    state = state_at(ctx)
    work, lanes = state.work, lanes_of(state.counters[0].living)
    x, y, z = DIAGONAL
    for i in range(lanes):
        work[SQUARES, i] = channel.nu0 + sums[LEFT, i]
        work[DETERMINANT, i] = sums[x, i] * sums[y, i] * sums[z, i]  # its root
    logarithms(work[SQUARES], lanes)
    logarithms(work[DETERMINANT], lanes)
    half0, half, constant = 0.5 * channel.nu0, 0.5 * channel.pooled, -0.5 * AXES * math.log(channel.reach2)
    by_length = work[BY_LENGTH]
    for i in range(lanes):
        density = by_length[i] - (half0 + half * state.ages[i]) * work[SQUARES, i]
        evidence[i] = density - work[DETERMINANT, i] + constant - AXES * sums[LOG_SCALES, i] + sums[NEAR, i]

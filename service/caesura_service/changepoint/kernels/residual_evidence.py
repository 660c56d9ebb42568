"""Common parts of channel models: displacements from each hypothesis' origin, and the evidence of squared
residuals.

All hypotheses are processed in one loop over whole vectors; entries after the living ones are undefined.
`work` holds intermediate results; this module names its rows.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

import numpy as np

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import logarithms
from caesura_service.changepoint.kernels.layout import AXES, FIRST, PREVIOUS, VECTOR
from caesura_service.numba_support.decorators import compiled, inlined

LOG_2PI = math.log(2.0 * math.pi)
TINY = float(np.finfo(np.float64).tiny)
SQUARES = 0  # what is new in an observation, then sums of squared residuals, then their logarithms: 3 axes
MOVED = 3  # squared length of the way so far
BY_LENGTH = 4


@inlined
def lanes_of(n):
    """Return n rounded up to a multiple of VECTOR."""
    return (n + VECTOR - 1) // VECTOR * VECTOR


@compiled
def log_presence(squared, least):
    """Return `channel_model.log_presence` of one squared value."""
    if least == 0.0:
        return 0.0
    return math.log(max(-math.expm1(-0.5 * squared / least**2), TINY))


@compiled
def log_absence(squared, most):
    """Return `channel_model.log_absence` of one squared value."""
    if most == 0.0:
        return 0.0
    return -0.5 * squared / most**2


@compiled
def student(constant, nu, squared, scale2):
    """Return `evidence.student_log_density`; constant: the terms that do not depend on the squared length."""
    return constant - 0.5 * (nu + AXES) * math.log1p(squared / (nu * scale2))


@compiled
def step_squared(ctx, signal, joins):
    """Return the squared length of the step from the observation before; 0 without one."""
    state = state_at(ctx)
    total = 0.0
    if joins:
        for a in range(AXES):
            total += (state.now[signal + a] - state.previous[signal + a]) ** 2
    return total


@compiled
def way_squared(past, first, last):
    """Return the squared distance [m²] between the positions of two observations of `state.past`."""
    total = 0.0
    for a in range(AXES):
        total += (past[last, a] - past[first, a]) ** 2
    return total


@compiled
def add_values(sums, values, lanes):
    """Add each value to its sum."""
    for i in range(lanes):
        sums[i] += values[i]


@compiled
def by_length(ctx, c, n):
    """Return the terms of the log evidence, on one group of axes, that depend on n samples alone."""
    model = model_at(ctx)
    if n < model.by_length.shape[1]:
        return model.by_length[c, n]
    channel = model.channels[c]
    values = channel.pooled * (n - channel.unvalued)
    gammas = math.lgamma(0.5 * (channel.nu0 + values)) - math.lgamma(0.5 * channel.nu0)
    return (
        gammas
        - 0.5 * values * math.log(math.pi)
        + channel.whitening * (n - channel.unwhitened)
        + channel.offset
    )


@compiled
def fill_length(ctx, c, before):
    """Fill `work[BY_LENGTH]` with the terms of each hypothesis' log evidence that depend on its length
    alone.

    before: observations before the start that count, too.
    """
    model, state = model_at(ctx), state_at(ctx)
    groups = 1.0 if model.channels[c].joint else float(AXES)
    me, evidence = state.counters[0], state.work[BY_LENGTH]
    for i in range(me.living):
        evidence[i] = groups * by_length(ctx, c, before + int(state.ages[i]))


@compiled
def follow_origin(ctx, channel, joins):
    """Compute the displacement from each hypothesis' origin, its innovation and its squared length.

    Fields: origin 3, y 3. The last hypothesis has just begun.
    """
    state = state_at(ctx)
    newborn, sums, work, at = state.counters[0].living - 1, state.sums, state.work, channel.field
    lanes = lanes_of(newborn + 1)
    work[MOVED, :lanes] = 0.0
    for a in range(AXES):
        z, y = state.now[channel.signal + a], sums[at + AXES + a]
        if channel.origin == PREVIOUS and joins:
            sums[at + a, newborn] = state.previous[channel.signal + a]
        elif channel.origin in (FIRST, PREVIOUS):
            sums[at + a, newborn] = z
        whiten(work[SQUARES + a], y, sums[at + a], z, channel.rho, channel.white, lanes)
        if channel.origin != PREVIOUS:
            work[SQUARES + a, newborn] = y[newborn]
        add_square(work[MOVED], y, lanes)


@compiled
def whiten(new, y, origin, z, rho, white, lanes):
    """Compute the innovation of each hypothesis as `Noise.fresh`, without a special case for the newborn
    one.
    """
    for i in range(lanes):
        now = z - origin[i]
        new[i] = (now - rho * y[i]) * white
        y[i] = now


@compiled
def add_square(total, values, lanes):
    """Add the squared value of every hypothesis to its total."""
    for i in range(lanes):
        total[i] += values[i] * values[i]


@compiled
def squares_log_evidence(ctx, channel, before, evidence):
    """Compute `Noise.log_evidence` of sums of squared residuals by hypothesis and axis, to `evidence`.

    The scale is the floor's; the terms that depend on length alone are those of `fill_length`.
    """
    state = state_at(ctx)
    lanes, prior = lanes_of(state.counters[0].living), channel.nu0 * channel.floor2
    x, y, z = state.work[SQUARES], state.work[SQUARES + 1], state.work[SQUARES + 2]
    if channel.joint:
        add_all(x, y, z, prior, lanes)
        logarithms(x, lanes)
    else:
        for a in range(AXES):
            add_prior(state.work[SQUARES + a], prior, lanes)
            logarithms(state.work[SQUARES + a], lanes)
        add_all(x, y, z, 0.0, lanes)
    half0, half = 0.5 * channel.nu0, 0.5 * channel.pooled
    half0 -= half * (channel.unvalued - before)
    weigh(evidence, state.work[BY_LENGTH], x, state.ages, half0, half, lanes)


@compiled
def add_all(x, y, z, prior, lanes):
    """Store the prior and the sum of the three axes in the first of them."""
    for i in range(lanes):
        x[i] = prior + (x[i] + y[i] + z[i])


@compiled
def add_prior(x, prior, lanes):
    """Add the prior to each value."""
    for i in range(lanes):
        x[i] += prior


@compiled
def weigh(evidence, by_length, logs, ages, half0, half, lanes):
    """Compute log evidence from logarithms of squares and from `by_length`."""
    for i in range(lanes):
        evidence[i] = by_length[i] - (half0 + half * ages[i]) * logs[i]

"""The compiled levels of the force: free space and a carried load, either of which may go on from before."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import exp_of_negative, larger, logarithms
from caesura_service.changepoint.kernels.layout import AXES, FORCE, FORCES, LOAD_FORCE
from caesura_service.changepoint.kernels.residual_evidence import (
    LOG_2PI,
    SQUARES,
    add_values,
    by_length,
    fill_length,
    lanes_of,
    log_absence,
    log_presence,
    squares_log_evidence,
    way_squared,
)
from caesura_service.numba_support.decorators import compiled

WEIGHT, VARIANCE, INSIDE, GOING_ON = 5, 6, 7, 8  # rows of the work
TOTALS, WEIGHTS, LEVEL = 3, 6, 7  # fields of a level: Σw² 3, Σwc 3, Σc²; and their number
ABSENCE = LEVEL  # field of Σ log absence, after those of a new level
CONTINUED = LEVEL + 1  # first field of the level that goes on
LOG_ODDS = CONTINUED + LEVEL  # fields of log (1 − q), and of log q − log m(x)


@compiled
def force_level(ctx, c):
    """`FreeSpaceForce`, `LoadForce` and `ContinuedLevel`.

    Fields: Σw² 3, Σwc 3, Σc², Σ log absence; and where the level may go on: Σw² 3, Σwc 3, Σc², log odds 2.
    """
    model, state = model_at(ctx), state_at(ctx)
    channel, me, evidence, sums = model.channels[c], state.counters[0], state.channel[c], state.sums
    at, newborn, lanes = channel.field, me.living - 1, lanes_of(me.living)
    absent = log_absence(squared_beyond_load(state.now, FORCE, channel), channel.absence)
    extend(sums[at + ABSENCE], absent, absent, newborn)
    extend_level(ctx, channel, at, newborn)
    level_evidence(ctx, c, at, 0, evidence)
    if channel.memory:
        sums[at + LOG_ODDS, newborn], sums[at + LOG_ODDS + 1, newborn] = 0.0, -math.inf
        extend_level(ctx, channel, at + CONTINUED, newborn)
        if me.count - me.opening >= channel.memory:
            begin_continued_level(ctx, c, newborn)
        level_evidence(ctx, c, at + CONTINUED, channel.memory, state.work[GOING_ON])
        mix_levels(
            evidence, state.work[GOING_ON], sums[at + LOG_ODDS], sums[at + LOG_ODDS + 1], state.work, lanes
        )
    add_values(evidence, sums[at + ABSENCE], lanes)


@compiled
def nearest_load_weight(down, channel):
    """Return the weight [N] of the load that is nearest to a force downwards; 0 in free space."""
    return min(max(down, channel.lightest), channel.heaviest)


@compiled
def squared_beyond_load(forces, first, channel):
    """Return |z|² [N²], z the force less the weight of a load; first: where its values begin."""
    z = forces[first + 2]
    z += nearest_load_weight(-z, channel)
    return forces[first] ** 2 + forces[first + 1] ** 2 + z**2


@compiled
def extend_level(ctx, channel, at, newborn):
    """Add the observation to the sums of a level; a new level begins with it."""
    state = state_at(ctx)
    sums, one = state.sums, (1.0 - channel.rho) * channel.white
    for a in range(AXES):
        z = state.now[FORCE + a]
        w = (z - channel.rho * state.previous[FORCE + a]) * channel.white
        extend(sums[at + a], w * w, z * z, newborn)
        extend(sums[at + TOTALS + a], w * one, z, newborn)
    extend(sums[at + WEIGHTS], one * one, 1.0, newborn)


@compiled
def extend(sums, value, first, newborn):
    """Add a value to every sum; the newborn hypothesis' sum is set to `first` instead."""
    for i in range(newborn):
        sums[i] += value
    sums[newborn] = first


@compiled
def level_evidence(ctx, c, at, before, evidence):
    """Compute the log evidence of a level without the absence of contact.

    before: observations before each start that count, too.
    """
    model, state = model_at(ctx), state_at(ctx)
    channel, work, sums, lanes = model.channels[c], state.work, state.sums, lanes_of(state.counters[0].living)
    fill_length(ctx, c, before)
    for a in range(AXES):
        about_mean(work[SQUARES + a], sums[at + a], sums[at + TOTALS + a], sums[at + WEIGHTS], lanes)
    squares_log_evidence(ctx, channel, before, evidence)
    add_mean_density(ctx, channel, at, evidence, lanes)


@compiled
def about_mean(squares, total_squares, totals, weights, lanes):
    """Compute sums of squares about the mean, from total squares, totals and weights."""
    for i in range(lanes):
        squares[i] = max(total_squares[i] - totals[i] * totals[i] / weights[i], 0.0)


@compiled
def add_mean_density(ctx, channel, at, log_evidence, lanes):
    """Add `mean_log_density` of the mean force, and the weight of the mean itself."""
    state = state_at(ctx)
    sums, work, axes = state.sums, state.work, 2 if channel.model == LOAD_FORCE else AXES
    weights, variances = sums[at + WEIGHTS], work[VARIANCE]
    for i in range(lanes):
        work[WEIGHT, i] = weights[i]
        variances[i] = channel.bias2 + channel.floor2 / weights[i]
    for a in range(axes):
        add_deviation(log_evidence, sums[at + TOTALS + a], weights, variances, lanes)
    if axes < AXES:
        add_load(log_evidence, work[INSIDE], sums[at + TOTALS + 2], weights, variances, channel, lanes)
    logarithms(work[WEIGHT], lanes)
    logarithms(variances, lanes)
    whole_axes, constant = 0.5 * axes, 0.5 * axes * LOG_2PI
    for i in range(lanes):
        log_evidence[i] -= 0.5 * AXES * work[WEIGHT, i] + whole_axes * variances[i] + constant


@compiled
def add_deviation(log_evidence, totals, weights, variances, lanes):
    """Add −mean²/2σ² to the log evidence: the exponent of a normal density of the mean about 0."""
    for i in range(lanes):
        mean = totals[i] / weights[i]
        log_evidence[i] -= 0.5 * mean * mean / variances[i]


@compiled
def add_load(log_evidence, inside, totals, weights, variances, channel, lanes):
    """Add the density of the vertical force, up to some logarithms of the variance. inside: work array."""
    lightest, heaviest = channel.lightest, channel.heaviest
    spread, shoulders = math.log(heaviest / lightest), 1.0 / lightest + 1.0 / heaviest
    for i in range(lanes):
        down = -totals[i] / weights[i]
        held = nearest_load_weight(down, channel)
        log_evidence[i] -= 0.5 * (down - held) ** 2 / variances[i]
        inside[i] = held * (spread + math.sqrt(0.5 * math.pi * variances[i]) * shoulders)
    logarithms(inside, lanes)
    for i in range(lanes):
        log_evidence[i] -= inside[i]


# --- the level that goes on ------------------------------------------------------------------------------


@compiled
def begin_continued_level(ctx, c, newborn):
    """Let the second level of the newborn hypothesis begin with the observations before its start."""
    model, state = model_at(ctx), state_at(ctx)
    channel, sums, past = model.channels[c], state.sums, state.past
    at, now, log_q = channel.field + CONTINUED, past.shape[0] - 1, channel.log_continued
    sums[at : at + LEVEL, newborn] = 0.0
    for i in range(now - channel.memory, now):
        add_past_observation(sums, at, newborn, past, i, channel, i > now - channel.memory)
        log_q += log_absence(squared_beyond_load(past[i], FORCES, channel), channel.absence)
    log_q += log_bias(sums, at, newborn, channel)
    log_q += log_presence(way_squared(past, now - channel.memory, now - 1), channel.away)
    known = evidence_before(ctx, c, at, newborn)
    add_past_observation(sums, at, newborn, past, now, channel, True)
    odds = channel.field + LOG_ODDS
    sums[odds, newborn], sums[odds + 1, newborn] = math.log1p(-math.exp(log_q)), log_q - known


@compiled
def add_past_observation(sums, at, place, past, i, channel, joins):
    """Add observation i of `state.past` to the sums of a level of the hypothesis at `place`.

    at: first field of the level; joins: whether the level has an earlier observation, which whitens this one.
    """
    rho, white = (channel.rho, channel.white) if joins else (0.0, 1.0)
    one = (1.0 - rho) * white
    for a in range(AXES):
        w = (past[i, FORCES + a] - rho * past[i - 1, FORCES + a]) * white
        sums[at + a, place] += w * w
        sums[at + TOTALS + a, place] += w * one
    sums[at + WEIGHTS, place] += one * one


@compiled
def log_bias(sums, at, place, channel):
    """Return the logarithm of the density of the mean's `unexplained` part divided by its peak."""
    weight, total = sums[at + WEIGHTS, place], 0.0
    for a in range(AXES):
        bias = sums[at + TOTALS + a, place] / weight
        if a == AXES - 1 and channel.model == LOAD_FORCE:
            bias += nearest_load_weight(-bias, channel)
        total += bias**2
    return -0.5 * total / (channel.bias2 + channel.floor2 / weight)


@compiled
def evidence_before(ctx, c, at, place):
    """Return the log evidence of the observations before a start, without the absence of contact."""
    model, sums = model_at(ctx), state_at(ctx).sums
    channel, weight = model.channels[c], sums[at + WEIGHTS, place]
    prior, squares, logs = channel.nu0 * channel.floor2, 0.0, 0.0
    variance = channel.bias2 + channel.floor2 / weight
    result = -0.5 * AXES * math.log(weight)
    for a in range(AXES):
        total = sums[at + TOTALS + a, place]
        mean, residual = total / weight, max(sums[at + a, place] - total * total / weight, 0.0)
        squares += residual
        logs += math.log(prior + residual)
        if a == AXES - 1 and channel.model == LOAD_FORCE:
            result += log_load(-mean, variance, channel)
        else:
            result -= 0.5 * (mean * mean / variance + math.log(variance) + LOG_2PI)
    if channel.joint:
        logs = math.log(prior + squares)
    values = channel.pooled * (channel.memory - channel.unvalued)
    groups = 1 if channel.joint else AXES
    return result + groups * by_length(ctx, c, channel.memory) - 0.5 * (channel.nu0 + values) * logs


@compiled
def log_load(down, variance, channel):
    """Return the log density of one vertical force [N], downwards: that of a load."""
    lightest, heaviest = channel.lightest, channel.heaviest
    held = nearest_load_weight(down, channel)
    spread, shoulders = math.log(heaviest / lightest), 1.0 / lightest + 1.0 / heaviest
    mass = spread + math.sqrt(0.5 * math.pi * variance) * shoulders
    return -0.5 * (down - held) ** 2 / variance - math.log(held * mass)


@compiled
def mix_levels(evidence, going_on, log_fresh, log_odds, work, lanes):
    """Compute the log evidence of the mixture of both levels, to `evidence`."""
    peak, total = work[WEIGHT], work[VARIANCE]
    for i in range(lanes):
        fresh, other = log_fresh[i] + evidence[i], log_odds[i] + going_on[i]
        peak[i] = larger(fresh, other)
        total[i] = exp_of_negative(fresh - peak[i]) + exp_of_negative(other - peak[i])
    logarithms(total, lanes)
    for i in range(lanes):
        evidence[i] = peak[i] + total[i]

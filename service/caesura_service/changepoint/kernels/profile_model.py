"""`ProfileModel`: sums over a library's profiles, and the residuals of the best or of all of them.

The sums of a hypothesis are contiguous, profile by profile, and are processed in blocks: a loop of fixed
length takes half the time of one of variable length. Values that exist once per hypothesis are processed in
loops over hypotheses before and after that.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import (
    exp_of_negative,
    larger,
    log,
    logarithms,
    share_missing,
    smaller,
)
from caesura_service.changepoint.kernels.layout import (
    AXES,
    BLOCK,
    LOG_SCALE,
    MOST_SHARES,
    NORM,
    PRECISION,
    PREVIOUS,
    WEIGHED,
)
from caesura_service.changepoint.kernels.residual_evidence import (
    BY_LENGTH,
    MOVED,
    SQUARES,
    TINY,
    fill_length,
    follow_origin,
    lanes_of,
    log_presence,
    squares_log_evidence,
    step_squared,
)
from caesura_service.numba_support.decorators import compiled, reducing

# What a hypothesis keeps beside its profiles: origin 3, y 3, log pace, Σy² 3 where all precisions are 1.
Y, RATE_BOUNDS, EVEN = 3, 6, 7
# Rows of the work: of the squares' place once they are used, and behind the others.
PEAK, TOTAL, PRIORS, CONSTANTS = 5, 6, 7, 7 + MOST_SHARES


@compiled
def profile_model(ctx, c, joins):
    """`ProfileModel`. Fields: origin 3, y 3, log pace, Σy² 3 if all precisions are 1."""
    model, state = model_at(ctx), state_at(ctx)
    channel, evidence = model.channels[c], state.channel[c]
    follow_origin(ctx, channel, joins)
    fill_length(ctx, c, 0)
    if channel.best_only:
        explain_best(ctx, channel)
        squares_log_evidence(ctx, channel, 0, state.channel[c])
    else:
        fill_priors(ctx, channel)
        explain_all(ctx, channel)
        add_logs(evidence, state.work, lanes_of(state.counters[0].living))
    if channel.pace:
        add_pace(ctx, channel, evidence, state.sums[channel.field + RATE_BOUNDS], joins)
    if channel.reach2:
        add_target(ctx, channel, evidence)


@compiled
def add_pace(ctx, channel, evidence, paces, joins):
    """Add the last step's weight, one for all hypotheses, to `paces`, and `paces` to the evidence."""
    state = state_at(ctx)
    paced = log_presence(step_squared(ctx, channel.signal, joins), channel.pace) if joins else 0.0
    for i in range(lanes_of(state.counters[0].living)):
        paces[i] += paced
        evidence[i] += paces[i]


@compiled
def add_target(ctx, channel, evidence):
    """Add `DisplacementPrior.log_density` of every hypothesis to the evidence."""
    state = state_at(ctx)
    lanes, moved2, presence = lanes_of(state.counters[0].living), state.work[MOVED], state.work[PEAK]
    if channel.least:
        displacement_weight(presence, moved2, 0.5 / channel.least**2, lanes)
        logarithms(presence, lanes)
    else:
        presence[:lanes] = 0.0
    for i in range(lanes):
        evidence[i] += presence[i] + (channel.constant - 0.5 / channel.reach2 * moved2[i])


@compiled
def displacement_weight(presence, moved2, narrow, lanes):
    """Compute the weight of a displacement, 1 − exp(−narrow · moved²), of each hypothesis."""
    for i in range(lanes):
        presence[i] = max(share_missing(narrow * moved2[i]), TINY)


# --- the best profile on each axis ----------------------------------------------------------------------


@compiled
def explain_best(ctx, channel):
    """Compute the sum of squares that the best profile leaves on each axis, all precisions being 1."""
    model, state = model_at(ctx), state_at(ctx)
    at, library, work = channel.field, channel.library, state.work
    end, before = model.profiles.shape[1] - 1, 0 if channel.origin == PREVIOUS else 1
    for place in range(state.counters[0].living):
        last, slot = int(state.ages[place]) - before, state.slots[place]
        table, least = model.profiles[library, min(last, end)], state.scratch
        least[0] = least[1] = least[2] = math.inf
        for b in range(channel.blocks):
            norms, sums = table[b, NORM], state.profiles[library, slot, b]
            if last > end:
                extrapolate(state.continued[0], norms, model.steps[library, b, 0], last - end)
                norms = state.continued[0]
            for a in range(AXES):
                new, y = work[SQUARES + a, place], state.sums[at + Y + a, place]
                explained = accumulate_least(sums[a], table[b, WEIGHED], norms, new, y)
                least[a] = min(least[a], explained)
        for a in range(AXES):
            total = state.sums[at + EVEN + a, place] + work[SQUARES + a, place] ** 2
            state.sums[at + EVEN + a, place] = total
            work[SQUARES + a, place] = max(total + least[a], 0.0)


@reducing
def accumulate_least(moments, values, norms, new, y):
    """Add a value to the sums of every profile; return minus the squares that the best profile explains."""
    least = math.inf
    for k in range(BLOCK):
        moment = moments[k] + new * values[k]
        moments[k] = moment
        least = smaller(least, y * (y * norms[k] - 2.0 * moment))
    return least


@compiled
def extrapolate(sums, last, step, beyond):
    """Extrapolate sums by `beyond` samples after a table's end, where each sample adds `step`."""
    for k in range(BLOCK):
        sums[k] = last[k] + beyond * step[k]


# --- all profiles ---------------------------------------------------------------------------------------


@compiled
def fill_priors(ctx, channel):
    """Compute for every share ν₀ times the squared scale, and the term that it adds to the log evidence."""
    state = state_at(ctx)
    lanes, half0 = lanes_of(state.counters[0].living), 0.5 * channel.nu0
    for s in range(channel.shares):
        prior, constant = state.work[PRIORS + s], state.work[CONSTANTS + s]
        floor2, share2 = channel.nu0 * channel.floor2, channel.nu0 * channel.share2[s]
        add_scale(prior, constant, state.work[MOVED], floor2, share2, lanes)
        logarithms(constant, lanes)
        multiply(constant, half0, lanes)


@compiled
def add_scale(prior, constant, moved2, floor2, share2, lanes):
    """Compute floor² + share² · moved² in both arrays; the caller takes the logarithm of one."""
    for i in range(lanes):
        prior[i] = constant[i] = floor2 + share2 * moved2[i]


@compiled
def multiply(values, factor, lanes):
    """Multiply each value by a factor."""
    for i in range(lanes):
        values[i] *= factor


@compiled
def explain_all(ctx, channel):
    """Compute the log evidence over all profiles and shares from a sum of peaks and products of sums."""
    model, state = model_at(ctx), state_at(ctx)
    end, before = model.profiles.shape[1] - 1, 0 if channel.origin == PREVIOUS else 1
    halves = 0.5 * channel.pooled
    half0 = 0.5 * channel.nu0 - halves * channel.explained
    for place in range(state.counters[0].living):
        last, half = int(state.ages[place]) - before, half0 + halves * state.ages[place]
        state.work[PEAK, place], state.work[TOTAL, place] = 0.0, 1.0
        for group in range(1 if channel.joint else AXES):
            peak = -math.inf
            for b in range(channel.blocks):
                table = model.profiles[channel.library, min(last, end), b]
                norms, scales = table[NORM], table[LOG_SCALE]
                if last > end:
                    steps = model.steps[channel.library, b]
                    extrapolate(state.continued[0], norms, steps[0], last - end)
                    extrapolate(state.continued[1], scales, steps[1], last - end)
                    norms, scales = state.continued[0], state.continued[1]
                explain(ctx, channel, place, group, b, table, norms)
                peak = max(peak, weigh_block(ctx, channel, place, b, scales, half))
            mix_profiles(ctx, channel, place, peak)


@compiled
def explain(ctx, channel, place, group, b, table, norms):
    """Add a value of one axis or all to the sums of a block; compute the squares that each profile leaves."""
    state = state_at(ctx)
    new, ways, residuals = state.work[SQUARES:], state.sums[channel.field + Y :], state.residuals
    sums = state.profiles[channel.library, state.slots[place], b]
    squares, precisions, weighed = sums[AXES + group], table[PRECISION], table[WEIGHED]
    if channel.joint:
        x, y, z = new[0, place], new[1, place], new[2, place]
        accumulate(sums[0], sums[1], sums[2], weighed, x, y, z)
        add_unexplained(
            residuals, squares, precisions, x * x + y * y + z * z, norms, state.work[MOVED, place]
        )
        explain_by(residuals, sums[0], sums[1], sums[2], ways[0, place], ways[1, place], ways[2, place])
    else:
        x, way = new[group, place], ways[group, place]
        accumulate_one(sums[group], weighed, x)
        add_unexplained(residuals, squares, precisions, x * x, norms, way * way)
        explain_by_one(residuals, sums[group], way)


@compiled
def accumulate(first, second, third, weighed, a, b, c):
    """Add a value of each of the three axes, times each weighed profile, to the sums Σwyφ of the axes."""
    for k in range(BLOCK):
        first[k] += a * weighed[k]
        second[k] += b * weighed[k]
        third[k] += c * weighed[k]


@compiled
def accumulate_one(moments, weighed, new):
    """Add a value of one axis, times each weighed profile, to the sums Σwyφ."""
    for k in range(BLOCK):
        moments[k] += new * weighed[k]


@compiled
def add_unexplained(residuals, squares, precisions, square, norms, moved2):
    """Add a square to the sums of every profile; compute Σwy² + moved² Σwφ², without −2yΣwyφ."""
    for k in range(BLOCK):
        squares[k] += square * precisions[k]
        residuals[k] = squares[k] + moved2 * norms[k]


@compiled
def explain_by(residuals, first, second, third, x, y, z):
    """Subtract 2yΣwyφ of three axes from every profile's residual."""
    for k in range(BLOCK):
        residuals[k] -= 2.0 * (x * first[k] + y * second[k] + z * third[k])


@compiled
def explain_by_one(residuals, moments, y):
    """Subtract 2yΣwyφ of one axis from every profile's residual."""
    for k in range(BLOCK):
        residuals[k] -= 2.0 * y * moments[k]


@compiled
def weigh_block(ctx, channel, place, b, scales, half):
    """Compute the log evidence of every profile of a block under every share; return the largest."""
    state, peak = state_at(ctx), -math.inf
    for s in range(channel.shares):
        prior, constant = state.work[PRIORS + s, place], state.work[CONSTANTS + s, place]
        evidence = state.log_evidence[b * channel.shares + s]
        peak = max(peak, weigh_each(evidence, state.residuals, scales, prior, constant, half))
    return peak


@reducing
def weigh_each(evidence, residuals, scales, prior, constant, half):
    """Compute the log evidence of every profile's squared residuals under one scale; return the largest."""
    most = -math.inf
    for k in range(BLOCK):
        evidence[k] = constant - half * log(prior + larger(residuals[k], 0.0)) - scales[k]
        most = larger(most, evidence[k])
    return most


@compiled
def mix_profiles(ctx, channel, place, peak):
    """Add the mixture or maximum over profiles and shares of a group to `work`: its peak and its sum.

    `log_evidence`: (blocks · shares, profiles); `work[PEAK]` adds the peak, `work[TOTAL]` multiplies the sum.
    """
    state, total = state_at(ctx), 0.0
    if not channel.maximum:
        for i in range(channel.blocks * channel.shares):
            total += total_of_block(state.log_evidence[i], peak)
    else:
        total = 1.0
        if channel.shares > 1:
            peak = best_mean(state.log_evidence, channel.blocks, channel.shares)
    state.work[PEAK, place] += peak
    state.work[TOTAL, place] *= total


@reducing
def total_of_block(evidence, peak):
    """Return Σ exp(`evidence` − peak)."""
    total = 0.0
    for k in range(BLOCK):
        total += exp_of_negative(evidence[k] - peak)
    return total


@compiled
def best_mean(evidence, blocks, shares):
    """Return the maximum over profiles of the log mean over shares."""
    best = -math.inf
    for b in range(blocks):
        for k in range(BLOCK):
            peak, total = -math.inf, 0.0
            for s in range(shares):
                peak = max(peak, evidence[b * shares + s, k])
            if peak > -math.inf:
                for s in range(shares):
                    total += math.exp(evidence[b * shares + s, k] - peak)
                best = max(best, peak + math.log(total / shares))
    return best


@compiled
def add_logs(evidence, work, lanes):
    """Compute log evidence from peaks, totals and `by_length`."""
    peaks, totals, by_length = work[PEAK], work[TOTAL], work[BY_LENGTH]
    logarithms(totals, lanes)
    for i in range(lanes):
        evidence[i] = by_length[i] + peaks[i] + totals[i]

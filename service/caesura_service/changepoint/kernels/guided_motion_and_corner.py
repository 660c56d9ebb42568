"""Hand-guided movement (`GuidedMotion`) and its corners (`CornerWeight`).

Sums over steps, and the shape of the path before and after a start.

The steps are the same for every hypothesis. Only the youngest hypotheses differ: their velocity before the
start is 0, their first steps have additional noise, and their corner weight may still change.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import exp_of_negative, larger, logarithms
from caesura_service.changepoint.kernels.layout import AXES, PAST
from caesura_service.changepoint.kernels.residual_evidence import lanes_of, log_presence, student, way_squared
from caesura_service.numba_support.decorators import compiled

WEIGHTS, DENSITIES = 0, 1  # fields of guided motion; densities have one a scale
PEAK, TOTAL = 5, 6  # rows of the work
OWN_STEPS = 2  # observations of a segment after which the steps before it play no part
MOST = 50.0  # of the logistic function's argument


@compiled
def guided_motion(ctx, c, joins):
    """`GuidedMotion`. Fields: Σ log (pace / w³), Σ log density of ε for each scale."""
    model, state = model_at(ctx), state_at(ctx)
    channel, living = model.channels[c], state.counters[0].living
    sums = state.sums[channel.field : channel.field + DENSITIES + channel.shares]
    settled = max(OWN_STEPS, channel.burst_steps)
    old = living
    while old and state.ages[old - 1] <= settled:
        old -= 1
    add_step(ctx, channel, sums, settled, 0, old)
    for place in range(old, living):
        add_step(ctx, channel, sums, int(state.ages[place]) - 1, place, place + 1)
    paced = log_presence(step_squared_at(state.past, 1, 0), channel.pace) if joins else 0.0
    left = log_presence(way_squared(state.past, PAST - 1 - channel.away_steps, PAST - 1), channel.away)
    for place in range(living):
        sums[WEIGHTS, place] += paced + left if state.ages[place] > channel.away_steps else paced
    mix_scales(state.work, channel.shares, sums, state.channel[c], lanes_of(living))


@compiled
def past_column(channel):
    """Return the first column of a channel's values in `state.past`: positions come first, then rotations."""
    return AXES if channel.signal else 0


@compiled
def innovation(ctx, channel, n):
    """Return |ε|² and log w of the last step, for a segment that had n observations before it."""
    past = state_at(ctx).past
    last = past.shape[0] - 1
    error2 = own2 = 0.0
    for a in range(AXES):
        step = past[last, a] - past[last - 1, a]
        own_1 = past[last - 1, a] - past[last - 2, a] if n >= 1 else 0.0
        own_2 = past[last - 2, a] - past[last - 3, a] if n >= OWN_STEPS else 0.0
        error2 += (step - 2.0 * channel.rho * own_1 + channel.rho**2 * own_2) ** 2
        own2 += own_1**2
    scale2 = channel.floor2 + channel.scale2 * own2
    if n < channel.burst_steps:
        scale2 += channel.burst2
    return error2 / scale2, 0.5 * math.log(scale2)


@compiled
def add_step(ctx, channel, sums, n, first, last):
    """Add the last step to the sums of hypotheses first to last (exclusive) with n observations before it."""
    squared, log_scale = innovation(ctx, channel, n)
    for i in range(first, last):
        sums[WEIGHTS, i] -= AXES * log_scale
    for k in range(channel.shares):
        scale2 = channel.share2[k]
        constant = channel.constant - 0.5 * AXES * math.log(scale2)
        density = student(constant, channel.nu, squared, scale2)
        for i in range(first, last):
            sums[DENSITIES + k, i] += density


@compiled
def mix_scales(work, scales, sums, evidence, lanes):
    """Compute the log evidence of each hypothesis as the mean over the scales."""
    peak, total = work[PEAK], work[TOTAL]
    peak[:lanes] = -math.inf
    for k in range(scales):
        raise_peak(peak, sums[DENSITIES + k], lanes)
    total[:lanes] = 0.0
    for k in range(scales):
        add_exponentials(total, sums[DENSITIES + k], peak, lanes)
    logarithms(total, lanes)
    add_up(evidence, sums[WEIGHTS], peak, total, math.log(scales), lanes)


@compiled
def raise_peak(peak, values, lanes):
    """Raise each peak to the value where that is larger."""
    for i in range(lanes):
        peak[i] = larger(peak[i], values[i])


@compiled
def add_exponentials(total, values, peak, lanes):
    """Add exp(value − peak) to each total."""
    for i in range(lanes):
        total[i] += exp_of_negative(values[i] - peak[i])


@compiled
def add_up(evidence, weights, peak, logs, log_count, lanes):
    """Compute log evidence: weight + peak + log of the total − log of the number of scales."""
    for i in range(lanes):
        evidence[i] = weights[i] + peak[i] + logs[i] - log_count


# --- corners --------------------------------------------------------------------------------------------


@compiled
def corner_weight(ctx, c):
    """`CornerWeight`. Fields: log weight of each chord."""
    model, state = model_at(ctx), state_at(ctx)
    channel, place, evidence = model.channels[c], state.counters[0].living - 1, state.channel[c]
    sums = state.sums[channel.field : channel.field + channel.chord_count]
    squared_steps(state.scratch, state.past, past_column(channel))
    while place >= 0 and state.ages[place] - 1 <= channel.longest_reach:
        age = int(state.ages[place]) - 1
        for k in range(channel.chord_count):
            chord, reach = channel.chords[k], channel.reaches[k]
            if chord <= age <= reach:
                sums[k, place] = log_corner_weight(state.past, state.scratch, age, chord, reach, channel)
        place -= 1
    for i in range(state.counters[0].living):
        evidence[i] = sums[0, i]
    for k in range(1, channel.chord_count):
        raise_peak(evidence, sums[k], state.counters[0].living)


@compiled
def squared_steps(squared, past, first):
    """Compute squared lengths [unit²] of the last steps, the newest first; first: column of the values."""
    for back in range(1, past.shape[0]):
        squared[back - 1] = step_squared_at(past, back, first)


@compiled
def step_squared_at(past, back, first):
    """Return the squared length of the last step, or of an earlier one; first: column of the values."""
    last = past.shape[0] - back
    total = 0.0
    for a in range(first, first + AXES):
        total += (past[last, a] - past[last - 1, a]) ** 2
    return total


@compiled
def largest(values, first, last):
    """Return the largest of the values from index `first` to `last`, the last not included."""
    peak = values[first]
    for i in range(first + 1, last):
        peak = max(peak, values[i])
    return peak


@compiled
def smallest(values, first, last):
    """Return the smallest of the values from index `first` to `last`, the last not included."""
    least = values[first]
    for i in range(first + 1, last):
        least = min(least, values[i])
    return least


@compiled
def log_corner_weight(past, squared, age, chord, reach, channel):
    """Return `CornerWeight._log_weight`. squared: from `squared_steps`."""
    peak2 = min(largest(squared, 0, age), largest(squared, age + 1, age + 1 + reach))
    last, first = past.shape[0] - 1, past_column(channel)
    start = last - age
    before2 = after2 = begun2 = product = 0.0
    for a in range(first, first + AXES):
        before, after = past[start - 1, a] - past[start - 1 - chord, a], past[last, a] - past[start, a]
        before2 += before**2
        after2 += after**2
        begun2 += (past[start + chord, a] - past[start, a]) ** 2
        product += before * after
    length_before, length_after = math.sqrt(before2), math.sqrt(after2)
    slowest_way = min(length_before / chord, length_after / age, math.sqrt(begun2) / chord)
    if min(math.sqrt(peak2), slowest_way) <= channel.pace:
        return 0.0
    turn = math.acos(min(max(product / (length_before * length_after), -1.0), 1.0))
    by_chance2 = channel.noise2 * (chord / before2 + age / after2)
    turn = math.degrees(math.sqrt(max(turn**2 - by_chance2, 0.0)))
    dipped = (channel.dip - math.sqrt(squared[age] / peak2)) / channel.dip_width
    flight = 1.0
    if channel.fast2:
        flight = min(smallest(squared, 0, age + 1 + chord) / channel.fast2, 1.0)
    gamma = channel.standing + (channel.gamma - channel.standing) * flight
    weight = gamma * turned(turn, channel) * logistic(dipped)
    if channel.straight:
        weight *= straightness(length_before, squared, age + 1, age + 1 + chord, channel)
        weight *= straightness(length_after, squared, 0, age, channel)
    return weight


@compiled
def turned(turn, channel):
    """Return `CornerWeight._turned`."""
    unturned = logistic(-channel.turn / channel.turn_width)
    return (logistic((turn - channel.turn) / channel.turn_width) - unturned) / (1.0 - unturned)


@compiled
def straightness(chord_length, squared, first, last, channel):
    """Return a factor near 1 for a straight section, near 0 for a curved one.

    first, last: its steps in `squared`.
    """
    way = 0.0
    for back in range(first, last):
        way += math.sqrt(squared[back])
    return logistic((chord_length / way - channel.straight) / channel.straight_width)


@compiled
def logistic(x):
    """Return 1/(1 + exp(−x))."""
    return 1.0 / (1.0 + math.exp(-min(max(x, -MOST), MOST)))

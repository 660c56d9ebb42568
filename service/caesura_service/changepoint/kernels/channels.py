"""The channel models: all hypotheses take one observation, and tell the log evidence.

Which model a channel has is a number, because compiled code cannot look up a method. Each function is the
twin of the class that its docstring names; `fields` are what a hypothesis keeps of it in its row. An
observation `z` is position 3, force 3, whether the gripper holds something; `joins` says whether there was
one before it.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

import numpy as np

from caesura_service.changepoint.kernels.compiling import compiled, reducing
from caesura_service.changepoint.kernels.elementary import log, log_sum_exp, log_sum_exp_of_rows
from caesura_service.changepoint.kernels.layout import (
    BIASED,
    CARRIED,
    CONSTANT,
    CONTACT,
    FIRST,
    HELD,
    LADEN,
    PREVIOUS,
    PROFILED,
    STATES,
    VELOCITY,
    WALK,
)

AXES = 3
LOG_2PI = math.log(2.0 * math.pi)
TINY = float(np.finfo(np.float64).tiny)
HOLDING = 6  # place in an observation


@compiled
def take(model, state, c, z, joins):
    """Every living hypothesis takes an observation in channel c; the evidence goes to `state.channel[c]`."""
    which = model.channels[c].model
    if which == PROFILED:
        profiled(model, state, c, z, joins)
    elif which == WALK:
        walk(model, state, c, z, joins)
    elif which == CONSTANT:
        constant(model, state, c, z, joins)
    elif which in (BIASED, LADEN):
        biased(model, state, c, z)
    elif which == CARRIED:
        carried(model, state, c, z)
    elif which == HELD:
        held(model, state, c, z)
    elif which == CONTACT:
        contact(model, state, c, z)
    elif which == VELOCITY:
        velocity(model, state, c, z)


@compiled
def log_presence(squared, least):
    """`models.log_presence`."""
    if least == 0.0:
        return 0.0
    return math.log(max(-math.expm1(-0.5 * squared / least**2), TINY))


@compiled
def log_absence(squared, most):
    """`models.log_absence`."""
    if most == 0.0:
        return 0.0
    return -0.5 * squared / most**2


@compiled
def step_squared(signal, z, previous, joins):
    """Squared length of the step from the observation before; 0 where there is none."""
    total = 0.0
    if joins:
        for a in range(AXES):
            total += (z[signal + a] - previous[signal + a]) ** 2
    return total


@compiled
def fresh(origin, rho, now, before, n):
    """`Noise.fresh`, with n own samples before this one."""
    if origin != PREVIOUS and n == 0:
        return now
    return (now - rho * before) / math.sqrt(1.0 - rho**2)


@compiled
def by_length(model, c, n):
    """What of the log evidence of n samples, of one group of axes, depends on n alone."""
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
def begin(origin, row, at, signal, z, previous, joins):
    """Write where a newborn hypothesis counts from."""
    for a in range(AXES):
        if origin == FIRST or (origin == PREVIOUS and not joins):
            row[at + a] = z[signal + a]
        elif origin == PREVIOUS:
            row[at + a] = previous[signal + a]


@compiled
def profiled(model, state, c, z, joins):
    """`Profiled`. Fields: origin 3, y 3, log pace; beside them Σwy² and Σwyφ of every profile.

    Σwy² is one for all profiles where they are even, and that for each axis, unless they are pooled.
    """
    me, channel = state.counters[0], model.channels[c]
    at, signal, origin, rho = channel.field, channel.signal, channel.origin, channel.rho
    offset, end = 1 if origin == PREVIOUS else 0, model.values.shape[1] - 1
    reach2, least, constant = channel.reach2, channel.least, channel.constant
    best_only = channel.maximum and channel.even and not channel.joint and channel.shares == 1
    paced = 0.0
    if channel.pace and joins:
        paced = log_presence(step_squared(signal, z, state.previous, joins), channel.pace)
    library, new, joint = channel.library, state.fresh, channel.joint
    half0, halves = 0.5 * channel.nu0, 0.5 * (AXES if joint else 1)
    for place in range(me.living):
        slot = state.order[place]
        n = me.count - state.starts[slot]
        row = state.rows[slot]
        if n == 0:
            begin(origin, row, at, signal, z, state.previous, joins)
        last = n + offset
        tabled = min(last, end)
        values, norms = model.values[library, tabled], model.squares[library, tabled]
        if last > end:
            go_on_squares(model, state.continued[0], library, last - end)
            norms = state.continued[0]
        moved2 = 0.0
        for a in range(AXES):
            y = z[signal + a] - row[at + a]
            new[a] = fresh(origin, rho, y, row[at + 3 + a], n)
            row[at + 3 + a] = y
            moved2 += y * y
        squares, moments = state.squares[channel.place, slot], state.moments[channel.place, slot]
        half = half0 + halves * (n + 1 - channel.explained)
        if best_only:
            told = best_profile(channel, squares, moments, values, norms, new, row, half, moved2)
        else:
            accumulate(channel, squares, moments, values, model.precisions[library, tabled], new)
            last = max(last - channel.explained, 0)
            scales = model.log_scales[library, min(last, end)]
            if last > end:
                go_on_scales(model, state.continued[1], library, last - end)
                scales = state.continued[1]
            ssr, each = state.squared, state.told
            told = all_profiles(channel, squares, moments, norms, scales, row, half, moved2, ssr, each)
        row[at + 6] += paced
        told += (1 if joint else AXES) * by_length(model, c, n + 1) + row[at + 6]
        if reach2:
            told += log_presence(moved2, least) - 0.5 * moved2 / reach2 + constant
        state.channel[c, slot] = told


@compiled
def best_profile(channel, squares, moments, values, norms, new, row, half, moved2):
    """Log evidence of the best profile on each axis, all precisions being 1, but for what n alone says."""
    prior = channel.nu0 * (channel.floor2 + channel.share2[0] * moved2)
    told = AXES * 0.5 * channel.nu0 * math.log(prior)
    for a in range(AXES):
        squares[a, 0] += new[a] * new[a]
        y = row[channel.field + 3 + a]
        least = squares[a, 0] + accumulate_least(moments[a], values, norms, new[a], y)
        told -= half * math.log(prior + max(least, 0.0))
    return told


@reducing
def accumulate_least(moments, values, norms, new, y):
    """One more value in the sums of every profile; what the best one explains of the axis, negative."""
    least = math.inf
    for k in range(moments.size):
        moment = moments[k] + new * values[k]
        moments[k] = moment
        least = min(least, y * (y * norms[k] - 2.0 * moment))
    return least


@compiled
def accumulate(channel, squares, moments, values, precisions, new):
    """One more value an axis in the sums of every profile."""
    for a in range(AXES):
        group = 0 if channel.joint else a
        if channel.even:
            squares[group, 0] += new[a] ** 2
            accumulate_even(moments[a], values, new[a])
        else:
            accumulate_weighed(squares[group], moments[a], values, precisions, new[a])


@compiled
def accumulate_even(moments, values, new):
    """All precisions being 1."""
    for k in range(moments.size):
        moments[k] += new * values[k]


@compiled
def accumulate_weighed(squares, moments, values, precisions, new):
    """With the library's precisions."""
    for k in range(moments.size):
        weighed = new * precisions[k]
        squares[k] += new * weighed
        moments[k] += values[k] * weighed


@compiled
def all_profiles(channel, squares, moments, norms, scales, row, half, moved2, ssr, told):
    """Log evidence over all profiles, of every axis or of all together. ssr, told: scratch."""
    joint, evidence = channel.joint, 0.0
    for a in range(AXES):
        y = row[channel.field + 3 + a]
        if a == 0 or not joint:
            explain(ssr, squares[a], channel.even, moments[a], norms, y)
        else:
            explain_more(ssr, moments[a], norms, y)
        if a == AXES - 1 or not joint:
            evidence += over_profiles(channel, ssr, scales, half, moved2, told)
    return evidence


@compiled
def explain(ssr, squares, even, moments, norms, y):
    """What every profile leaves of the sums of squares; these are one for all where even."""
    if even:
        for k in range(ssr.size):
            ssr[k] = squares[0] + y * (y * norms[k] - 2.0 * moments[k])
    else:
        for k in range(ssr.size):
            ssr[k] = squares[k] + y * (y * norms[k] - 2.0 * moments[k])


@compiled
def explain_more(ssr, moments, norms, y):
    """What it leaves once it explains one more axis."""
    for k in range(ssr.size):
        ssr[k] += y * (y * norms[k] - 2.0 * moments[k])


@compiled
def go_on_squares(model, sums, library, beyond):
    """`ProfileLibrary.sums_of_squares` so far behind the table's end: they go on evenly."""
    end = model.values.shape[1] - 1
    for k in range(sums.size):
        step = model.values[library, end, k] ** 2 * model.precisions[library, end, k]
        sums[k] = model.squares[library, end, k] + beyond * step


@compiled
def go_on_scales(model, sums, library, beyond):
    """The same of `ProfileLibrary.log_scales`."""
    end = model.values.shape[1] - 1
    for k in range(sums.size):
        step = -0.5 * math.log(model.precisions[library, end, k])
        sums[k] = model.log_scales[library, end, k] + beyond * step


@compiled
def over_profiles(channel, ssr, scales, half, moved2, told):
    """Mixture or maximum over profiles and shares, but for what depends on length alone. told: scratch."""
    shares, pooled = channel.shares, AXES if channel.joint else 1
    for s in range(shares):
        prior = channel.nu0 * (channel.floor2 + channel.share2[s] * moved2)
        weigh(told[s], ssr, scales, prior, 0.5 * channel.nu0 * math.log(prior), half, pooled)
    if channel.maximum:
        return best_mean(told, shares)
    return log_sum_exp_of_rows(told, shares) - channel.log_count


@compiled
def weigh(told, ssr, scales, prior, constant, half, pooled):
    """Log evidence of every profile's squared residuals under one scale."""
    for k in range(ssr.size):
        told[k] = constant - half * log(prior + max(ssr[k], 0.0)) - pooled * scales[k]


@compiled
def best_mean(told, shares):
    """Over profiles the maximum, over shares the mean; told: (shares, profiles)."""
    best = -math.inf
    for k in range(told.shape[1]):
        peak, total = -math.inf, 0.0
        for s in range(shares):
            peak = max(peak, told[s, k])
        if peak > -math.inf:
            for s in range(shares):
                total += math.exp(told[s, k] - peak)
            best = max(best, peak + math.log(total / shares))
    return best


@compiled
def walk(model, state, c, z, joins):
    """`Walk`. Field: log evidence. The step is the same for every hypothesis."""
    me, channel = state.counters[0], model.channels[c]
    at, signal = channel.field, channel.signal
    step2 = step_squared(signal, z, state.previous, joins)
    size2 = z[signal] ** 2 + z[signal + 1] ** 2 + z[signal + 2] ** 2
    told = channel.constant - 0.5 * (channel.nu + AXES) * math.log1p(step2 / (channel.nu * channel.scale2))
    told += log_absence(step2, channel.still) + log_presence(size2, channel.presence)
    for place in range(me.living):
        slot = state.order[place]
        state.rows[slot, at] += told
        state.channel[c, slot] = state.rows[slot, at]


@compiled
def simple(channel, by_length, ssr, n):
    """`Noise.log_evidence` of n values without shares; by_length: what depends on n alone."""
    prior = channel.nu0 * channel.floor2
    half = 0.5 * (channel.nu0 + n)
    return by_length + 0.5 * channel.nu0 * math.log(prior) - half * math.log(prior + ssr)


@compiled
def over_axes(channel, by_length, x, y, z, n):
    """The same of three axes with these squared residuals, pooled or not, n values each."""
    if channel.joint:
        return simple(channel, by_length, x + y + z, AXES * n)
    told = simple(channel, by_length, x, n) + simple(channel, by_length, y, n)
    return told + simple(channel, by_length, z, n)


@compiled
def constant(model, state, c, z, joins):
    """`Constant`. Fields: origin 3, y 3, Σy² 3."""
    me, channel, rows = state.counters[0], model.channels[c], state.rows
    at, signal, origin, rho = channel.field, channel.signal, channel.origin, channel.rho
    for place in range(me.living):
        slot = state.order[place]
        n = me.count - state.starts[slot]
        if n == 0:
            begin(origin, rows[slot], at, signal, z, state.previous, joins)
        for a in range(AXES):
            y = z[signal + a] - rows[slot, at + a]
            rows[slot, at + 6 + a] += fresh(origin, rho, y, rows[slot, at + 3 + a], n) ** 2
            rows[slot, at + 3 + a] = y
        x, y, w = rows[slot, at + 6], rows[slot, at + 7], rows[slot, at + 8]
        state.channel[c, slot] = over_axes(channel, by_length(model, c, n + 1), x, y, w, n + 1)


@compiled
def biased(model, state, c, z):
    """`Biased` and `Laden`. Fields: Σw² 3, Σwc 3, Σc², Σ log absence."""
    me, channel, rows = state.counters[0], model.channels[c], state.rows
    at, rho, laden = channel.field, channel.rho, channel.model == LADEN
    beyond2 = 0.0
    for a in range(AXES):
        force = z[channel.signal + a]
        if laden and a == AXES - 1:
            force += min(max(-force, channel.lightest), channel.heaviest)
        beyond2 += force * force
    absent = log_absence(beyond2, channel.absence)
    for place in range(me.living):
        slot = state.order[place]
        n = me.count - state.starts[slot]
        one = fresh(channel.origin, rho, 1.0, 1.0, n)
        rows[slot, at + 6] += one * one
        rows[slot, at + 7] += absent
        for a in range(AXES):
            force = z[channel.signal + a]
            w = fresh(channel.origin, rho, force, state.previous[channel.signal + a], n)
            rows[slot, at + a] += w * w
            rows[slot, at + 3 + a] += w * one
        weight = rows[slot, at + 6]
        x = max(rows[slot, at] - rows[slot, at + 3] ** 2 / weight, 0.0)
        y = max(rows[slot, at + 1] - rows[slot, at + 4] ** 2 / weight, 0.0)
        w = max(rows[slot, at + 2] - rows[slot, at + 5] ** 2 / weight, 0.0)
        told = over_axes(channel, by_length(model, c, n + 1), x, y, w, n) - 0.5 * AXES * math.log(weight)
        told += mean_density(channel, rows[slot], at + 3, weight, 2 if laden else AXES)
        state.channel[c, slot] = told + rows[slot, at + 7]


@compiled
def mean_density(channel, row, at, weight, axes):
    """`mean_log_density` of the mean force, which is row[at…] / weight; axes: that are biased only."""
    variance = channel.bias2 + channel.floor2 / weight
    told = -0.5 * axes * (LOG_2PI + math.log(variance))
    for a in range(axes):
        told -= 0.5 * (row[at + a] / weight) ** 2 / variance
    if axes < AXES:
        down = -row[at + 2] / weight
        inside = min(max(down, channel.lightest), channel.heaviest)
        mass = math.log(channel.heaviest / channel.lightest)
        mass += math.sqrt(0.5 * math.pi * variance) * (1.0 / channel.lightest + 1.0 / channel.heaviest)
        told -= math.log(inside * mass) + 0.5 * (down - inside) ** 2 / variance
    return told


@compiled
def carried(model, state, c, z):
    """`Carried`. Fields: Σf 3, Σf² 3."""
    me, channel, rows = state.counters[0], model.channels[c], state.rows
    at, signal = channel.field, channel.signal
    for place in range(me.living):
        slot = state.order[place]
        n = me.count - state.starts[slot] + 1
        for a in range(AXES):
            rows[slot, at + a] += z[signal + a]
            rows[slot, at + 3 + a] += z[signal + a] ** 2
        total = rows[slot, at + 2]
        weight = min(total / n, -channel.lightest)
        x, y = rows[slot, at + 3], rows[slot, at + 4]
        w = max(rows[slot, at + 5] + n * weight**2 - 2.0 * weight * total, 0.0)
        state.channel[c, slot] = over_axes(channel, by_length(model, c, n), x, y, w, n)


@compiled
def held(model, state, c, z):
    """`Held`. Fields: log evidence, and the last known state + 1, 0 before one."""
    me, channel, rows = state.counters[0], model.channels[c], state.rows
    at, now = channel.field, z[HOLDING]
    known = not math.isnan(now)
    first = math.log(channel.probability if known and now else 1.0 - channel.probability)
    same, flip = math.log(1.0 - channel.change), math.log(channel.change)
    for place in range(me.living):
        slot = state.order[place]
        if known:
            before = rows[slot, at + 1]
            rows[slot, at] += first if before == 0.0 else (same if before == now + 1.0 else flip)
            rows[slot, at + 1] = now + 1.0
        state.channel[c, slot] = rows[slot, at]


@compiled
def contact(model, state, c, z):
    """`ContactShare`. Fields: Σf_z, log evidence, counts 3."""
    me, channel, rows, joint = state.counters[0], model.channels[c], state.rows, state.scratch
    at, signal = channel.field, channel.signal
    sideways2, down = z[signal] ** 2 + z[signal + 1] ** 2, z[signal + 2]
    for place in range(me.living):
        slot = state.order[place]
        n = me.count - state.starts[slot]
        weight = min(rows[slot, at] / n if n else 0.0, -channel.lightest)
        total = 0.0
        for k in range(STATES):
            total += rows[slot, at + 2 + k] + channel.alpha[k]
        for k in range(STATES):
            square = sideways2 + (down - (weight if k == STATES - 1 else 0.0)) ** 2
            density = square / channel.variance[k] + AXES * (LOG_2PI + math.log(channel.variance[k]))
            share = (rows[slot, at + 2 + k] + channel.alpha[k]) / total
            joint[k] = joint[STATES + k] = math.log(share) - 0.5 * density
        predictive = log_sum_exp(joint[:STATES])
        for k in range(STATES):
            rows[slot, at + 2 + k] += math.exp(joint[STATES + k] - predictive)
        rows[slot, at] += down
        rows[slot, at + 1] += predictive
        share = (rows[slot, at + 2 + channel.state] + channel.alpha[channel.state]) / (total + 1.0)
        state.channel[c, slot] = rows[slot, at + 1] + math.log(STATES * share)


@compiled
def velocity(model, state, c, z):
    """`ConstantVelocity`. Fields: first 3, Σy 3, Σty 3, Σy² 3."""
    me, channel, rows = state.counters[0], model.channels[c], state.rows
    at, signal, step = channel.field, channel.signal, channel.step
    for place in range(me.living):
        slot = state.order[place]
        before = me.count - state.starts[slot]
        if before == 0:
            begin(FIRST, rows[slot], at, signal, z, state.previous, False)
        t, n = step * before, before + 1
        b = step * 0.5 * n * (n - 1)
        k = step**2 * n * (n - 1) * (2 * n - 1) / 6.0 + channel.kappa0
        a = n + channel.kappa0
        determinant = a * k - b * b
        told = AXES * (by_length(model, c, n) - 0.5 * math.log(determinant))
        for i in range(AXES):
            y = (z[signal + i] - rows[slot, at + i]) / channel.unit
            rows[slot, at + 3 + i] += y
            rows[slot, at + 6 + i] += t * y
            rows[slot, at + 9 + i] += y * y
            total, moment = rows[slot, at + 3 + i], rows[slot, at + 6 + i]
            explained = (k * total**2 - 2.0 * b * total * moment + a * moment**2) / determinant
            scale = channel.nu0 * channel.floor2 + max(rows[slot, at + 9 + i] - explained, 0.0)
            told -= 0.5 * (channel.nu0 + n) * math.log(scale)
        state.channel[c, slot] = told

"""The compiled channel models: update all hypotheses with one observation, and compute their log evidence.

The model of a channel is a number, because compiled code cannot look up a method. Each function implements
the class that its docstring names; fields are the sums that it keeps per hypothesis. `joins`: whether there
was an observation before this one. The hypothesis in the last place has just begun, with sums of 0.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import log_sum_exp
from caesura_service.changepoint.kernels.force_level import force_level
from caesura_service.changepoint.kernels.guided_motion_and_corner import corner_weight, guided_motion
from caesura_service.changepoint.kernels.layout import (
    AXES,
    CONSTANT_LEVEL,
    CONSTANT_VELOCITY,
    CONTACT_MIXTURE,
    CORNER_WEIGHT,
    DISSIPATIVE_CONTACT,
    FORCE,
    FREE_SPACE_FORCE,
    GRIPPER_HOLDING,
    GUIDED_MOTION,
    HOLDING,
    LOAD_FORCE,
    NO_CONTACT_RISE,
    PROFILE_MODEL,
    RANDOM_WALK,
    RATE_BOUNDS,
    ROTATION,
    STATES,
    THESIS_LOAD_FORCE,
    TORSION,
    TRACED_MOTION,
    TURN_IN_PLACE,
    TURN_RESISTANCE,
)
from caesura_service.changepoint.kernels.profile_model import profile_model
from caesura_service.changepoint.kernels.residual_evidence import (
    LOG_2PI,
    SQUARES,
    by_length,
    fill_length,
    follow_origin,
    lanes_of,
    log_absence,
    log_presence,
    squares_log_evidence,
    step_squared,
    student,
)
from caesura_service.changepoint.kernels.traced_motion import traced_motion
from caesura_service.changepoint.kernels.turn_in_place import turn_in_place
from caesura_service.numba_support.decorators import compiled


@compiled
def update_channel(ctx, c, joins):
    """Update all living hypotheses with an observation in channel c.

    The evidence goes to `state.channel[c]`.
    """
    which = model_at(ctx).channels[c].model
    if which == PROFILE_MODEL:
        profile_model(ctx, c, joins)
    elif which == RANDOM_WALK:
        random_walk(ctx, c, joins)
    elif which == CONSTANT_LEVEL:
        constant_level(ctx, c, joins)
    elif which in (FREE_SPACE_FORCE, LOAD_FORCE):
        force_level(ctx, c)
    elif which == THESIS_LOAD_FORCE:
        thesis_load_force(ctx, c)
    elif which == GRIPPER_HOLDING:
        gripper_holding(ctx, c)
    elif which == CONTACT_MIXTURE:
        contact_mixture(ctx, c)
    elif which == CONSTANT_VELOCITY:
        constant_velocity(ctx, c)
    else:
        update_weight_channel(ctx, c, joins)


@compiled
def update_weight_channel(ctx, c, joins):
    """Process an observation as `update_channel` does, in a channel that weighs steps or starts."""
    which = model_at(ctx).channels[c].model
    if which == DISSIPATIVE_CONTACT:
        dissipative_contact(ctx, c, joins)
    elif which == GUIDED_MOTION:
        guided_motion(ctx, c, joins)
    elif which == TRACED_MOTION:
        traced_motion(ctx, c)
    elif which == CORNER_WEIGHT:
        corner_weight(ctx, c)
    elif which == TURN_IN_PLACE:
        turn_in_place(ctx, c)
    elif which == RATE_BOUNDS:
        rate_bounds(ctx, c, joins)
    elif which == NO_CONTACT_RISE:
        no_contact_rise(ctx, c, joins)
    elif which == TURN_RESISTANCE:
        turn_resistance(ctx, c, joins)


@compiled
def random_walk(ctx, c, joins):
    """`StudentRandomWalk`. Field: log evidence. The step is the same for every hypothesis."""
    model, state = model_at(ctx), state_at(ctx)
    channel, now, signal = model.channels[c], state.now, model.channels[c].signal
    step2 = step_squared(ctx, signal, joins)
    size2 = now[signal] ** 2 + now[signal + 1] ** 2 + now[signal + 2] ** 2
    log_evidence = student(channel.constant, channel.nu, step2, channel.scale2)
    log_evidence += log_absence(step2, channel.still) + log_presence(size2, channel.presence)
    add_to_all(state.sums[channel.field], state.channel[c], log_evidence, lanes_of(state.counters[0].living))


@compiled
def rate_bounds(ctx, c, joins):
    """`StepSizeWeight`. Field: Σ log weight. The step is the same for every hypothesis."""
    model, state = model_at(ctx), state_at(ctx)
    channel, log_weight = model.channels[c], 0.0
    if joins:
        step2 = step_squared(ctx, channel.signal, joins)
        log_weight = log_presence(step2, channel.least) + log_absence(step2, channel.still)
    add_to_all(state.sums[channel.field], state.channel[c], log_weight, lanes_of(state.counters[0].living))


@compiled
def turn_resistance(ctx, c, joins):
    """`TurnResistance`. Field: Σ log weight. The step is the same for every hypothesis."""
    model, state = model_at(ctx), state_at(ctx)
    channel, now, log_evidence = model.channels[c], state.now, 0.0
    if joins:
        along = torsion2 = about = force2 = 0.0
        for a in range(AXES):
            turned = now[ROTATION + a] - state.previous[ROTATION + a]
            along += now[TORSION + a] * turned
            torsion2 += now[TORSION + a] ** 2
            about += now[FORCE + a] * turned
            force2 += now[FORCE + a] ** 2
        step2 = step_squared(ctx, ROTATION, joins)
        if force2 < channel.force2 or about**2 >= channel.aligned2 * step2 * force2:
            against = max(-along / math.sqrt(step2 + channel.pace**2), 0.0)
            log_evidence = log_presence(against**2, channel.least) + log_absence(torsion2, channel.still)
    add_to_all(state.sums[channel.field], state.channel[c], log_evidence, lanes_of(state.counters[0].living))


@compiled
def no_contact_rise(ctx, c, joins):
    """`NoContactRise`. Fields: force before the start, largest rise."""
    model, state = model_at(ctx), state_at(ctx)
    channel, living, evidence = model.channels[c], state.counters[0].living, state.channel[c]
    before, risen = state.sums[channel.field], state.sums[channel.field + 1]
    now = force_without_load(state.now, channel.heaviest)
    before[living - 1] = force_without_load(state.previous, channel.heaviest) if joins else now
    place = living - 1
    while place >= 0 and state.ages[place] - 1 <= channel.reach:
        risen[place] = max(risen[place], now - before[place])
        place -= 1
    for i in range(lanes_of(living)):
        evidence[i] = -0.5 * risen[i] * risen[i] / channel.scale2


@compiled
def force_without_load(seen, heaviest):
    """Return the size [N] of an observation's force less the weight of a load up to the heaviest [N]."""
    z = seen[FORCE + 2]
    z += min(max(-z, 0.0), heaviest)
    return math.sqrt(seen[FORCE] ** 2 + seen[FORCE + 1] ** 2 + z**2)


@compiled
def dissipative_contact(ctx, c, joins):
    """`DissipativeContactWeight`. Field: log weight. The step is the same for every hypothesis."""
    model, state = model_at(ctx), state_at(ctx)
    channel, now = model.channels[c], state.now
    force2 = along = 0.0
    for a in range(AXES):
        force2 += now[FORCE + a] ** 2
        along += now[FORCE + a] * (now[a] - state.previous[a]) if joins else 0.0
    along /= math.sqrt(step_squared(ctx, 0, joins) + channel.pace**2)
    driving2 = max(along, 0.0) ** 2
    log_evidence = log_presence(force2 - driving2, channel.least) + log_absence(driving2, channel.least)
    add_to_all(state.sums[channel.field], state.channel[c], log_evidence, lanes_of(state.counters[0].living))


@compiled
def add_to_all(sums, log_evidence, value, lanes):
    """Add the same value to every hypothesis' log evidence."""
    for i in range(lanes):
        sums[i] += value
        log_evidence[i] = sums[i]


@compiled
def constant_level(ctx, c, joins):
    """`ConstantLevel`. Fields: origin 3, y 3, Σy² 3."""
    model, state = model_at(ctx), state_at(ctx)
    channel, lanes = model.channels[c], lanes_of(state.counters[0].living)
    follow_origin(ctx, channel, joins)
    fill_length(ctx, c, 0)
    for a in range(AXES):
        add_squares(state.sums[channel.field + 2 * AXES + a], state.work[SQUARES + a], lanes)
    squares_log_evidence(ctx, channel, 0, state.channel[c])


@compiled
def add_squares(sums, values, lanes):
    """Add squared values to sums, and copy the sums to the values."""
    for i in range(lanes):
        sums[i] += values[i] * values[i]
        values[i] = sums[i]


@compiled
def thesis_load_force(ctx, c):
    """`ThesisLoadForce`. Fields: Σf 3, Σf² 3."""
    model, state = model_at(ctx), state_at(ctx)
    channel, work, sums, lanes = model.channels[c], state.work, state.sums, lanes_of(state.counters[0].living)
    at = channel.field
    fill_length(ctx, c, 0)
    for a in range(AXES):
        z = state.now[channel.signal + a]
        add_to_all(sums[at + a], work[SQUARES + a], z, lanes)
        add_to_all(sums[at + AXES + a], work[SQUARES + a], z * z, lanes)
    squares_about_weight(work[SQUARES + 2], sums[at + 2], state.ages, channel.lightest, lanes)
    squares_log_evidence(ctx, channel, 0, state.channel[c])


@compiled
def squares_about_weight(squares, totals, ages, lightest, lanes):
    """Compute sums of squares about the force of a load of at least this weight [N]."""
    for i in range(lanes):
        weight = min(totals[i] / ages[i], -lightest)
        squares[i] = max(squares[i] + weight * (ages[i] * weight - 2.0 * totals[i]), 0.0)


@compiled
def gripper_holding(ctx, c):
    """`GripperHoldingChain`. Fields: log evidence, and the last known state + 1, 0 before one."""
    model, state = model_at(ctx), state_at(ctx)
    channel, now = model.channels[c], state.now[HOLDING]
    log_evidence, lanes, befores = (
        state.sums[channel.field],
        lanes_of(state.counters[0].living),
        state.sums[channel.field + 1],
    )
    if not math.isnan(now):
        first = math.log(channel.probability if now else 1.0 - channel.probability)
        same, flip = math.log(1.0 - channel.change), math.log(channel.change)
        for i in range(lanes):
            log_evidence[i] += first if befores[i] == 0.0 else (same if befores[i] == now + 1.0 else flip)
            befores[i] = now + 1.0
    add_to_all(log_evidence, state.channel[c], 0.0, lanes)


@compiled
def contact_mixture(ctx, c):
    """`ContactMixture`. Fields: Σf_z, log evidence, counts 3."""
    model, state = model_at(ctx), state_at(ctx)
    me, channel, joint, z = state.counters[0], model.channels[c], state.scratch, state.now
    signal, totals, log_evidence = channel.signal, state.sums[channel.field], state.sums[channel.field + 1]
    counts = state.sums[channel.field + 2 : channel.field + 2 + STATES]
    sideways2, down = z[signal] ** 2 + z[signal + 1] ** 2, z[signal + 2]
    for place in range(me.living):
        n = int(state.ages[place]) - 1
        weight = min(totals[place] / n if n else 0.0, -channel.lightest)
        total = 0.0
        for k in range(STATES):
            total += counts[k, place] + channel.alpha[k]
        for k in range(STATES):
            square = sideways2 + (down - (weight if k == STATES - 1 else 0.0)) ** 2
            density = square / channel.variance[k] + AXES * (LOG_2PI + math.log(channel.variance[k]))
            share = (counts[k, place] + channel.alpha[k]) / total
            joint[k] = joint[STATES + k] = math.log(share) - 0.5 * density
        predictive = log_sum_exp(joint, STATES)
        for k in range(STATES):
            counts[k, place] += math.exp(joint[STATES + k] - predictive)
        totals[place] += down
        log_evidence[place] += predictive
        share = (counts[channel.state, place] + channel.alpha[channel.state]) / (total + 1.0)
        state.channel[c, place] = log_evidence[place] + math.log(STATES * share)


@compiled
def constant_velocity(ctx, c):
    """`ConstantVelocity`. Fields: first 3, Σy 3, Σty 3, Σy² 3."""
    model, state = model_at(ctx), state_at(ctx)
    me, channel = state.counters[0], model.channels[c]
    signal, step, kappa0 = channel.signal, channel.step, channel.kappa0
    sums = state.sums[channel.field : channel.field + 4 * AXES]
    for i in range(AXES):
        sums[i, me.living - 1] = state.now[signal + i]
    for place in range(me.living):
        before = int(state.ages[place]) - 1
        t, n = step * before, before + 1
        b = step * 0.5 * n * (n - 1)
        k = step**2 * n * (n - 1) * (2 * n - 1) / 6.0 + kappa0
        a = n + kappa0
        determinant = a * k - b * b
        log_evidence = AXES * (by_length(ctx, c, n) - 0.5 * math.log(determinant))
        for i in range(AXES):
            y = (state.now[signal + i] - sums[i, place]) / channel.unit
            sums[3 + i, place] += y
            sums[6 + i, place] += t * y
            sums[9 + i, place] += y * y
            total, moment = sums[3 + i, place], sums[6 + i, place]
            explained = (k * total**2 - 2.0 * b * total * moment + a * moment**2) / determinant
            scale = channel.nu0 * channel.floor2 + max(sums[9 + i, place] - explained, 0.0)
            log_evidence -= 0.5 * (channel.nu0 + n) * math.log(scale)
        state.channel[c, place] = log_evidence

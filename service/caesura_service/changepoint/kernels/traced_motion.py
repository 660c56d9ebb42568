"""Slow traced line (`TracedMotion`): every hypothesis tracks its own velocity."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import logarithms
from caesura_service.changepoint.kernels.guided_motion_and_corner import (
    DENSITIES,
    WEIGHTS,
    mix_scales,
)
from caesura_service.changepoint.kernels.layout import AXES, MOST_SHARES, PAST
from caesura_service.changepoint.kernels.residual_evidence import lanes_of, log_presence, way_squared
from caesura_service.numba_support.decorators import compiled

MEAN, SPREAD = DENSITIES + MOST_SHARES, DENSITIES + MOST_SHARES + AXES  # fields, after those of guided motion
SQUARED, LOGS = 0, 1  # rows of the work


@compiled
def traced_motion(ctx, c):
    """`TracedMotion`. Fields: Σ log weight, Σ log density of e for each scale, m 3, C, at first 0."""
    model, state = model_at(ctx), state_at(ctx)
    channel, living, work = model.channels[c], state.counters[0].living, state.work
    sums, lanes = state.sums[channel.field : channel.field + SPREAD + 1], lanes_of(living)
    follow_velocity(channel, state.past, sums, work[SQUARED], work[LOGS], living)
    work[SQUARED, living:lanes], work[LOGS, living:lanes] = 0.0, 1.0
    logarithms(work[LOGS], lanes)
    left = log_presence(way_squared(state.past, PAST - 1 - channel.away_steps, PAST - 1), channel.away)
    log_floor2 = math.log(channel.floor2)
    for i in range(living):
        sums[WEIGHTS, i] -= 0.5 * AXES * (work[LOGS, i] + log_floor2)
        if state.ages[i] > channel.away_steps:
            sums[WEIGHTS, i] += left
    for k in range(channel.shares):
        scale2 = channel.share2[k]
        for i in range(lanes):
            work[LOGS, i] = 1.0 + work[SQUARED, i] / (channel.nu * scale2)
        logarithms(work[LOGS], lanes)
        constant = channel.constant - 0.5 * AXES * math.log(scale2)
        for i in range(living):
            sums[DENSITIES + k, i] += constant - 0.5 * (channel.nu + AXES) * work[LOGS, i]
    mix_scales(work, channel.shares, sums, state.channel[c], lanes)


@compiled
def follow_velocity(channel, past, sums, squared, widths, living):
    """Process the last step: compute |e|²/(floor² (R + 1)) and R + 1 of each hypothesis, then m and C."""
    last = past.shape[0] - 1
    for i in range(living):
        spread = sums[SPREAD, i] / channel.rho if sums[SPREAD, i] > 0.0 else channel.reach2
        widths[i] = spread + 1.0
        gain, error2 = spread / widths[i], 0.0
        for a in range(AXES):
            error = past[last, a] - past[last - 1, a] - sums[MEAN + a, i]
            error2 += error**2
            sums[MEAN + a, i] += gain * error
        squared[i] = error2 / (channel.floor2 * widths[i])
        sums[SPREAD, i] = gain

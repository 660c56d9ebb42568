"""The compiled levels of the force: free space and a carried load (`FreeSpaceForce`, `LoadForce`)."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

import math

from caesura_service.changepoint.kernels.array_tuple import model_at, state_at
from caesura_service.changepoint.kernels.fast_math import logarithms
from caesura_service.changepoint.kernels.layout import AXES, LADEN
from caesura_service.changepoint.kernels.residual_evidence import (
    LOG_2PI,
    SQUARES,
    fill_length,
    log_absence,
    over_axes,
    whole,
)
from caesura_service.numba_support.decorators import compiled

WEIGHT, VARIANCE, INSIDE = 5, 6, 7  # rows of the work


@compiled
def biased(here, c):
    """`FreeSpaceForce` and `LoadForce`. Fields: Σw² 3, Σwc 3, Σc², Σ log absence."""
    model, state = model_at(here), state_at(here)
    channel, work, sums, now = model.channels[c], state.work, state.sums, state.now
    at, newborn = channel.field, state.counters[0].living - 1
    lanes, one, absence = whole(newborn + 1), (1.0 - channel.rho) * channel.white, channel.absence
    fill_length(here, c)
    beyond2 = 0.0
    for a in range(AXES):
        z = now[channel.signal + a]
        w = (z - channel.rho * state.previous[channel.signal + a]) * channel.white
        extend(sums[at + a], w * w, z * z, newborn)
        extend(sums[at + AXES + a], w * one, z, newborn)
        if a == AXES - 1:
            z += min(max(-z, channel.lightest), channel.heaviest)
        beyond2 += z * z
    extend(sums[at + 6], one * one, 1.0, newborn)
    absent = log_absence(beyond2, absence)
    extend(sums[at + 7], absent, absent, newborn)
    for a in range(AXES):
        about_mean(work[SQUARES + a], sums[at + a], sums[at + AXES + a], sums[at + 6], lanes)
    over_axes(here, c, channel)
    add_mean_density(here, channel, state.channel[c], lanes)


@compiled
def extend(sums, value, first, newborn):
    """Add a value to every sum; the newborn hypothesis' sum is set to `first` instead."""
    for i in range(newborn):
        sums[i] += value
    sums[newborn] = first


@compiled
def about_mean(squares, total_squares, totals, weights, lanes):
    """Compute sums of squares about the mean, from total squares, totals and weights."""
    for i in range(lanes):
        squares[i] = max(total_squares[i] - totals[i] * totals[i] / weights[i], 0.0)


@compiled
def add_mean_density(here, channel, log_evidence, lanes):
    """Add `mean_log_density` of the mean force, the weight of the mean itself, and absence."""
    state = state_at(here)
    sums, work, at, axes = state.sums, state.work, channel.field, 2 if channel.model == LADEN else AXES
    weights, variances = sums[at + 6], work[VARIANCE]
    for i in range(lanes):
        work[WEIGHT, i] = weights[i]
        variances[i] = channel.bias2 + channel.floor2 / weights[i]
    for a in range(axes):
        add_deviation(log_evidence, sums[at + AXES + a], weights, variances, lanes)
    if axes < AXES:
        add_load(log_evidence, work[INSIDE], sums[at + AXES + 2], weights, variances, channel, lanes)
    logarithms(work[WEIGHT], lanes)
    logarithms(variances, lanes)
    whole_axes, constant = 0.5 * axes, 0.5 * axes * LOG_2PI
    for i in range(lanes):
        log_evidence[i] -= (
            0.5 * AXES * work[WEIGHT, i] + whole_axes * variances[i] + constant - sums[at + 7, i]
        )


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
        held = min(max(down, lightest), heaviest)
        log_evidence[i] -= 0.5 * (down - held) ** 2 / variances[i]
        inside[i] = held * (spread + math.sqrt(0.5 * math.pi * variances[i]) * shoulders)
    logarithms(inside, lanes)
    for i in range(lanes):
        log_evidence[i] -= inside[i]

"""Evidence the long way: the likelihood times the prior, summed over the parameters.

Nothing of the models' own sums is used: residuals are written out, their correlation is a matrix, and the
variance, the bias or the line through time is a grid.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from caesura_service.changepoint.channel_model import Noise
from caesura_service.changepoint.constant_models import (
    ConstantLevel,
    FreeSpaceForce,
    LoadForce,
    ThesisLoadForce,
)
from caesura_service.changepoint.constant_velocity import ConstantVelocity
from caesura_service.changepoint.continued_level import ContinuedLevel
from caesura_service.changepoint.evidence import log_mean_exp, log_sum_exp
from caesura_service.changepoint.profile_library import ProfileLibrary
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.random_walk import StudentRandomWalk

Array = np.ndarray
GRAVITY = 9.81


def log_integral_over_the_variance(log_likelihood, nu0: float, scale2: float) -> float:
    """log_likelihood: of variances (k,), (k,); their prior is scaled inverse chi-squared."""
    log_variance = np.log(scale2) + np.linspace(-30.0, 60.0, 501) * min(1.0, 4.0 / np.sqrt(nu0))
    variance = np.exp(log_variance)
    prior = stats.invgamma.logpdf(variance, nu0 / 2, scale=nu0 * scale2 / 2) + log_variance
    step = log_variance[1] - log_variance[0]
    return float(log_sum_exp(log_likelihood(variance) + prior)) + np.log(step)


def correlation_matrix(n: int, correlation: float, *, pinned: bool, sizes: Array | None = None) -> Array:
    """Of residuals 1..n of an autoregression whose scale is 1; pinned: residual 0 is known to be 0.

    sizes: (n,) of what is new in each residual, relative to the others; only where residual 0 is known.
    """
    i = np.arange(1, n + 1)
    if sizes is not None and (sizes != 1.0).any():
        assert pinned
        new = np.tril(correlation ** np.maximum(np.subtract.outer(i, i), 0)) * sizes
        return (1.0 - correlation**2) * new @ new.T
    matrix = correlation ** np.abs(np.subtract.outer(i, i))
    return matrix - correlation ** np.add.outer(i, i) * pinned


def log_normal(residuals: Array, matrix: Array, variance: Array) -> Array:
    """(k,) log density of residuals (n, axes) with covariance variance (k,) × matrix on each axis."""
    n, axes = residuals.shape
    square = np.einsum("na,nm,ma->", residuals, np.linalg.inv(matrix), residuals)
    logdet = np.linalg.slogdet(matrix)[1]
    return -0.5 * (square / variance + n * axes * np.log(2 * np.pi * variance) + axes * logdet)


def log_known_mean(
    noise: Noise,
    residuals: Array,
    scale2: float,
    *,
    pinned: bool,
    weigh_last: bool,
    sizes: Array | None = None,
) -> Array:
    """(axes or 1,) evidence of residuals (n, axes); weigh_last: the last one's density is 1 at its mode."""
    sizes = np.ones(len(residuals)) if sizes is None else sizes
    matrix = correlation_matrix(len(residuals), noise.correlation, pinned=pinned, sizes=sizes)

    def evidence(some: Array) -> float:
        def likelihood(variance: Array) -> Array:
            new = variance * (1 - noise.correlation**2) * sizes[-1] ** 2
            peak = np.log(2 * np.pi * new) if weigh_last else 0.0
            return log_normal(some, matrix, variance) + 0.5 * some.shape[1] * peak

        return log_integral_over_the_variance(likelihood, noise.nu0, scale2)

    groups = [residuals] if noise.joint else np.split(residuals, 3, axis=1)
    return np.array([evidence(group) for group in groups])


def origin(model, before: Array, z: Array) -> Array:
    return {"previous": before, "first": z[0], "zero": np.zeros(3)}[model.origin]


def constant(model: ConstantLevel, before: Array, z: Array) -> float:
    y = z - origin(model, before, z)
    pinned = model.origin == "previous"
    scale2 = model.noise.floor**2
    return float(log_known_mean(model.noise, y, scale2, pinned=pinned, weigh_last=False).sum())


def profiled(model: ProfileModel, before: Array, z: Array) -> float:
    start = origin(model, before, z)
    y, noise = z - start, model.noise
    pinned = model.origin == "previous"
    t = model.library.step_s * (np.arange(len(y)) + pinned)
    extent2 = y[-1] @ y[-1]
    each = [
        [
            log_known_mean(
                noise,
                y - y[-1] * profile(t)[:, None],
                noise.floor**2 + share**2 * extent2,
                pinned=pinned,
                weigh_last=model.target is not None,
                sizes=sizes_of(model.library, profile, len(y) - 1 + pinned)[int(pinned) :],
            )
            for share in noise.shares
        ]
        for profile in model.library.profiles
    ]
    over_profiles = np.max if model.choice == "maximum" else log_mean_exp
    total = float(np.sum(over_profiles(log_mean_exp(np.array(each), axis=1), axis=0)))
    if model.target is not None:
        total += float(model.target.log_density(y[-1:])[0])
    if model.pace:
        steps2 = (np.diff(np.vstack([before, z]), axis=0) ** 2).sum(axis=1)
        total += float(np.log1p(-np.exp(-0.5 * steps2 / model.pace**2)).sum())
    return total


def sizes_of(library: ProfileLibrary, profile, last: int) -> Array:
    """(last + 1,) how large residuals 0..last are, 1 where the profile is fastest; of 0 it is no matter."""
    steps = np.diff(profile(library.step_s * np.arange(200.0)), prepend=0.0)
    share = np.sqrt(
        library.rest_scale_ratio**2 + (1 - library.rest_scale_ratio**2) * (steps / steps.max()) ** 2
    )
    return (
        np.concatenate([[1.0], share[1:]])[: last + 1]
        if library.rest_scale_ratio < 1.0
        else np.ones(last + 1)
    )


def walk(model: StudentRandomWalk, before: Array, z: Array) -> float:
    """Step by step."""
    steps = np.diff(np.vstack([before, z]), axis=0)
    density = stats.multivariate_t(np.zeros(3), model.scale**2 * np.eye(3), model.nu)
    total = float(density.logpdf(steps).sum())
    total -= 0.5 * float((steps**2).sum()) / model.still**2 if model.still else 0.0
    if model.presence:
        total += float(np.log1p(-np.exp(-0.5 * (z**2).sum(axis=1) / model.presence**2)).sum())
    return total


def biased(model: FreeSpaceForce, before: Array, z: Array) -> float:
    """Deviations from the mean with their variance summed over, and the mean with the bias summed over."""
    n, noise = len(z), model.noise
    matrix = correlation_matrix(n, noise.correlation, pinned=False)
    inverse = np.linalg.inv(matrix)
    weight = inverse.sum()
    mean = inverse.sum(axis=0) @ z / weight

    def deviations(some: Array) -> float:
        def likelihood(variance: Array) -> Array:
            whole = log_normal(some, matrix, variance)
            return whole + 0.5 * some.shape[1] * np.log(2 * np.pi * variance / weight)

        return log_integral_over_the_variance(likelihood, noise.nu0, noise.floor**2)

    groups = [z - mean] if noise.joint else np.split(z - mean, 3, axis=1)
    variance = noise.floor**2 / weight
    if type(model) is FreeSpaceForce:
        grid = np.linspace(-12 * model.bias, 12 * model.bias, 20_001)
        prior = stats.norm.logpdf(grid, 0.0, model.bias) + np.log(grid[1] - grid[0])
        given = sum(log_sum_exp(prior + stats.norm.logpdf(m, grid, np.sqrt(variance))) for m in mean)
    else:  # a load's density is not one of an unknown bias: it is looked at by itself
        given = model.mean_log_density(mean[None], np.array([[variance]]))[0]
    lightest, heaviest = model.least_kg * GRAVITY, model.most_kg * GRAVITY
    beyond = np.array([(x, y, down + min(max(-down, lightest), heaviest)) for x, y, down in z])
    absent = -0.5 * (beyond**2).sum() / model.absence**2 if model.absence else 0.0
    return sum(map(deviations, groups)) + float(given) + absent


def continued(model: ContinuedLevel, before: Array, z: Array) -> float:
    """A new level, or the one of the observation before, by how likely that is of this contact state."""
    level, x = model.level, before[None]
    assert model.memory == 1
    loads = GRAVITY * np.linspace(level.least_kg, level.most_kg, 20_001)
    weighed = before + np.column_stack([np.zeros((loads.size, 2)), loads])
    beyond = weighed[np.argmin((weighed**2).sum(axis=1))]
    absent = -0.5 * (beyond**2).sum() / level.absence**2 if level.absence else 0.0
    bias = before if type(level) is FreeSpaceForce else beyond
    prior = stats.multivariate_normal(np.zeros(3), (level.bias**2 + level.noise.floor**2) * np.eye(3))
    q = model.probability * np.exp(absent + prior.logpdf(bias) - prior.logpdf(np.zeros(3)))
    going_on = biased(level, before, np.concatenate([x, z])) - biased(level, before, x)
    return float(np.logaddexp(np.log(1.0 - q) + biased(level, before, z), np.log(q) + going_on))


def carried(model: ThesisLoadForce, before: Array, z: Array) -> float:
    """The best of all loads."""
    lightest = -model.least_kg * GRAVITY
    load = np.array([0.0, 0.0, min(lightest, z[:, 2].mean())])
    scale2 = model.noise.floor**2
    return float(log_known_mean(model.noise, z - load, scale2, pinned=False, weigh_last=False).sum())


def constant_velocity(model: ConstantVelocity, before: Array, z: Array) -> float:
    """Both coefficients of the line, and the variance, on grids."""
    y, t = (z - z[0]) / model.length_unit_m, model.step_s * np.arange(len(z))
    unit = np.linspace(-8.0, 8.0, 65)  # of coefficients whose prior is N(0, σ²/κ₀)
    level, slope = (grid.ravel() for grid in np.meshgrid(unit, unit))
    prior = stats.norm.logpdf(level) + stats.norm.logpdf(slope) + 2 * np.log(unit[1] - unit[0])
    log_variance = np.log(model.sigma2) + np.linspace(-5.0, 14.0, 77)
    total = 0.0
    for axis in range(3):
        terms = []
        for one in log_variance:
            line = np.sqrt(np.exp(one) / model.kappa0) * (level[:, None] + slope[:, None] * t)
            likelihood = stats.norm.logpdf(y[:, axis], line, np.exp(0.5 * one)).sum(axis=1)
            terms.append(float(log_sum_exp(likelihood + prior)))
        chi2 = stats.invgamma.logpdf(np.exp(log_variance), model.nu0 / 2, scale=model.nu0 * model.sigma2 / 2)
        total += float(log_sum_exp(np.array(terms) + chi2 + log_variance))
        total += np.log(log_variance[1] - log_variance[0])
    return total


QUADRATURE = {
    ConstantLevel: constant,
    ProfileModel: profiled,
    FreeSpaceForce: biased,
    LoadForce: biased,
    ContinuedLevel: continued,
    ThesisLoadForce: carried,
    ConstantVelocity: constant_velocity,
    StudentRandomWalk: walk,
}

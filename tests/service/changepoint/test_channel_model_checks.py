"""One contract over every segment model: catalogue.py says which there are and what is true of each."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from caesura_service.changepoint import channel_model_checks
from caesura_service.changepoint.channel_model import ChannelModel, ModelInput
from caesura_service.changepoint.channel_model_checks import everywhere, mass, rows_after
from caesura_service.changepoint.constant_models import GripperHoldingChain
from caesura_service.changepoint.continued_level import ContinuedLevel
from caesura_service.changepoint.corner_weight import CornerWeight
from caesura_service.changepoint.default_presets import default_channels
from caesura_service.changepoint.dissipative_contact import DissipativeContactWeight
from caesura_service.changepoint.evidence import known_mean_log_evidence, log_mean_exp
from caesura_service.changepoint.force_rise_penalty import NoContactRise
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.profile_model import ProfileModel
from caesura_service.changepoint.step_size_weight import StepSizeWeight
from caesura_service.changepoint.turn_in_place import TurnInPlace
from caesura_service.changepoint.turn_resistance import TurnResistance
from service.changepoint.catalogue import (
    APART,
    DENSITY,
    EVERYTHING,
    GIVEN_TARGET,
    LARGEST,
    MODELS,
    PLUGGED_IN,
    WEIGHTED,
    Entry,
    digest,
    observations,
)
from service.changepoint.quadrature import QUADRATURE, sizes_of

TOLERANCE = 1e-2  # of a sum over all of space with 13³ places


def that(holds: str) -> pytest.MarkDecorator:
    """Every model of which something is true."""
    return pytest.mark.parametrize(
        "entry", [pytest.param(e, id=n) for n, e in MODELS.items() if e.holds == holds]
    )


def data(count: int, *, seed: int = 1, down: float = 0.0) -> np.ndarray:
    """(count, 3) in an entry's unit."""
    return np.random.default_rng(seed).normal([0.0, 0.0, -down], 0.5, (count, 3))


def evidence_of(entry: Entry, values: np.ndarray) -> float:
    """Log evidence of all but the first value as one segment."""
    return float(entry.model.log_evidence(rows_after(entry.model, entry.observe(values)))[1])


# Normalised


@pytest.mark.slow
@that(DENSITY)
@pytest.mark.parametrize("before", [0, 2])
def test_evidence_summed_over_the_next_observation_is_the_evidence_before(entry: Entry, before: int) -> None:
    first = int(entry.explains_first)  # it is the origin, and no density
    past = data(1 + first + before)
    places = everywhere(entry.channel, entry.unit * past.mean(axis=0), entry.unit * entry.size)
    assert mass(entry.model, entry.observe(past), places) / entry.unit**3 == pytest.approx(1.0, abs=TOLERANCE)


@pytest.mark.parametrize(
    "entry", [pytest.param(e, id=n) for n, e in MODELS.items() if e.explains_first and "target" not in n]
)
def test_a_first_observation_that_is_the_origin_says_the_same_wherever_it_lies(entry: Entry) -> None:
    values = data(2)
    assert evidence_of(entry, values + 40.0) == pytest.approx(evidence_of(entry, values), abs=1e-9)


@pytest.mark.slow
@that(APART)
def test_all_observations_of_free_space_together_sum_to_one(entry: Entry) -> None:
    """Of two, the mean and the difference are independent, so that each can be summed by itself."""
    at = np.array([[0.3, -0.2, -3.0], [0.4, 0.1, -0.5]])  # mean and difference

    def density(mean: np.ndarray, difference: np.ndarray) -> float:
        lead_in = np.zeros(3)
        return float(
            np.exp(evidence_of(entry, np.array([lead_in, mean - difference / 2, mean + difference / 2])))
        )

    def along(axis: int, grid: np.ndarray, which: int) -> float:
        """Sum over one axis of the mean (0) or the difference (1), relative to what is there."""
        points = [at.copy() for _ in grid]
        for point, value in zip(points, grid, strict=True):
            point[which, axis] = value
        return integrate.trapezoid([density(*point) for point in points], grid) / density(*at)

    total = density(*at)
    for axis in range(3):
        total *= along(axis, np.linspace(-60.0, 60.0, 301), 0)
    if entry.model.noise.joint:  # type: ignore[attr-defined]
        size = np.linspace(0.0, 60.0, 401)
        weighed = [density(at[0], np.array([one, 0.0, 0.0])) for one in size]
        total *= integrate.trapezoid(4 * np.pi * size**2 * weighed, size) / density(*at)
    else:
        for axis in range(3):
            total *= along(axis, np.linspace(-60.0, 60.0, 301), 1)
    assert total == pytest.approx(1.0, abs=TOLERANCE)


@pytest.mark.parametrize("name", ["untouched", "laden"])
def test_free_space_is_all_but_a_product_of_predictives_with_the_presets_noise(name: str) -> None:
    """To 2 %, where the noise is as large as the preset says; where it is eight times that, no longer."""
    model = replace(default_channels(1.5)[name].level, absence=0.0)  # type: ignore[attr-defined]
    down = 4.0 * (name == "laden")
    past = [ModelInput(np.zeros(3), force) for force in data(4, down=down)]
    assert mass(model, past, everywhere("force", past[-1].force, 0.35)) == pytest.approx(1.0, abs=0.02)


@that(WEIGHTED)
def test_weights_only_take_away(entry: Entry) -> None:
    weights = ("absence", "presence", "pace", "still", "away")
    off = {name: 0.0 for name in weights if hasattr(entry.model, name)}
    rows = entry.observe(data(9, down=2.5))
    with_weights, without = (
        model.log_evidence(rows_after(model, rows)) for model in (entry.model, replace(entry.model, **off))
    )
    taken = without - with_weights
    unweighed = entry.unweighed
    assert (taken[: taken.size - unweighed] > 0.0).all()
    # The longer a segment, the more was weighed; the first has no step.
    assert (np.diff(taken[1 : taken.size - unweighed]) < 0.0).all()


@pytest.mark.slow
@that(GIVEN_TARGET)
def test_given_its_target_what_lies_before_sums_to_what_the_last_residual_is_worth(entry: Entry) -> None:
    """With a target the rest sums to a weight below 1, for the target's own residual is weighed, not counted.

    With v the variance of that residual e, given where the segment starts, and noise of scale σ:
    without a target the sum is the density of e, and with one √((1 − ρ²)/v) exp(−e²/2vσ²), σ averaged.
    """
    model = entry.model
    assert isinstance(model, ProfileModel)
    n = 3 if entry.explains_first else 2
    values = np.array([[0.0, 0.1, -0.2], [0.3, -0.1, 0.4], [1.1, 0.6, -0.9]])[3 - n :]
    past, last = values[:-1], values[-1]
    start = {"previous": past[0], "first": past[-1], "zero": np.zeros(3)}[model.origin]
    y = last - start

    places = everywhere(entry.channel, 0.5 * (last + past[-1]), entry.size)
    known = evidence_of(entry, past) if entry.explains_first else 0.0
    got = np.log(mass(model, entry.observe(past), places, entry.observe(last[None]))) + known

    correlation2 = model.noise.correlation**2
    at = n - 1 + (model.origin == "previous")
    sizes2 = np.array([sizes_of(model.library, profile, at) ** 2 for profile in model.library.profiles])
    new = (1.0 - correlation2) * sizes2[:, -1]
    variance = (
        np.ones(len(new))
        if model.origin == "zero"
        else new + (1.0 - correlation2) * correlation2 * (sizes2[:, -2])
    )
    t = np.array(model.library.step_s * at)
    residual2 = np.array([(y * (1.0 - profile(t))) ** 2 for profile in model.library.profiles])
    residual2 /= variance[:, None]
    counted = n - 1 - (model.target is not None)
    worth = -0.5 * np.log(variance) if model.target is None else 0.5 * np.log(new / variance)
    if model.noise.joint:
        residual2, counted, worth = residual2.sum(axis=1, keepdims=True), 3 * counted, 3 * worth
    scales2 = [model.noise.floor**2 + share**2 * (y @ y) for share in model.noise.shares]
    each = [
        known_mean_log_evidence(counted, residual2, model.noise.nu0, scale2) + worth[:, None]
        for scale2 in scales2
    ]
    expected = float(log_mean_exp(np.vstack(each), axis=0).sum())
    if model.target is not None:
        assert expected < 0.0 or n == 3
        expected += float(model.target.log_density(y[None])[0])
    assert got == pytest.approx(expected, abs=TOLERANCE)


@that(LARGEST)
def test_the_maximum_is_that_of_each_profile_alone(entry: Entry) -> None:
    model = entry.model
    assert isinstance(model, ProfileModel)
    rows = entry.observe(data(6))
    weighed = model.log_evidence(rows_after(model, rows))
    mixture = replace(model, choice="mixture")
    even = mixture.log_evidence(rows_after(mixture, rows))
    count = len(model.library)
    assert (weighed >= even).all()
    assert (weighed <= even + 3 * np.log(count)).all()
    assert weighed[0] - even[0] > 0.1


@that(PLUGGED_IN)
def test_the_load_that_is_plugged_in_is_the_best_of_all(entry: Entry) -> None:
    values = data(5, down=4.0)
    weighed = evidence_of(entry, values)
    loads = np.linspace(0.2, 1.0, 4001)
    scale2, nu0 = entry.model.noise.floor**2, entry.model.noise.nu0  # type: ignore[attr-defined]
    ssr = np.array([((values[1:] - [0.0, 0.0, -9.81 * kg]) ** 2).sum(axis=0) for kg in loads])
    alone = known_mean_log_evidence(len(values) - 1, ssr, nu0, scale2).sum(axis=1)
    assert weighed >= alone.max() - 1e-12
    assert weighed == pytest.approx(alone.max(), abs=1e-5)
    assert weighed > log_mean_exp(alone) + 1.0


def test_what_the_gripper_holds_next_is_a_probability() -> None:
    model = GripperHoldingChain(0.2, change=0.1)
    nowhere = ModelInput(np.zeros(3), np.zeros(3))
    places = [nowhere._replace(holding=holding) for holding in (0.0, 1.0)], np.ones(2)
    for past in ([], [0.0], [1.0, 0.0], [np.nan, 1.0, np.nan]):
        known = [nowhere, *(nowhere._replace(holding=holding) for holding in past)]
        assert mass(model, known, places) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
@pytest.mark.parametrize("name", [name for name, e in MODELS.items() if type(e.model) in QUADRATURE])
def test_evidence_is_the_sum_over_all_parameters(name: str, n: int) -> None:
    entry = MODELS[name]
    values = data(1 + n, seed=n, down=1.5)
    reference = QUADRATURE[type(entry.model)]
    expected = reference(entry.model, entry.unit * values[0], entry.unit * values[1:])
    assert evidence_of(entry, values) == pytest.approx(expected, abs=1e-6)


def test_every_sum_over_parameters_is_compared_with_a_model() -> None:
    assert set(QUADRATURE) <= {type(entry.model) for entry in MODELS.values()}


def inputs(forces: np.ndarray, step_m: float = 0.01) -> list[ModelInput]:
    """Forces (n, 3) [N] of an arm that moves by this step from one observation to the next."""
    places = np.outer(np.arange(len(forces)), [step_m, 0.0, 0.0])
    return [ModelInput(place, force) for place, force in zip(places, forces, strict=True)]


def cost_of_a_start(model: ChannelModel, seen: list[ModelInput]) -> float:
    """By how much one segment explains the observations better than two, each of a half of them, do."""
    half = len(seen) // 2
    rows = rows_after(model, seen[:half])
    first = model.log_evidence(rows)[0]
    whole, second = model.log_evidence(rows_after(model, seen[half:], rows))[[0, half]]
    return float(whole - first - second)


@pytest.mark.parametrize(("varies_n", "saved"), [(0.05, 8.0), (0.1, 5.0), (0.2, 1.5), (0.5, 0.5), (1.0, 0.5)])
def test_a_start_in_a_movement_costs_less_than_a_new_level_does(varies_n: float, saved: float) -> None:
    mixture = default_channels(1.5)["untouched"]
    assert isinstance(mixture, ContinuedLevel)
    draws = [np.random.default_rng(seed).normal([0.5, 0.0, -1.0], varies_n, (24, 3)) for seed in range(8)]
    moving, resting, new = (
        np.mean([cost_of_a_start(model, inputs(forces, step_m)) for forces in draws])
        for model, step_m in ((mixture, 0.01), (mixture, 0.0), (mixture.level, 0.01))
    )
    assert resting == pytest.approx(new, abs=1e-3)
    assert 0.0 < moving < new - saved


def test_after_a_contact_the_level_is_new() -> None:
    mixture = default_channels(1.5)["untouched"]
    assert isinstance(mixture, ContinuedLevel)
    forces = np.random.default_rng(0).normal(0.0, 0.2, (12, 3))
    forces[:6] += [12.0, 0.0, 9.0]
    seen = inputs(forces)
    fresh, mixed = (model.log_evidence(rows_after(model, seen))[6] for model in (mixture.level, mixture))
    assert mixed == pytest.approx(fresh, abs=1e-3)


# Pure, independent, serialisable, seeded, constant work


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERYTHING)
def test_a_model_is_pure_its_hypotheses_are_independent_and_it_can_be_stored(name: str) -> None:
    channel_model_checks.check_pure(EVERYTHING[name], observations(8))
    channel_model_checks.check_independent(EVERYTHING[name], observations(8))
    channel_model_checks.check_serialisable(EVERYTHING[name], observations(10))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*MODELS, "held", "default's lattice"])
def test_a_step_costs_the_same_early_and_late(name: str) -> None:
    seen = observations(10)
    channel_model_checks.check_constant_work(
        EVERYTHING[name], (seen[i % 10] for i in range(channel_model_checks.LATE + 1))
    )


def test_a_collection_in_between_is_no_work_of_the_model() -> None:
    weighed: list[str] = []

    def callback(phase: str, info: dict[str, int]) -> None:
        weighed.append(phase)
        for _ in range(len(weighed)):  # more every time
            pass

    before = gc.get_threshold()
    gc.callbacks.append(callback)
    gc.set_threshold(1)
    try:
        seen = observations(10)
        channel_model_checks.check_constant_work(
            EVERYTHING["carried"], (seen[i % 10] for i in range(channel_model_checks.LATE + 1))
        )
    finally:
        gc.set_threshold(*before)
        gc.callbacks.remove(callback)
    assert weighed


def test_nothing_depends_on_the_process_or_on_the_global_random_state() -> None:
    before = np.random.get_state()  # noqa: NPY002
    here = digest()
    assert str(before) == str(np.random.get_state())  # noqa: NPY002
    environment = os.environ | {"PYTHONHASHSEED": "12345", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "service.changepoint.catalogue"]
    there = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=60)
    assert there.stdout.strip() == here


def test_the_catalogue_has_every_model_of_every_preset() -> None:
    used = {type(model) for preset in PRESETS.values() for model in preset.channels(1.5).values()}
    listed = {type(entry.model) for entry in MODELS.values()} | {
        GripperHoldingChain,
        DissipativeContactWeight,
        CornerWeight,
        NoContactRise,
        StepSizeWeight,
        TurnInPlace,
        TurnResistance,
    }
    assert used <= listed

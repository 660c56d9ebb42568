"""The compiled filter against the reference: every model, every preset, streams of anything, to 1e-9."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from caesura_service.changepoint import evidence
from caesura_service.changepoint.channel_model import ChannelModel, Choice, ModelInput, Noise
from caesura_service.changepoint.compiled_filter import CompiledRunLengthFilter, can_compile
from caesura_service.changepoint.evidence_window import outline_of
from caesura_service.changepoint.filter_choice import make_filter
from caesura_service.changepoint.filter_parameters import FilterParameters
from caesura_service.changepoint.guided_motion import GuidedMotion
from caesura_service.changepoint.hazard import Geometric, Hazard, NegativeBinomial, Refractory, Uniform
from caesura_service.changepoint.kernels.fast_math import (
    exp_of_negative,
    log,
    log_sum_exp,
    share_missing,
    shares_of,
)
from caesura_service.changepoint.kernels.layout import BLOCK
from caesura_service.changepoint.presets import PRESETS
from caesura_service.changepoint.profile_library import ProfileLibrary, minimum_jerk
from caesura_service.changepoint.profile_model import DisplacementPrior, ProfileModel
from caesura_service.changepoint.random_walk import StudentRandomWalk
from caesura_service.changepoint.run_length_filter import RunLengthFilter
from caesura_service.changepoint.segment_model_set import SegmentKind, SegmentModelSet
from caesura_service.changepoint.segments import stretches
from service.changepoint.catalogue import EVERYTHING, Whole, observations
from service.streams import pieces

HAZARD = Geometric(8.0)
MODELS = [pytest.param(model, id=name) for name, model in EVERYTHING.items() if not isinstance(model, Whole)]
Stream = Iterable[tuple[ModelInput, bool]]


def alone(model: ChannelModel) -> SegmentModelSet:
    return SegmentModelSet({"it": model}, (SegmentKind("motion", "motion", "free", ("it",)),))


def assert_close(own: np.ndarray, others: np.ndarray, rtol: float = 0.0, what: str = "") -> None:
    """As numpy's, which takes ten times as long, and is asked what differs where something does."""
    with np.errstate(invalid="ignore"):
        near = np.abs(own - others) <= 1e-9 + rtol * np.abs(others)
    if own.shape != others.shape or not (near | (own == others)).all():
        np.testing.assert_allclose(own, others, rtol=rtol, atol=1e-9, err_msg=what)


def assert_agree(compiled: CompiledRunLengthFilter, reference: RunLengthFilter) -> None:
    assert compiled.starts.tolist() == reference.starts.tolist()
    assert (compiled.count, compiled.root, compiled.capped) == (
        reference.count,
        reference.root,
        reference.capped,
    )
    for name in ("log_joint", "log_evidence", "kind_log_evidence"):
        assert_close(getattr(compiled, name), getattr(reference, name), 1e-11, name)
    assert_close(compiled.posterior, reference.posterior, 1e-7, "posterior")
    assert_close(compiled.smoothed, reference.smoothed, 1e-7, "smoothed")
    assert compiled.outline() == outline_of(compiled.lattice, compiled.map_path())
    for own, others in ((compiled.map_path(), reference.map_path()), (compiled.final, reference.final)):
        assert [segment.start for segment in own] == [segment.start for segment in others]
        for one, other in zip(own, others, strict=True):
            assert_close(one.kind_log_evidence, other.kind_log_evidence, 1e-11, "kind_log_evidence")


def follow(
    lattice: SegmentModelSet, stream: Stream, parameters: FilterParameters, hazard: Hazard = HAZARD
) -> CompiledRunLengthFilter:
    """Both filters over a stream, compared after every observation."""
    compiled = CompiledRunLengthFilter(lattice, hazard, parameters)
    reference = RunLengthFilter(lattice, hazard, parameters)
    for observed, boundary in stream:
        compiled.step(observed, boundary=boundary)
        reference.step(observed, boundary=boundary)
        assert_agree(compiled, reference)
    assert stretches(compiled)[0].end == stretches(reference)[0].end
    return compiled


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_every_model(model: ChannelModel) -> None:
    stream = [(observed, i == 13) for i, observed in enumerate(observations(20))]
    follow(alone(model), stream, FilterParameters(window=12))


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_every_model_where_an_observation_has_no_step(model: ChannelModel) -> None:
    """At the beginning, and after a gap, which may follow another one at once."""
    stream = [(observed, i in {1, 2, 12, 13}) for i, observed in enumerate(observations(20))]
    stepwise = replace(alone(model), stepwise=True)
    follow(stepwise, stream, FilterParameters(window=12), Refractory(8.0, 3))


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize(
    ("parameters", "count"),
    [
        (FilterParameters(), 50),
        (FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=500, window=24, certain=1.0), 32),
        (FilterParameters(keep_youngest=2, cap=6, window=8, certain=0.8, certain_after=2), 60),
    ],
    ids=["as is", "unpruned", "tight"],
)
def test_every_preset(name: str, parameters: FilterParameters, count: int) -> None:
    rng = np.random.default_rng(1)
    lattice = PRESETS[name].lattice(orientation=True, torque=True)
    follow(lattice, pieces(rng, count), parameters, PRESETS[name].hazard)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
@example(3744)  # turns far from the origin of the base frame
@settings(max_examples=6, deadline=None)
def test_any_stream(seed: int) -> None:
    lattice = PRESETS["default"].lattice(orientation=seed % 2 == 0)
    follow(lattice, pieces(np.random.default_rng(seed), 70), FilterParameters())


@pytest.mark.parametrize("hazard", [Uniform(30), NegativeBinomial(8.0), Refractory(8.0, 2)], ids=repr)
def test_every_hazard(hazard: Hazard) -> None:
    follow(PRESETS["force"].lattice(), pieces(np.random.default_rng(3), 60), FilterParameters(), hazard)


@pytest.mark.slow
def test_a_segment_longer_than_the_tables_and_no_node_too_many() -> None:
    still = [(ModelInput(np.zeros(3), np.zeros(3)), False)] * 300  # the tables are too short three times
    compiled = follow(PRESETS["default"].lattice(), still, FilterParameters(window=10))
    assert compiled.root == 0
    groups = len(compiled.lattice.log_transition)
    assert compiled._state.counters["nodes"][0] <= groups * (compiled.starts.size + 2)


SHORT = ProfileLibrary([minimum_jerk(0.3), minimum_jerk(0.6)], 0.1, 0.6, 0.3)


@pytest.mark.parametrize("joint", [True, False])
@pytest.mark.parametrize("target", [None, DisplacementPrior(4.0, 0.5)])
def test_a_segment_that_goes_on_long_after_every_profile_rests(
    joint: bool, target: DisplacementPrior | None
) -> None:
    noise = Noise(4.0, 0.01, shares=(0.05, 0.3), joint=joint, correlation=0.6)
    model = ProfileModel("position", SHORT, noise, origin="previous", target=target)
    stream = [(observed, False) for observed in observations(150)]
    unpruned = FilterParameters(prune_ratio=0.0, keep_youngest=0, cap=200, window=10, certain=1.0)
    lasting = follow(alone(model), stream, unpruned)
    assert SHORT.last_row(10**6) < 100 < lasting.count - lasting.starts[0]


@pytest.mark.parametrize("choice", get_args(Choice))
@pytest.mark.parametrize("shares", [(0.0,), (0.05, 0.3)])
@pytest.mark.parametrize("joint", [True, False])
def test_more_profiles_than_are_worked_on_at_once(
    choice: Choice, shares: tuple[float, ...], joint: bool
) -> None:
    many = ProfileLibrary([minimum_jerk(0.3 + 0.02 * i) for i in range(BLOCK + 3)], 0.1, 0.6)
    noise = Noise(4.0, 0.01, shares=shares, joint=joint, correlation=0.6)
    stream = [(observed, False) for observed in observations(40)]
    follow(alone(ProfileModel("position", many, noise, choice)), stream, FilterParameters(window=10))


def test_conditioning_on_any_start_of_the_best_segmentation() -> None:
    lattice, parameters = PRESETS["default"].lattice(), FilterParameters(certain=1.0)
    compiled = CompiledRunLengthFilter(lattice, HAZARD, parameters)
    reference = RunLengthFilter(lattice, HAZARD, parameters)
    for i, (observed, _) in enumerate(pieces(np.random.default_rng(5), 120)):
        for one in (compiled, reference):
            one.step(observed)
            if i % 15 == 14 and len(one.map_path()) > 1:
                one.condition_on_start(one.map_path()[1].start)
        assert_agree(compiled, reference)
        starts = [segment.start for segment in reference.final]
        for start in starts:
            assert compiled.event_probability(start) == pytest.approx(
                reference.event_probability(start), abs=1e-9
            )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["default", "integrated"])
def test_what_is_known_of_starts(name: str) -> None:
    rng = np.random.default_rng(6)
    lattice, parameters = PRESETS[name].lattice(), FilterParameters(window=20)
    compiled = CompiledRunLengthFilter(lattice, HAZARD, parameters)
    reference = RunLengthFilter(lattice, HAZARD, parameters)
    for observed, boundary in pieces(rng, 200):
        known = rng.choice([None, None, None, True, False, False])
        for one in (compiled, reference):
            one.step(observed, boundary=boundary, changepoint=known)
        assert_agree(compiled, reference)


def test_the_same_observations_give_the_same_bits_whatever_else_is_going_on() -> None:
    stream = list(pieces(np.random.default_rng(7), 80))
    other = list(pieces(np.random.default_rng(8), 80))
    lattice = PRESETS["default"].lattice()
    first, second, between = (CompiledRunLengthFilter(lattice, HAZARD) for _ in range(3))
    for observed, boundary in stream:
        first.step(observed, boundary=boundary)
    for (observed, boundary), (disturbing, _) in zip(stream, other, strict=True):
        second.step(observed, boundary=boundary)
        between.step(disturbing)
    assert first.log_joint.tobytes() == second.log_joint.tobytes()
    assert first.smoothed.tobytes() == second.smoothed.tobytes()


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("channel", ["position", "force"])
def test_what_is_not_finite_is_refused_and_changes_nothing(value: float, channel: str) -> None:
    compiled = CompiledRunLengthFilter(PRESETS["default"].lattice(), HAZARD)
    good = ModelInput(np.zeros(3), np.zeros(3))
    compiled.step(good)
    with pytest.raises(ValueError, match=f"observation 1: {channel} is"):
        compiled.step(good._replace(**{channel: np.array([0.0, value, 0.0])}))
    assert compiled.count == 1


def test_values_so_large_that_their_sum_overflows_are_finite_all_the_same() -> None:
    compiled = CompiledRunLengthFilter(PRESETS["default"].lattice(), HAZARD)
    compiled.step(ModelInput(np.full(3, 1e308), np.zeros(3)))
    assert compiled.count == 1


@pytest.mark.parametrize("start", [0, 9, 10])
def test_a_start_that_cannot_be_taken_for_certain(start: int) -> None:
    compiled = CompiledRunLengthFilter(PRESETS["default"].lattice(), HAZARD)
    for observed, _ in pieces(np.random.default_rng(0), 9):
        compiled.step(observed)
    with pytest.raises(ValueError, match=f"start is {start}, expected 1 to 8"):
        compiled.condition_on_start(start)


class Own(StudentRandomWalk):
    """A third party's model, though it looks like one of ours."""


def test_what_has_no_compiled_twin_gets_the_reference() -> None:
    lattice = alone(Own("position", 1.0))
    assert not can_compile(lattice)
    assert isinstance(make_filter(lattice, HAZARD, FilterParameters()), RunLengthFilter)
    with pytest.raises(ValueError, match="no compiled twin for one of"):
        CompiledRunLengthFilter(lattice, HAZARD)


def test_more_shares_than_there_is_room_for_have_no_compiled_twin() -> None:
    moving = PRESETS["strokes"].lattice().channels["moving"]
    assert isinstance(moving, ProfileModel)
    crowded: Noise = replace(moving.noise, shares=(0.1, 0.2, 0.3, 0.4, 0.5))
    assert not can_compile(alone(replace(moving, noise=crowded)))
    guided = PRESETS["default"].lattice().channels["moving"]
    assert isinstance(guided, GuidedMotion)
    assert not can_compile(alone(replace(guided, scales=(0.25, 0.5, 1.0, 2.0, 4.0))))


def test_presets_are_compiled() -> None:
    assert all(isinstance(preset.online(), CompiledRunLengthFilter) for preset in PRESETS.values())


def test_logarithm_and_exponential() -> None:
    rng = np.random.default_rng(0)
    for x in np.exp(np.concatenate([rng.uniform(-600, 600, 2000), rng.uniform(-1e-6, 1e-6, 2000)])):
        assert log(x) == pytest.approx(math.log(x), rel=5e-16, abs=1e-300)
    for x in np.concatenate([-rng.exponential(50.0, 2000), -rng.exponential(1e-9, 200), [0.0, -700.0]]):
        assert exp_of_negative(x) == pytest.approx(math.exp(x), rel=5e-16, abs=1e-305)
        assert share_missing(-x) == pytest.approx(-math.expm1(x), rel=5e-16, abs=0.0)
    assert exp_of_negative(-math.inf) == exp_of_negative(-701.0) == 0.0


def test_log_sum_exp_and_its_shares() -> None:
    for values in (np.full(3, -math.inf), np.array([0.0, -math.inf, 0.0]), np.linspace(-800.0, 5.0, 21)):
        total, shares = log_sum_exp(values, values.size), values.copy()
        assert total == pytest.approx(evidence.log_sum_exp(values), abs=1e-14)
        assert shares_of(shares, shares.size) == total
        np.testing.assert_allclose(shares, np.exp(values - total) if total > -math.inf else 0.0, atol=1e-15)
